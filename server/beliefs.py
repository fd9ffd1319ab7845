"""What a policy believed against what was true: how many stages it held to be done."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sqlalchemy.orm import Session

from hide_tasks.contract import HiddenState, Start, Value
from hide_tasks.stages import stages_done
from server import episodes
from server.schemas import BeliefCheck, BeliefsPublic, DecisionPublic, EpisodeDetail


def of(session: Session, id: str) -> BeliefsPublic:
    """An episode's beliefs and the truth.

    Raises:
        Problem: 404, there is no such episode.
    """
    return checked(episodes.get(session, id), episodes.decisions(session, id))


class Begun(NamedTuple):
    """What of an episode says what is true in it."""

    task: str
    variation: Mapping[str, Value]
    start: Start | None


def checked(episode: EpisodeDetail | Begun, decisions: Sequence[DecisionPublic]) -> BeliefsPublic:
    """Every decision whose policy said how many stages it held to be done."""
    if episode.start is None:
        return BeliefsPublic(stated=0, checked=0, right=0, decisions=[])
    before = [(one.stage, one.hidden) for one in decisions]
    before.insert(0, (episode.start.stage, episode.start.hidden))
    found = [
        _check(episode, one, *known)
        for known, one in zip(before, decisions, strict=False)
        if one.belief is not None and one.belief.stage_count is not None
    ]
    verdicts = [one.right for one in found if one.right is not None]
    right = sum(verdicts)
    return BeliefsPublic(stated=len(found), checked=len(verdicts), right=right, decisions=found)


def _check(
    episode: EpisodeDetail | Begun, one: DecisionPublic, stage: str, hidden: HiddenState
) -> BeliefCheck:
    assert one.belief is not None and one.belief.stage_count is not None
    believed = one.belief.stage_count
    true = stages_done(episode.task, episode.variation, stage, hidden)
    right = believed in true if true else None
    return BeliefCheck(decision=one.decision, believed=believed, true=list(true), right=right)
