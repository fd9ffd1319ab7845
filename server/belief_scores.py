"""How often a policy knows how far it is: the stages that it holds to be done, against the truth.

The truth is what `server.beliefs` finds; decisions at which it finds none do not count. What is
completed never changes, so what was counted of it is kept.
"""

import threading
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from hide_tasks.contract import Variation
from hide_tasks.statistics import wilson
from server.beliefs import Moment, judged
from server.models import Decision, Episode, HiddenSpan
from server.schemas.leaderboard import BeliefPublic

MOST = 20_000  # evaluations that are kept


class Heard(NamedTuple):
    """What was counted of an evaluation: sums over the episodes in which the policy says something.

    The squares tell how much episodes differ, for the decisions of one are no independent tries.
    """

    episodes: int = 0
    decisions: int = 0
    right: int = 0
    right_squares: int = 0
    products: int = 0
    decision_squares: int = 0

    def and_episode(self, right: int, decisions: int) -> "Heard":
        """With one more episode."""
        more = (1, decisions, right, right * right, right * decisions, decisions * decisions)
        return Heard(*(one + other for one, other in zip(self, more, strict=True)))


_kept: dict[str, Heard] = {}
_keeping = threading.Lock()


def of_completed(session: Session, evaluations: Sequence[str]) -> dict[str, Heard]:
    """What policies said in evaluations that are completed."""
    with _keeping:
        found = {id: _kept[id] for id in evaluations if id in _kept}
    new = {id: heard(session, id) for id in evaluations if id not in found}
    with _keeping:
        if len(_kept) + len(new) > MOST:
            _kept.clear()
        _kept.update(new)
    return found | new


def heard(session: Session, evaluation: str) -> Heard:
    """What a policy said in an evaluation, counted anew."""
    total, begun = Heard(), _begun(session, evaluation)
    for id, moments in groupby(_moments(session, list(begun)), key=itemgetter(0)):
        task, variation, start = begun[id]
        true = (start["stage"], start["hidden"])
        found = judged(task, variation, true, (moment for _, moment in moments))
        verdicts = [one.right for one in found if one.right is not None]
        if verdicts:
            total = total.and_episode(sum(verdicts), len(verdicts))
    return total


def _begun(session: Session, evaluation: str) -> dict[str, tuple[str, Variation, dict[str, Any]]]:
    """The episodes whose policy said at all how many stages it holds to be done."""
    says = select(HiddenSpan.episode_id).where(
        HiddenSpan.episode_id == Episode.id,
        HiddenSpan.kind == "belief",
        HiddenSpan.name == "stage_count",
    )
    wanted = select(Episode.id, Episode.task, Episode.variation, Episode.start)
    found = wanted.where(Episode.evaluation_id == evaluation, says.exists())
    return {id: (task, variation, start) for id, task, variation, start in session.execute(found)}


def _moments(session: Session, episodes: Sequence[str]) -> Iterator[tuple[str, Moment]]:
    """Every decision of some episodes; as models they would take ten times as long."""
    columns = (Decision.number, Decision.stage, Decision.hidden, Decision.belief)
    wanted = select(Decision.episode_id, *columns).where(Decision.episode_id.in_(episodes))
    order = wanted.order_by(Decision.episode_id, Decision.number)
    for id, number, stage, hidden, belief in session.execute(order):
        yield id, Moment(number, stage, hidden, (belief or {}).get("stage_count"))


def public(heard: Heard) -> BeliefPublic | None:
    """The accuracy with its interval; None where the policy says nothing."""
    if not heard.decisions:
        return None
    value = heard.right / heard.decisions
    tries = _independent(heard, value)
    low, high = wilson(value * tries, tries)  # type: ignore[arg-type]  # parts of tries as well
    return BeliefPublic(
        right=heard.right,
        decisions=heard.decisions,
        episodes=heard.episodes,
        value=value,
        low=low,
        high=high,
    )


def _independent(heard: Heard, value: float) -> float:
    """As how many independent decisions these count; where all are alike, as the episodes.

    Source: Korn and Graubard 1998, Survey Methodology 24:193; the variance is of a ratio.
    """
    apart = (
        heard.right_squares - 2 * value * heard.products + value * value * heard.decision_squares
    )
    if heard.episodes < 2 or apart <= 0:
        return heard.episodes
    variance = heard.episodes / (heard.episodes - 1) * apart / heard.decisions**2
    return min(heard.decisions, max(value * (1 - value) / variance, 1.0))


def told(session: Session, evaluations: Sequence[str]) -> Mapping[str, BeliefPublic | None]:
    """The accuracy in each of these completed evaluations."""
    return {id: public(one) for id, one in of_completed(session, evaluations).items()}
