"""Snapshots of the leaderboard, and comparisons of two policies."""

from typing import Annotated

from fastapi import Query, Response

from hide_tasks.contract import Split
from server import comparisons, snapshots
from server.access import Router, Scope, needs
from server.deps import Cursor, Limit, Reading, TheHub, ThePlace, ThePrincipal
from server.revalidation import FOR_EVER, Revalidate
from server.schemas.common import Page, Verdict
from server.schemas.comparisons import Comparison
from server.schemas.snapshots import SnapshotContent, SnapshotCreate, SnapshotPublic
from server.suites import BoardName

router = Router(tags=["catalogue"])
SNAPSHOTS = "/leaderboard/snapshots"


@router.get(SNAPSHOTS)
@needs(Scope.READ)
def list_snapshots(
    session: Reading,
    suite: BoardName | None = None,
    split: Split | None = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[SnapshotPublic]:
    """Leaderboards that were kept, the newest first."""
    return snapshots.listed(session, suite=suite, split=split, limit=limit, cursor=cursor)


@router.post(
    SNAPSHOTS,
    status_code=201,
    responses={200: {"model": SnapshotPublic, "description": "It was there before."}},
)
@needs(Scope.MAINTAIN)
def take_snapshot(
    wanted: SnapshotCreate, hub: TheHub, principal: ThePrincipal, response: Response
) -> SnapshotPublic:
    """Keeps the leaderboard as it stands; it never changes. The same one again is the same."""
    with hub.database.reading() as session:
        content = snapshots.content(session, wanted.split, suite=wanted.suite)
    with hub.database.writing() as session:
        row, new = snapshots.keep(
            session,
            content,
            wanted.split,
            suite=wanted.suite,
            note=wanted.note,
            owner=principal.user,
        )
        public = snapshots.public(row)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/api/v1{SNAPSHOTS}/{public.number}"
    return public


@router.get(SNAPSHOTS + "/{snapshot}")
@needs(Scope.READ)
def get_snapshot(snapshot: str, session: Reading) -> SnapshotPublic:
    """One snapshot, by its number or its SHA-256."""
    return snapshots.public(snapshots.find(session, snapshot))


@router.get(
    SNAPSHOTS + "/{snapshot}/content.json",
    response_class=Response,
    responses={200: {"model": SnapshotContent}},
)
@needs(Scope.READ)
def get_snapshot_content(snapshot: str, session: Reading, revalidate: Revalidate) -> Response:
    """What was kept, to the byte: its SHA-256 is the snapshot's."""
    row = snapshots.find(session, snapshot)
    headers = FOR_EVER | {"ETag": revalidate.unless(row.sha256)}
    return Response(row.content, media_type="application/json", headers=headers)


@router.get("/comparisons")
@needs(Scope.READ)
def compare_policies(
    session: Reading,
    revalidate: Revalidate,
    a: Annotated[str, Query(max_length=100, description="An evaluation's id, or a policy.")],
    b: Annotated[str, Query(max_length=100, description="The other one.")],
    place: ThePlace,
    verdict: Verdict = "success",
) -> Comparison:
    """Two policies on the same episodes; a name means an evaluation of the suite and the split.

    Per task McNemar's test, with Holm's correction, and an interval of the difference; over
    tasks also bootstrapped. Differences are A less B.
    """
    one = comparisons.find(session, "a", a, place)
    other = comparisons.find(session, "b", b, place)
    revalidate.unless(one.id, one.state, other.id, other.state, verdict)
    return comparisons.compare(session, one, other, verdict=verdict)
