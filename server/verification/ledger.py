"""A ledger, evaluation by evaluation: episodes, files, a sample played again, scores."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Engine, select, text
from sqlalchemy.orm import Session

from hide_tasks.machine import fingerprint
from server import evaluations
from server.blobs import CHECKPOINT, Blobs
from server.evaluations import Counts, current_sources
from server.models import Attempt, Blob, Episode, Evaluation
from server.read_only import ReadOnlyFolder
from server.schemas.common import Verdicts
from server.states import EpisodeState, EvaluationState
from server.verification import episodes, simulation
from server.verification.boards import check_leaderboard, check_snapshots, scores
from server.verification.files import check_blob, check_files
from server.verification.findings import Findings
from server.verification.simulation import Replay

Verdict = dict[str, Any]
Machine = dict[str, Any]
Say = Callable[[str], None]


class NoEvaluation(ValueError):
    """The ledger has none of this id."""


@dataclass
class Verifier:
    """One verification of a ledger that may be written meanwhile; what is final stays final.

    Args:
        sample: episodes of each task of an evaluation that are played again; None: all.
        say: told where it is.
    """

    folder: ReadOnlyFolder
    sample: int | None = 2
    workers: int = 1
    say: Say = lambda _: None
    findings: Findings = field(default_factory=Findings)

    def verify(self, evaluation: str | None = None) -> Findings:
        """Everything, or one evaluation with all that belongs to it.

        Raises:
            NoEvaluation: there is none of this id.
            LedgerError: the ledger is of an older version.
        """
        engine = self.folder.engine()
        try:
            self._verify(engine, evaluation)
        finally:
            engine.dispose()
        return self.findings

    def _verify(self, engine: Engine, evaluation: str | None) -> None:
        with Session(engine) as session:
            ids = list(session.scalars(select(Evaluation.id).order_by(Evaluation.id)))
        if evaluation is not None and evaluation not in ids:
            raise NoEvaluation(f"{self.folder.path} has no evaluation {evaluation}.")
        counted = {}
        for id in ids if evaluation is None else [evaluation]:
            counted[id] = self._verify_one(engine, id)
        if evaluation is None:
            with Session(engine) as session:
                _check_database(session, self.findings)
                _check_checkpoints(session, self.folder.blobs, self.findings)
        with Session(engine) as session:
            check_leaderboard(session, counted, self.findings)
            check_snapshots(session, counted, self.findings)

    def _verify_one(self, engine: Engine, id: str) -> dict[str, Counts]:
        """One evaluation; its counts by task, recomputed."""
        self.findings.evaluations += 1
        with Session(engine) as session:
            row = session.get_one(Evaluation, id)
            verdicts, replays = self._check_rows(session, row)
            stored = _stored_counts(session, row)
        self.say(f"{id}: {len(verdicts)} episodes read, {len(replays)} are played again")
        played = simulation.play_again(replays, self.findings, workers=self.workers)
        for key, outcome in played.items():  # what was played again is believed most
            task, _ = verdicts[key]
            result = outcome.result
            verdicts[key] = task, {"success": result.success, "exact": result.exact}
        counted = _counted(verdicts.values())
        self.findings.scores[id] = _sum(counted.values())
        _check_scores(id, stored, counted, self.findings)
        return counted

    def _check_rows(
        self, session: Session, row: Evaluation
    ) -> tuple[dict[str, tuple[str, Verdict]], list[Replay]]:
        """Verdicts by episode, and what is to be played again."""
        verdicts: dict[str, tuple[str, Verdict]] = {}
        replays: list[Replay] = []
        for task in row.tasks:
            found = _readable(session, row, task, self.findings)
            _check_coverage(row, task, found, self.findings)
            same = row.sources.get(task) == current_sources().get(task)
            suspicious = [
                one for one in found if not episodes.check(one, self.findings, same_sources=same)
            ]
            _check_files(session, found, self.folder.blobs, self.findings)
            verdicts |= {one.episode.id: (task, one.verdicts) for one in found}
            machines = _machines(session, row, found)
            replays += self._replays(found, suspicious, machines, same_sources=same)
        return verdicts, replays

    def _replays(
        self,
        found: Sequence[episodes.Rows],
        suspicious: Sequence[episodes.Rows],
        machines: Mapping[str, Machine],
        *,
        same_sources: bool,
    ) -> list[Replay]:
        """A sample, and whatever does not agree with itself."""
        chosen = {one.episode.id: one for one in simulation.sampled(found, self.sample)}
        if self.sample != 0:
            chosen |= {one.episode.id: one for one in suspicious}
        if not same_sources:
            for _ in chosen:
                self.findings.leave_out("the task's sources have changed since it was played")
            return []
        here = fingerprint()
        return [
            Replay(
                recorded,
                one.name,
                one.result,
                one.decisions,
                one.changes,
                same_machine=machines[one.episode.id] == here,
            )
            for one in chosen.values()
            if (recorded := episodes.replayable(one, self.findings))
        ]


def _machines(
    session: Session, row: Evaluation, found: Iterable[episodes.Rows]
) -> dict[str, Machine]:
    """By episode, the machine of the attempt that played it; else the evaluation's own server."""
    shards = {one.episode.shard_id for one in found}
    wanted = select(Attempt.shard_id, Attempt.fence, Attempt.machine)
    told = session.execute(wanted.where(Attempt.shard_id.in_(shards)))
    machines = {(shard, fence): machine for shard, fence, machine in told if machine}
    return {
        one.episode.id: machines.get((one.episode.shard_id, one.episode.fence), row.machine)
        for one in found
    }


def _readable(
    session: Session, row: Evaluation, task: str, findings: Findings
) -> list[episodes.Rows]:
    """The final episodes of a task, in order, but for those whose rows are no rows any more."""
    wanted = select(Episode.id).where(
        Episode.evaluation_id == row.id,
        Episode.task == task,
        Episode.state == EpisodeState.FINAL,
    )
    found = []
    for id in session.scalars(wanted.order_by(Episode.index)).all():
        try:
            found.append(episodes.read(session, id))
        except ValueError as error:
            findings.note(id, task, "rows", "JSON", str(error))
    return found


def _check_coverage(
    row: Evaluation, task: str, found: Sequence[episodes.Rows], findings: Findings
) -> None:
    """A completed evaluation has every episode once: none more, none left out."""
    if row.state == EvaluationState.COMPLETED:
        stored = {f"episodes of {task}": list(range(row.episodes))}
        there = {f"episodes of {task}": [one.episode.index for one in found]}
        findings.expect(row.id, row.policy_version.policy.name, stored, there)


def _check_files(
    session: Session, found: Iterable[episodes.Rows], store: Blobs, findings: Findings
) -> None:
    for rows in found:
        one = rows.episode
        if one.removal:
            findings.removed += 1
        hashes = [sha256 for sha256 in (one.recording, one.thumbnail) if sha256]
        named = session.scalars(select(Blob).where(Blob.sha256.in_(hashes))).all()
        version = one.evaluation.policy_version
        said = rows.result | {"policy": f"{version.policy.name}@{version.number}"}
        check_files(one, said, {blob.sha256: blob for blob in named}, store, findings)


def _check_database(session: Session, findings: Findings) -> None:
    """The whole of SQLite's file; a server that starts looks at the first gigabyte or so."""
    if session.get_bind().dialect.name != "sqlite":
        return
    found = session.scalars(text("PRAGMA integrity_check(5)")).all()
    if found != ["ok"]:
        findings.note("ledger", "", "integrity of the file", "; ".join(map(str, found)), "ok")


def _check_checkpoints(session: Session, store: Blobs, findings: Findings) -> None:
    """Files that belong to no episode."""
    wanted = select(Blob).where(Blob.media_type == CHECKPOINT)
    for blob in session.scalars(wanted).all():
        check_blob(blob, store, findings, blob.media_type)


# --- scores ---


def _counted(verdicts: Iterable[tuple[str, Verdict]]) -> dict[str, Counts]:
    by_task: dict[str, list[Verdict]] = defaultdict(list)
    for task, verdict in verdicts:
        by_task[task].append(verdict)
    return {
        task: Counts(
            expected=len(found),
            final=len(found),
            success=sum(one["success"] for one in found),
            exact=sum(one["exact"] for one in found),
        )
        for task, found in by_task.items()
    }


def _sum(counts: Iterable[Counts]) -> Counts:
    return Counts(*(sum(column) for column in zip(Counts(), *counts, strict=True)))


def _stored_counts(session: Session, row: Evaluation) -> Verdicts:
    """What the API and the pages say of it."""
    return evaluations.verdicts(evaluations.counts(session, [row.id])[row.id])


def _check_scores(
    id: str, stored: Verdicts, counted: Mapping[str, Counts], findings: Findings
) -> None:
    found = evaluations.verdicts(_sum(counted.values()))
    findings.expect(id, "score", scores(stored), scores(found))
