"""The form that starts an evaluation: a policy, what it plays, what that costs."""

from collections.abc import Sequence
from typing import Annotated, Literal, NamedTuple

from fastapi import Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy.orm import Session

from hide_tasks.contract import Category
from hide_tasks.suite import SPLITS, SUITE
from server import evaluations, policies, suites, tasks
from server.access import Router, Scope, needs
from server.deps import Reading, TheHub, ThePrincipal
from server.models import Evaluation
from server.routes.uploads import list_uploads
from server.schemas.evaluations import EvaluationPublic
from server.schemas.policies import PolicyVersionPublic
from server.suites import BOARDS, BoardName
from web.templating import page
from web.wording import WIRES
from workers.protocol import CheckpointPolicy

router = Router(include_in_schema=False)

Source = Literal["here", "upload", "server"]


class Preset(NamedTuple):
    """What is filled in."""

    choice: str = ""  # a category, "smoke", "some", or "" for the whole suite
    tasks: Sequence[str] = ()
    split: str = "test"
    episodes: int | None = None  # None: all
    rules: str = "hide"
    priority: int = 0
    recordings: bool = True


@router.get("/evaluations/new")
@needs(Scope.SUBMIT)
def show_form(
    request: Request,
    session: Reading,
    hub: TheHub,
    principal: ThePrincipal,
    policy: Annotated[str | None, Query(max_length=100)] = None,
    like: Annotated[str | None, Query(max_length=40)] = None,
    suite: BoardName | None = None,
    upload: bool = False,
    source: Source | None = None,
) -> HTMLResponse:
    """The form that starts an evaluation, with ways to bring what is to be evaluated.

    Args:
        like: an evaluation that asked for the same.
        suite: what it plays, unless `like` says it; else what its policy was trained on.
        upload: as `source=upload`.
    """
    unfinished = list_uploads(session, hub, principal)
    before = evaluations.row(session, like) if like else None
    begun = any(one.offset < one.length for one in unfinished)
    named = policy or like
    versions = policies.versions(session)
    chosen = _chosen(versions, before.policy_version_id if before else policy)
    shown = {
        "source": source or ("upload" if upload or (begun and not named) else "here"),
        "unfinished": unfinished,
        "limit": hub.settings.checkpoint_limit,
        "reserved": policies.reserved(session),
        "wires": WIRES,
        "versions": versions,
        "suites": {name: tasks.catalogue(name) for name in BOARDS},
        "categories": list(Category),
        "chosen": chosen,
        "like": _public(session, before),
        "preset": _preset(
            before,
            suite or _trained_on(versions, chosen),
            at_most=100 if principal.may(Scope.MAINTAIN) else 0,
        ),
    }
    return page(request, "evaluation_new.html", shown)


def _chosen(versions: Sequence[PolicyVersionPublic], wanted: str | None) -> str | None:
    """The version that an id, a name (its newest) or name@version names."""
    named = (
        one.id for one in versions if wanted in (one.id, one.policy, f"{one.policy}@{one.version}")
    )
    return next(named, None)


def _public(session: Session, before: Evaluation | None) -> EvaluationPublic | None:
    return evaluations.public(session, before) if before else None


def _trained_on(versions: Sequence[PolicyVersionPublic], chosen: str | None) -> str:
    """The suite of a checkpoint's demonstrations; the paper's of every other policy."""
    found = next((one.spec for one in versions if one.id == chosen), None)
    suite = found.suite if isinstance(found, CheckpointPolicy) else SUITE
    return suite if suite in BOARDS else SUITE


def _preset(before: Evaluation | None, suite: str, *, at_most: int) -> Preset:
    if before is None:
        return Preset(choice="" if suite == SUITE else suite)
    covers = suites.covers(before)
    most = SPLITS.get(before.split)  # type: ignore[call-overload]
    return Preset(
        choice={"full": "", "part": "some", "smoke": "some"}.get(covers, covers),
        tasks=before.tasks if covers in ("part", "smoke") else (),
        split=before.split,
        episodes=None if before.episodes == most else before.episodes,
        rules=before.rules,
        priority=min(before.priority, at_most),
        recordings=before.recordings,
    )
