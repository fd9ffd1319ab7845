"""Final episodes of a ledger: each against its own rows and against the suite."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError
from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import SUITES, suite
from hide_tasks.contract import DecisionRecord, EpisodeResult, InvalidAction, Start, parse_action
from server import lifecycle, spans
from server.models import Decision, Episode, HiddenChange, HiddenSpan
from server.verification.findings import Findings
from server.verification.verdicts import judged, policy_failure
from workers.protocol import UNMEASURED, digest_of_documents
from workers.protocol import HiddenChange as HiddenMoment
from workers.resimulation import Recorded

RESULT = tuple(name for name in EpisodeResult.model_fields if name not in UNMEASURED)
DECISION = tuple(name for name in DecisionRecord.model_fields if name != "decision")
CHANGE = tuple(HiddenMoment.model_fields)
SPAN = ("kind", "name", "number", "value", "decision_from", "decision_to", "time_from", "time_to")
Document = dict[str, Any]


@dataclass(frozen=True)
class Rows:
    """All that the ledger keeps of what was measured in an episode, as documents."""

    episode: Episode
    result: Document
    start: Document
    decisions: list[Document]
    changes: list[Document]
    spans: list[Document]

    @property
    def name(self) -> str:
        """As files and messages name it."""
        return f"{self.episode.task}-{self.episode.split}-{self.episode.index:03d}"

    @property
    def digest(self) -> str:
        """Of the rows as they are."""
        return digest_of_documents(self.result, self.start, self.decisions, self.changes)

    @property
    def verdicts(self) -> Document:
        """That follow from its decisions; none that counts from what are no decisions."""
        try:
            return judged(self.episode.failure, self.start.get("checks", {}), self.decisions)
        except (AttributeError, KeyError, TypeError, ValueError):  # somebody edited the JSON
            return {"success": False, "exact": False, "failure": "unreadable decisions"}

    def recorded(self) -> Recorded:
        """What is played to see whether it comes out the same.

        Raises:
            InvalidAction, ValidationError: its rows are none of an episode.
        """
        return Recorded(
            key=self.episode.id,
            spec=lifecycle.spec_of(self.episode),
            rules="parity" if self.episode.evaluation.rules == "parity" else "hide",
            actions=tuple(parse_action(one["action"]) for one in self.decisions),
            fault=policy_failure(self.episode.failure),
        )


def read(session: Session, id: str) -> Rows:
    """What the ledger keeps of a final episode.

    Raises:
        ValueError: a row of it is no JSON.
    """
    one = session.get_one(Episode, id)
    decisions = _documents(session, Decision, id, DECISION)
    return Rows(
        episode=one,
        result={name: getattr(one, name) for name in RESULT},
        start=one.start or {},
        decisions=[{"decision": number, **row} for number, row in enumerate(decisions)],
        changes=_documents(session, HiddenChange, id, CHANGE),
        spans=_documents(session, HiddenSpan, id, SPAN),
    )


def _documents(session: Session, table: Any, id: str, names: Sequence[str]) -> list[Document]:
    columns = [getattr(table, name) for name in names]
    wanted = select(*columns).where(table.episode_id == id).order_by(table.number)
    return [dict(zip(names, values, strict=True)) for values in session.execute(wanted)]


def check(rows: Rows, findings: Findings, *, same_sources: bool) -> bool:
    """Notes what of an episode does not agree with the rest of it; true if everything does.

    Args:
        same_sources: the code here is that which played it, so the suite's episodes are the same.
    """
    episode = rows.episode
    findings.episodes += 1
    known = len(findings.mismatches)
    verdicts = {name: getattr(episode, name) for name in ("success", "exact", "failure")}
    findings.expect(episode.id, rows.name, verdicts, rows.verdicts)
    findings.expect(episode.id, rows.name, {"digest": episode.digest}, {"digest": rows.digest})
    _check_spans(rows, findings)
    if same_sources:
        _check_spec(rows, findings)
    return len(findings.mismatches) == known


def _check_spans(rows: Rows, findings: Findings) -> None:
    """What pages search was derived when the episode was committed; it is derived again."""
    try:
        derived = spans.derive(
            Start.model_validate(rows.start),
            [DecisionRecord.model_validate(one) for one in rows.decisions],
            [HiddenMoment.model_validate(one) for one in rows.changes],
        )
    except ValidationError as error:
        wrong = error.errors()[0]
        place = ".".join(str(part) for part in wrong["loc"])
        findings.note(rows.episode.id, rows.name, f"rows: {place}", wrong["input"], wrong["msg"])
        return
    found = {(one.kind, one.name, one.number): vars(one) for one in derived}
    stored = {(one["kind"], one["name"], one["number"]): one for one in rows.spans}
    for key in sorted(found.keys() | stored.keys()):
        if stored.get(key) != found.get(key):
            what = f"span {key[0]} {key[1]} {key[2]}"
            findings.note(rows.episode.id, rows.name, what, stored.get(key), found.get(key))


def _check_spec(rows: Rows, findings: Findings) -> None:
    episode = rows.episode
    try:
        played = lifecycle.spec_of(episode)
        if played.suite not in SUITES or played.version != suite.VERSION:
            return
        wanted = suite.episode(episode.task, played.split, episode.index)
    except ValueError as error:
        findings.note(episode.id, rows.name, "spec", "an episode", " ".join(str(error).split()))
        return
    findings.expect(episode.id, rows.name, played.model_dump(), wanted.model_dump())
    hashes = suite.committed(episode.task).get("splits", {}).get(episode.split, {})
    for scene in hashes.get("scene_hashes", [])[episode.index : episode.index + 1]:
        stored = (episode.scene_hash or "")[: len(scene)]  # as many digits as are committed
        findings.expect(episode.id, rows.name, {"scene_hash": stored}, {"scene_hash": scene})


def replayable(rows: Rows, findings: Findings) -> Recorded | None:
    """What is played again; None, and noted, if its rows are no episode's."""
    try:
        return rows.recorded()
    except (InvalidAction, ValidationError) as error:
        line = " ".join(str(error).split())
        findings.note(rows.episode.id, rows.name, "action log", "unreadable", line)
        return None
