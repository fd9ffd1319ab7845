"""What a server measured of a study, from its data folder: one record a run, raw outcomes too.

The server may run meanwhile. Nothing is computed here that two runs are needed for.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks import SUITES, suite
from seek_model.checkpoint_header import Header, read_header
from seek_model.study import SPLIT, Run, Study, is_of
from server import belief_scores
from server.blobs import Blobs
from server.models import Episode, Evaluation
from server.read_only import ReadOnlyFolder
from server.settings import LEDGER
from server.states import EvaluationState

REFERENCES = ("expert", "amnesiac")  # the scale: all, and the most without memory
VERDICTS = ("success", "exact")
Record = dict[str, Any]


def tasks_of(study: Study) -> tuple[str, ...]:
    """The tasks that a study is measured on."""
    return study.tasks or SUITES[suite.SUITE]


def episodes_of(study: Study) -> int:
    """How many episodes of each."""
    return study.episodes or suite.SPLITS[SPLIT]


def read(study: Study, data: Path) -> dict[str, Record]:
    """The record of every run and reference policy that played the study's episodes, by name.

    Of several evaluations of a run the latest counts, not the best.
    """
    if not (data / LEDGER).exists():
        return {}
    with ReadOnlyFolder.opened(data) as folder, Session(folder.engine()) as session:
        found = {name: (one, header) for name, one, header in _of(study, session, folder.blobs)}
        return {name: _record(session, *one) for name, one in found.items()}


def _of(
    study: Study, session: Session, blobs: Blobs
) -> Iterator[tuple[str, Evaluation, Header | None]]:
    """Every evaluation of the study, the oldest first."""
    wanted = select(Evaluation).where(
        Evaluation.split == SPLIT,
        Evaluation.rules == "hide",
        Evaluation.state == EvaluationState.COMPLETED,
        Evaluation.suite == suite.SUITE,
        Evaluation.suite_version == suite.VERSION,
        Evaluation.episodes == episodes_of(study),
    )
    for one in session.scalars(wanted.order_by(Evaluation.id)):
        if set(one.tasks) != set(tasks_of(study)):
            continue
        policy, spec = one.policy_version.policy.name, one.policy_version.spec
        if one.policy_version.reference and policy in REFERENCES:
            yield policy, one, None
        elif spec["kind"] == "checkpoint" and blobs.holds(spec["sha256"]):
            header = read_header(blobs.path(spec["sha256"]))
            for run in _runs(study, policy, header):
                yield run.name, one, header


def _runs(study: Study, policy: str, header: Header) -> Iterable[Run]:
    return (run for run in study.measured if run.policy == policy and is_of(run, header.config))


def _record(session: Session, one: Evaluation, header: Header | None) -> Record:
    columns = (Episode.task, Episode.success, Episode.exact, Episode.failure, Episode.decisions)
    rows = session.execute(
        select(*columns, Episode.timing)
        .where(Episode.evaluation_id == one.id)
        .order_by(Episode.task, Episode.index)
    ).all()
    outcomes: dict[str, dict[str, str]] = {name: defaultdict(str) for name in VERDICTS}
    failures: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        for name in VERDICTS:
            outcomes[name][row.task] += "01"[getattr(row, name)]
        if row.failure:
            failures[row.task][row.failure] += 1
    timings = [row.timing or {} for row in rows]
    belief = belief_scores.told(session, [one.id])[one.id]
    return {
        "evaluation": one.id,
        "ended": one.ended and one.ended.date().isoformat(),
        "processor": one.machine.get("processor"),
        "outcomes": outcomes,
        "failures": {task: dict(counted.most_common()) for task, counted in failures.items()},
        "belief": belief and belief.model_dump(),
        "decisions": sum(row.decisions or 0 for row in rows),
        "policy_seconds": round(sum(timing.get("policy", 0.0) for timing in timings), 1),
        "episode_seconds": round(sum(timing.get("total", 0.0) for timing in timings), 1),
    } | (_origin(one, header) if header else {})


def _origin(one: Evaluation, header: Header) -> Record:
    """Where a checkpoint comes from."""
    return {
        "sha256": one.policy_version.spec["sha256"],
        "bytes": one.policy_version.spec["size"],
        "parameters": header.parameters,
        "provenance": header.provenance.model_dump(mode="json"),
    }
