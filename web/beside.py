"""Two runs of the same episode beside each other, aligned where they part."""

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

from sqlalchemy.orm import Session

from server import episodes, evaluations, partings
from server.problems import invalid
from server.schemas.episodes import DecisionPublic, EpisodeDetail, PartingPublic, RunPublic
from server.schemas.evaluations import EvaluationPublic
from web.timeline import Timeline

EXPERT = "expert"


class Pair(NamedTuple):
    """A decision of this run and its counterpart; past its end a run has none."""

    number: int
    one: DecisionPublic | None
    other: DecisionPublic | None
    parts: bool  # here they part


class Beside(NamedTuple):
    """The other run."""

    episode: EpisodeDetail
    evaluation: EvaluationPublic
    timeline: Timeline
    parting: PartingPublic
    pairs: list[Pair]

    @property
    def shift(self) -> int:
        """What is added to the number of a decision to find its counterpart."""
        here, there = self.parting.decision, self.parting.other_decision
        return 0 if here is None or there is None else there - here


def offered(runs: Sequence[RunPublic]) -> RunPublic | None:
    """The run that is compared with unless another is chosen: the expert's, if it is there."""
    return next((run for run in runs if run.reference and run.policy == EXPERT), None)


def beside(session: Session, id: str, decisions: Sequence[DecisionPublic], other: str) -> Beside:
    """Another run of an episode.

    Raises:
        Problem: 404, there is no such episode; 409, it is of another scene; 422, it is this one.
    """
    if other == id:
        raise invalid("beside", "this is the episode itself; name another run of it")
    parting = partings.of(session, id, other)
    theirs = episodes.decisions(session, other)
    episode = episodes.get(session, other)
    timeline = Timeline(episode, theirs, episodes.spans(session, other))
    if parting.decision is not None:
        timeline.parted = parting.time_b
    return Beside(
        episode,
        evaluations.get(session, episode.evaluation),
        timeline,
        parting,
        pairs(decisions, theirs, parting),
    )


def pairs(
    ours: Sequence[DecisionPublic], theirs: Sequence[DecisionPublic], parting: PartingPublic
) -> list[Pair]:
    """Decision by decision; where they part at different numbers, those stand beside each other."""
    here, there = parting.decision, parting.other_decision
    shift = 0 if here is None or there is None else there - here
    first: list[DecisionPublic | None] = [*[None] * max(shift, 0), *ours]
    second: list[DecisionPublic | None] = [*[None] * max(-shift, 0), *theirs]
    at = None if here is None else here + max(shift, 0)
    return [
        Pair(number - max(shift, 0), one, other, number == at)
        for number, (one, other) in enumerate(zip_longest(first, second))
    ]
