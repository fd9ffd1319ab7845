"""What a policy believed against what was true: how many stages it held to be done."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from sqlalchemy.orm import Session

from hide_tasks.contract import HiddenState, Value
from hide_tasks.stages import stages_done
from server import episodes
from server.schemas.episodes import BeliefCheck, BeliefsPublic, DecisionPublic, EpisodeDetail


def of(session: Session, id: str) -> BeliefsPublic:
    """An episode's beliefs and the truth.

    Raises:
        Problem: 404, there is no such episode.
    """
    return checked(episodes.get(session, id), episodes.decisions(session, id))


def checked(episode: EpisodeDetail, decisions: Sequence[DecisionPublic]) -> BeliefsPublic:
    """Every decision whose policy said how many stages it held to be done."""
    start = episode.start
    if start is None:
        return BeliefsPublic(stated=0, checked=0, right=0, decisions=[])
    moments = (
        Moment(one.decision, one.stage, one.hidden, one.belief.stage_count if one.belief else None)
        for one in decisions
    )
    found = list(judged(episode.task, episode.variation, (start.stage, start.hidden), moments))
    verdicts = [one.right for one in found if one.right is not None]
    right = sum(verdicts)
    return BeliefsPublic(stated=len(found), checked=len(verdicts), right=right, decisions=found)


class Moment(NamedTuple):
    """What a policy said at a decision, and what was true after it."""

    decision: int
    stage: str
    hidden: HiddenState
    said: int | None  # how many stages it held to be done


def judged(
    task: str,
    variation: Mapping[str, Value],
    start: tuple[str, HiddenState],
    moments: Iterable[Moment],
) -> Iterator[BeliefCheck]:
    """What was said at each decision against what was true before it."""
    stage, hidden = start
    for one in moments:
        if one.said is not None:
            true = stages_done(task, variation, stage, hidden)
            right = one.said in true if true else None
            yield BeliefCheck(
                decision=one.decision, believed=one.said, true=list(true), right=right
            )
        stage, hidden = one.stage, one.hidden
