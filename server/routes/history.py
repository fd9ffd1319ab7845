"""How an evaluation went, what is to be read of it, and what is done with it afterwards."""

from fastapi import Response
from pydantic import TypeAdapter

from hide_tasks.contract import Split
from server import evaluations, event_log, history, log_tail, publication
from server.access import Router, Scope, needs
from server.deps import Cursor, EvaluationId, Limit, Reading, TheHub, ThePrincipal
from server.models import Evaluation
from server.routes.evaluations import queued
from server.routes.snapshots import take_snapshot
from server.schemas.common import Page
from server.schemas.evaluations import EvaluationCreate, EvaluationPublic
from server.schemas.history import HistoryPublic, LogLine, PublicationPublic, WorkersLog
from server.schemas.snapshots import SnapshotCreate, SnapshotPublic

router = Router(tags=["evaluations"])


@router.get("/evaluations/{evaluation}/history")
@needs(Scope.READ)
def get_history(evaluation: EvaluationId, session: Reading) -> HistoryPublic:
    """When which episode was played, side by side, and what every other moment was spent on."""
    return history.of(session, session.get_one(Evaluation, evaluation))


@router.get("/evaluations/{evaluation}/log")
@needs(Scope.READ)
def list_log(
    evaluation: EvaluationId, session: Reading, limit: Limit = 50, cursor: Cursor = None
) -> Page[LogLine]:
    """What happened to it, in plain words, the newest first."""
    return event_log.listed(session, evaluation, limit=limit, cursor=cursor)


@router.get("/workers/log")
@needs(Scope.MAINTAIN)
def get_workers_log(hub: TheHub) -> WorkersLog:
    """The end of what the workers of this machine printed, whatever they played."""
    return log_tail.of(hub)


@router.post("/evaluations/{evaluation}/rerun", status_code=202)
@needs(Scope.SUBMIT)
def rerun_evaluation(
    evaluation: str, hub: TheHub, principal: ThePrincipal, response: Response
) -> EvaluationPublic:
    """Queues another evaluation that asks for the same; the first one stays as it is."""
    with hub.database.writing() as session:
        wanted = the_same(evaluations.row(session, evaluation))
        created = evaluations.public(session, queued(session, hub, principal, wanted))
    hub.bell.reconciler.set()
    response.headers["Location"] = f"/api/v1/evaluations/{created.id}"
    return created


def the_same(one: Evaluation) -> EvaluationCreate:
    """What asks for the same again; not before others, for that may be another's to ask."""
    return EvaluationCreate(
        policy=one.policy_version_id,
        tasks=list(one.tasks),
        split=TypeAdapter(Split).validate_python(one.split),
        episodes=one.episodes,
        rules="parity" if one.rules == "parity" else "hide",
        priority=min(one.priority, 0),
        recordings=one.recordings,
    )


@router.get("/evaluations/{evaluation}/publication")
@needs(Scope.READ)
def get_publication(evaluation: EvaluationId, session: Reading) -> PublicationPublic:
    """Whether it may be published, why not, and the snapshots that it is in."""
    return publication.of(session, session.get_one(Evaluation, evaluation))


@router.post(
    "/evaluations/{evaluation}/publication",
    status_code=201,
    responses={200: {"model": SnapshotPublic, "description": "It was there before."}},
)
@needs(Scope.MAINTAIN)
def publish_evaluation(
    evaluation: str, hub: TheHub, principal: ThePrincipal, response: Response
) -> SnapshotPublic:
    """Keeps the leaderboard with this evaluation in it, for ever; refused unless it is whole."""
    with hub.database.reading() as session:
        row = evaluations.row(session, evaluation)
        publication.require_publishable(session, row)
        version = row.policy_version
        note = f"{version.policy.name}@{version.number} is published: {row.id}"
        split = TypeAdapter(Split).validate_python(row.split)
        wanted = SnapshotCreate(suite=row.suite, split=split, note=note)
    return take_snapshot(wanted, hub, principal, response)
