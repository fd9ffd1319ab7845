"""Leaderboards that are kept as they stood, under the SHA-256 of their content.

A snapshot says what each of its rows rests on: the digests of the episodes' results, the code and
the machine that played them. Whoever holds its hash can tell that nothing of it was changed.
"""

import hashlib
import json
from collections.abc import Sequence
from typing import cast

from sqlalchemy import select
from sqlalchemy.orm import InstrumentedAttribute, Session

from hide_tasks.contract import Split
from hide_tasks.machine import installed
from hide_tasks.suite import SUITE
from server import leaderboard, statistics
from server.models import Episode, Evaluation, LeaderboardSnapshot
from server.paging import after, page
from server.problems import Problem, not_found
from server.schemas.common import Page
from server.schemas.snapshots import SnapshotContent, SnapshotEvaluation, SnapshotPublic
from server.suites import Place


def content(session: Session, split: Split, *, suite: str = SUITE) -> str:
    """A suite's leaderboard of a split as it stands, as JSON; the same gives the same bytes.

    Raises:
        Problem: 409, nothing stands there.
    """
    by_success = leaderboard.leaderboard(session, split=split, verdict="success", of=suite)
    by_exact = leaderboard.leaderboard(session, split=split, verdict="exact", of=suite)
    ids = sorted(row.evaluation for row in by_success.rows)
    if not ids:
        place = Place(suite, split)
        raise Problem(409, "empty", f"No policy has a whole evaluation on {place} yet.")
    found = SnapshotContent(
        software=installed("hide-seek") or "0",
        statistics=statistics.METHOD,
        episodes=_digest(session, ids[0], Episode.scene_hash),
        leaderboards={"success": by_success, "exact": by_exact},
        evaluations=[_evaluation(session, id) for id in ids],
    )
    return json.dumps(found.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))


def _evaluation(session: Session, id: str) -> SnapshotEvaluation:
    one = session.get_one(Evaluation, id)
    return SnapshotEvaluation(
        evaluation=id,
        policy_version=one.policy_version_id,
        results=results_digest(session, id),
        sources=one.sources,
        machine=one.machine,
    )


def _digest(session: Session, evaluation: str, column: InstrumentedAttribute[str | None]) -> str:
    """SHA-256 of a value of every episode, one a line: task, index, value."""
    rows = session.execute(
        select(Episode.task, Episode.index, column)
        .where(Episode.evaluation_id == evaluation)
        .order_by(Episode.task, Episode.index)
    )
    lines = "".join(f"{task} {index} {value}\n" for task, index, value in rows)
    return hashlib.sha256(lines.encode()).hexdigest()


def keep(
    session: Session,
    text: str,
    split: Split,
    *,
    suite: str = SUITE,
    note: str = "",
    owner: str | None = None,
) -> tuple[LeaderboardSnapshot, bool]:
    """The snapshot with this content, and whether it is a new one."""
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    known = select(LeaderboardSnapshot).where(LeaderboardSnapshot.sha256 == sha256)
    if there := session.scalar(known):
        return there, False
    row = LeaderboardSnapshot(
        sha256=sha256, content=text, suite=suite, split=split, note=note, owner_id=owner
    )
    session.add(row)
    session.flush()
    session.refresh(row)
    return row, True


def results_digest(session: Session, evaluation: str) -> str:
    """What a snapshot says of an evaluation's results, from the ledger as it stands."""
    return _digest(session, evaluation, Episode.digest)


def find(session: Session, text: str) -> LeaderboardSnapshot:
    """The snapshot of this number or SHA-256.

    Raises:
        Problem: 404, there is none.
    """
    by_number = text.isascii() and text.isdecimal() and len(text) < 10
    column = LeaderboardSnapshot.number if by_number else LeaderboardSnapshot.sha256
    wanted = select(LeaderboardSnapshot).where(column == (int(text) if by_number else text))
    if found := session.scalar(wanted):
        return found
    raise not_found("snapshot", text)


def listed(
    session: Session,
    *,
    suite: str | None = None,
    split: Split | None = None,
    limit: int = 50,
    cursor: str | None = None,
) -> Page[SnapshotPublic]:
    """Snapshots, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(LeaderboardSnapshot).order_by(LeaderboardSnapshot.number.desc())
    if suite is not None:
        wanted = wanted.where(LeaderboardSnapshot.suite == suite)
    if split is not None:
        wanted = wanted.where(LeaderboardSnapshot.split == split)
    if place := after(cursor, [int]):
        wanted = wanted.where(LeaderboardSnapshot.number < place[0])
    rows: Sequence[LeaderboardSnapshot] = session.scalars(wanted.limit(limit + 1)).all()
    return page(rows, limit, lambda one: [one.number], public)


def public(one: LeaderboardSnapshot) -> SnapshotPublic:
    """A snapshot as the API gives it out: where its content is, not the content."""
    return SnapshotPublic(
        number=one.number,
        sha256=one.sha256,
        content=f"/api/v1/leaderboard/snapshots/{one.number}/content.json",
        suite=one.suite,
        split=cast(Split, one.split),
        note=one.note,
        created=one.created,
        owner=one.owner and one.owner.name,
    )
