"""How often a policy knows how far it is: the stages that it holds to be done, against the truth.

The truth before a decision is how often what the task calls for had changed until then, as it
stood at every decision. What is completed never changes, so what was counted of it is kept.
"""

import threading
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from sqlalchemy import String, cast, select
from sqlalchemy.orm import Session

from hide_tasks.statistics import wilson
from server.models import Episode, HiddenSpan
from server.schemas import BeliefPublic

MOST = 20_000  # evaluations that are kept
Lane = tuple[str, str]  # kind and name of spans
SAID: Lane = ("belief", "stage_count")
TRUE: Lane = ("stage", "stage")


class Span(NamedTuple):
    """A value from one decision to another, as JSON."""

    value: str
    first: int
    end: int  # the decision after its last one


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
    said = _spans(session, evaluation, SAID)
    true = _spans(session, evaluation, TRUE) if said else {}
    total = Heard()
    for episode, spans in said.items():
        decisions = sum(one.end - one.first for one in spans)
        if decisions:
            total = total.and_episode(right(spans, true[episode]), decisions)
    return total


def _spans(session: Session, evaluation: str, lane: Lane) -> dict[str, list[Span]]:
    """The spans of a lane, by episode."""
    of_evaluation = select(Episode.id).where(Episode.evaluation_id == evaluation)
    wanted = (
        select(
            HiddenSpan.episode_id,
            cast(HiddenSpan.value, String),  # its JSON as text is told apart without being read
            HiddenSpan.decision_from,
            HiddenSpan.decision_to,
        )
        .where(
            HiddenSpan.episode_id.in_(of_evaluation),
            HiddenSpan.kind == lane[0],
            HiddenSpan.name == lane[1],
        )
        .order_by(HiddenSpan.episode_id, HiddenSpan.number)
    )
    found: dict[str, list[Span]] = defaultdict(list)
    for episode, value, first, end in session.execute(wanted):
        found[episode].append(Span(value, first, end))
    return found


def right(said: Iterable[Span], true: Iterable[Span]) -> int:
    """Before how many decisions the number that is said is that of the changes until then."""
    changes = changed(true)
    return sum(_agreeing(one, changes) for one in said)


def changed(true: Iterable[Span]) -> list[int]:
    """The decisions in which the truth changed; one that changes back within it did not."""
    first, *others = true
    stood = {-1: first.value} | {span.first: span.value for span in others}
    return [at for (_, before), (at, now) in pairwise(stood.items()) if now != before]


def _agreeing(span: Span, changes: Sequence[int]) -> int:
    count = int(span.value)
    if not 0 <= count <= len(changes):
        return 0
    first = changes[count - 1] + 1 if count else 0
    end = changes[count] + 1 if count < len(changes) else span.end
    return max(0, min(span.end, end) - max(span.first, first))


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
    """As how many independent decisions these count: at least as many as there are episodes.

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
