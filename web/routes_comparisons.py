"""Two to six policies on the same episodes."""

from dataclasses import replace
from itertools import groupby
from typing import Annotated, Any, NamedTuple

from fastapi import Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse
from markupsafe import Markup
from sqlalchemy.orm import Session

from hide_tasks.contract import Split
from hide_tasks.suite import SUITE
from server import comparisons, outcomes, several
from server.access import Router, Scope, needs
from server.deps import Reading, ThePlace
from server.models import Evaluation
from server.problems import Problem
from server.schemas.common import RatePublic, Verdict
from server.schemas.several import SeveralComparison
from server.suites import BOARDS
from web import comparing, episode_grid
from web.comparing import Asked, OneCategory, OneTask, Side, Typed, Which
from web.episode_grid import LETTERS
from web.forest import Axis
from web.grouped_bars import Bar, grouped
from web.templating import page

router = Router(include_in_schema=False)

SPLITS: tuple[Split, ...] = ("test", "test100", "val", "train")
MOST_SUGGESTED = 12
MOST_LISTED = 60  # episodes


class Taken(NamedTuple):
    """The evaluation that is compared, and how many more its policy's name could have meant."""

    evaluation: Evaluation
    others: int


@router.get("/comparisons")
@needs(Scope.READ)
def show_comparison(
    request: Request,
    session: Reading,
    place: ThePlace,
    policy: Typed = [],  # noqa: B006, FastAPI copies it
    a: Side = "",
    b: Side = "",
    verdict: Annotated[Verdict, Query()] = "success",
    category: OneCategory = None,
    which: Which = "all",
    task: OneTask = "",
) -> HTMLResponse:
    """The form, and the comparison that the address asks for, or why there is none."""
    typed = [one.strip() for one in [*policy, a, b] if one.strip()]
    asked = Asked(typed, *place, verdict, category, which, task)
    shown: dict[str, Any] = {}
    problem = None
    try:
        if len(typed) > 1:
            asked, shown = _compared(session, asked)
        elif typed:
            comparisons.require_known(session, "policy.0", typed[0])
    except Problem as error:
        problem = error
    form = {"asked": asked, "suites": BOARDS, "splits": SPLITS, "LETTERS": LETTERS}
    form |= _form(session, asked, problem)
    status = problem.status if problem else 200
    return page(request, "comparison.html", {"found": None, **form, **shown}, status=status)


@router.get("/compare")
@needs(Scope.READ)
def show_comparison_by_its_verb(request: Request) -> RedirectResponse:
    """The same, for who writes the address by heart."""
    return RedirectResponse(f"/comparisons?{request.url.query}".rstrip("?"), 308)


def _form(session: Session, asked: Asked, problem: Problem | None) -> dict[str, Any]:
    suggested = several.suggested(session, asked.place)
    there = len(asked.policies)
    blank = max(several.FEWEST - there, int(there < several.MOST))
    named = {one["field"]: one["message"] for one in problem.errors} if problem else {}
    errors = [named.get(f"policy.{place}", "") for place in range(there + blank)]
    return {
        "fields": [*asked.policies, *[""] * blank],
        "errors": errors,
        "problem": problem.detail if problem and not any(errors) else "",
        "names": [_name(one) for one in suggested],
        "suggestions": _suggestions(session, suggested, asked),
    }


def _suggestions(
    session: Session, suggested: list[Evaluation], asked: Asked
) -> list[tuple[str, str, RatePublic]]:
    """Names that may be added, their addresses and rates."""
    if len(asked.policies) >= several.MOST:
        return []
    there = {*asked.policies}
    new = [
        one for one in suggested if not there & {one.id, _name(one), one.policy_version.policy.name}
    ][:MOST_SUGGESTED]
    played = outcomes.of_completed(session, [one.id for one in new])
    good = {id: getattr(found, asked.verdict) for id, found in played.items()}
    return [
        (_name(one), asked.with_(_name(one)), RatePublic.of(sum(good[one.id]), len(good[one.id])))
        for one in new
    ]


def _name(one: Evaluation) -> str:
    return f"{one.policy_version.policy.name}@{one.policy_version.number}"


def _compared(session: Session, asked: Asked) -> tuple[Asked, dict[str, Any]]:
    """What is asked for, at the place where the evaluations are that were named by ids, and what is
    shown of it."""
    ones = several.found(session, asked.policies, asked.place)
    found = several.compare(session, ones, verdict=asked.verdict)
    asked = replace(asked, **comparisons.place_of(ones[0])._asdict())
    return asked, {
        "found": found,
        "papers": ones[0].suite == SUITE,
        "taken": [
            Taken(one, comparisons.others(session, one) if text != one.id else 0)
            for one, text in zip(ones, asked.policies, strict=True)
        ],
        "group": found.categories.get(str(asked.category), found.overall),
        "bars": _bars(found),
        "choices": comparing.choices(len(ones)),
        "grid": _grid(found, asked),
        "episodes": asked.listed(found),
        "most_listed": MOST_LISTED,
        "beside": episode_grid.beside,
        **(_paired(session, ones, asked) if len(ones) == 2 else {"pair": None}),
    }


def _paired(session: Session, ones: list[Evaluation], asked: Asked) -> dict[str, Any]:
    pair = comparisons.compare(session, ones[0], ones[1], verdict=asked.verdict)
    axis = Axis.over([pair.overall, *pair.categories.values(), *pair.tasks])
    return {"pair": pair, "axis": axis}


def _bars(found: SeveralComparison) -> list[tuple[str, Markup]]:
    names = [f"{one.policy}@{one.version}" for one in found.policies]
    return [
        (kind, grouped([*map(Bar, LETTERS, names, group.rates)], kind, kind))
        for kind, group in {"overall": found.overall, **found.categories}.items()
    ]


def _grid(found: SeveralComparison, asked: Asked) -> dict[str, Any]:
    by_task = groupby(found.episodes, key=lambda one: one.task)
    lines = {task: episode_grid.task_line(list(ones), asked.shows) for task, ones in by_task}
    tasks = [
        one
        for one in found.tasks
        if asked.category in (None, one.category) and asked.task in ("", one.task)
    ]
    last = max(one.index for one in found.episodes)
    return {
        "lines": [(one, lines[one.task]) for one in tasks],
        "numbers": episode_grid.indices(last),
    }
