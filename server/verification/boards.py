"""Leaderboards, the present one and kept ones: every figure against counts made anew."""

import hashlib
from collections.abc import Mapping
from typing import cast

from pydantic import ValidationError
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import load
from hide_tasks.contract import Split
from server import evaluations, outcomes, snapshots
from server.evaluations import Counts
from server.leaderboard import compute, together
from server.models import Evaluation, LeaderboardSnapshot
from server.schemas.common import Verdicts
from server.schemas.leaderboard import LeaderboardRow
from server.schemas.snapshots import SnapshotContent
from server.suites import BOARDS
from server.verification.findings import Findings

ByTask = dict[str, Counts]


def scores(verdicts: Verdicts) -> dict[str, str]:
    """Both verdicts as texts that can be compared."""
    return {
        name: f"{rate.successes} of {rate.episodes}"
        for name, rate in (("success", verdicts.success), ("exact", verdicts.exact))
    }


def check_leaderboard(session: Session, counted: Mapping[str, ByTask], findings: Findings) -> None:
    """Every figure of every row whose evaluation was recomputed, on every suite's leaderboards."""
    places = select(Evaluation.suite, Evaluation.split).distinct()
    for suite, split in session.execute(places.where(Evaluation.suite.in_(BOARDS))).all():
        board = compute(session, cast(Split, split), "success", outcomes.as_stored, of=suite)
        for row in board.rows:
            if row.evaluation in counted:
                _check_row("leaderboard", row, counted[row.evaluation], findings)


def check_snapshots(session: Session, counted: Mapping[str, ByTask], findings: Findings) -> None:
    """Every snapshot: its bytes, and what they say of evaluations that were recomputed."""
    for one in session.scalars(select(LeaderboardSnapshot)):
        name = f"snapshot {one.number}"
        found = hashlib.sha256(one.content.encode()).hexdigest()
        findings.expect(name, one.note, {"sha256": one.sha256}, {"sha256": found})
        try:
            content = SnapshotContent.model_validate_json(one.content)
        except ValidationError as error:
            findings.note(name, one.note, "content", "a leaderboard", str(error))
            continue
        _check_content(session, name, content, counted, findings)


def _check_content(
    session: Session,
    name: str,
    content: SnapshotContent,
    counted: Mapping[str, ByTask],
    findings: Findings,
) -> None:
    for board in content.leaderboards.values():
        for row in board.rows:
            if row.evaluation in counted:
                _check_row(name, row, counted[row.evaluation], findings)
    for one in content.evaluations:
        if one.evaluation in counted:
            digest = snapshots.results_digest(session, one.evaluation)
            findings.expect(name, one.evaluation, {"results": one.results}, {"results": digest})


def _check_row(board: str, row: LeaderboardRow, counted: ByTask, findings: Findings) -> None:
    name = f"{board}, {row.policy}@{row.version}"
    category = {task: str(load(task).category) for task in counted}
    stored = {"overall": row.overall, **row.categories, **row.tasks}
    found = {"overall": together(counted.values())}
    found |= {
        group: together(one for task, one in counted.items() if category[task] == group)
        for group in row.categories
    }
    found |= {task: evaluations.verdicts(one) for task, one in counted.items()}
    for column in stored:
        if column in found:
            label = f"{name}, {column}"
            findings.expect(row.evaluation, label, scores(stored[column]), scores(found[column]))
        else:
            findings.note(row.evaluation, name, column, scores(stored[column]), None)
