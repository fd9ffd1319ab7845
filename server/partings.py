"""Where two runs of the same episode part: the first decision that differs, and in what.

Both begin in the same scene, so up to that decision they saw and did the same, nearly.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest

import numpy as np
from sqlalchemy import Text, cast, func, select
from sqlalchemy.orm import Session, aliased

from hide_tasks.contract import DecisionRecord, HiddenState, Keyframe
from server import episodes
from server.models import Episode, Evaluation, PolicyVersion
from server.problems import Problem
from server.schemas.episodes import DecisionPublic, PartingPublic, RunPublic
from server.states import EvaluationState

FAR = 0.03  # m; the tip's targets are the same below: a trained policy is off by a centimetre
TURNED = math.radians(30)
MOST_RUNS = 200  # evaluations that are looked through for another run of an episode

Runs = Sequence[DecisionPublic]


def between(
    a: Runs, b: Runs, other: str | None = None, *, called: str = "the other"
) -> PartingPublic:
    """Where two runs of the same episode part.

    Keyframes are compared one by one: where they lead, the fingers, and what became of them. A
    dense policy's chunks have no counterpart, so there only what became of the world counts.

    Args:
        other: id of the episode that `b` is.
        called: what the sentence calls whoever played `b`.
    """
    dense = any(one.action.kind in ("joint_position", "ee_delta") for one in (*a, *b))
    words = _Words(called)
    found = words.first_state(a, b) if dense else words.first_decision(a, b)
    if found is None:
        return PartingPublic(decision=None, why="Both did the same.", other=other)
    number, counterpart, why = found
    return PartingPublic(
        decision=number,
        other_decision=counterpart,
        time_a=_chosen(a, number),
        time_b=_chosen(b, counterpart),
        why=why,
        other=other,
    )


def of(session: Session, id: str, other: str | None) -> PartingPublic:
    """Where an episode parts from another run of the same, or from the expert's.

    Raises:
        Problem: 404, there is no such episode, or no run of the expert's; 409, they are of
            different scenes.
    """
    one = episodes.row(session, id)
    if other is None:
        if found := from_expert(session, [id]).get(id):
            return found
        raise Problem(404, "not_found", f"The expert has not played the scene of {id} here.")
    second = episodes.row(session, other)
    if one.scene_hash is None or one.scene_hash != second.scene_hash:
        raise Problem(409, "not_comparable", f"{id} and {other} are not of the same scene.")
    played = episodes.decisions_of(session, [id, other])
    return between(played.get(id, []), played.get(other, []), other)


def from_expert(session: Session, ids: Sequence[str]) -> dict[str, PartingPublic]:
    """Where episodes part from the expert's run of the same; left out if it played none."""
    pairs = _experts(session, ids)
    played = episodes.decisions_of(session, {*pairs, *pairs.values()})
    return {
        id: between(played.get(id, []), played.get(expert, []), expert, called="the expert")
        for id, expert in pairs.items()
    }


def runs_of_same(session: Session, id: str) -> list[RunPublic]:
    """Final runs of the same scene in other evaluations: the newest of each policy version.

    Built-in policies come first, then the newest.

    Raises:
        Problem: 404, there is no such episode.
    """
    one = episodes.row(session, id)
    if one.scene_hash is None:
        return []
    newest = (
        select(func.max(Evaluation.id))
        .where(Evaluation.split == one.split, Evaluation.id != one.evaluation_id)
        .where(Evaluation.state == EvaluationState.COMPLETED, Evaluation.episodes > one.index)
        .where(cast(Evaluation.tasks, Text).contains(f'"{one.task}"', autoescape=True))
        .group_by(Evaluation.policy_version_id)
        .order_by(func.max(Evaluation.id).desc())
        .limit(MOST_RUNS)
    )
    found = (
        select(Episode)
        .where(Episode.evaluation_id.in_(session.scalars(newest).all()))
        .where(Episode.task == one.task, Episode.index == one.index)
        .where(Episode.scene_hash == one.scene_hash)
    )
    runs = [_run(other) for other in session.scalars(found)]
    runs.sort(key=lambda run: run.evaluation, reverse=True)
    return sorted(runs, key=lambda run: not run.reference)


def _run(one: Episode) -> RunPublic:
    version = one.evaluation.policy_version
    return RunPublic(
        episode=one.id,
        evaluation=one.evaluation_id,
        policy=version.policy.name,
        version=version.number,
        reference=version.reference,
        success=bool(one.success),
        exact=bool(one.exact),
        failure=one.failure,
        decisions=one.decisions or 0,
    )


def _experts(session: Session, ids: Sequence[str]) -> dict[str, str]:
    """The expert's newest run of each episode's scene."""
    by_expert = (
        select(Evaluation.id)
        .join(PolicyVersion)
        .where(
            Evaluation.state == EvaluationState.COMPLETED,
            PolicyVersion.reference,
            PolicyVersion.spec["name"].as_string() == "expert",
        )
        .order_by(Evaluation.id.desc())
        .limit(MOST_RUNS)
    )
    one, expert = aliased(Episode), aliased(Episode)
    same = (
        (expert.task == one.task)
        & (expert.index == one.index)
        & (expert.split == one.split)
        & (expert.scene_hash == one.scene_hash)
        & (expert.evaluation_id != one.evaluation_id)
    )
    rows = session.execute(
        select(one.id, expert.id)
        .join(expert, same)
        .where(one.id.in_(ids), expert.evaluation_id.in_(session.scalars(by_expert).all()))
        .order_by(expert.evaluation_id)
    )
    return {row[0]: row[1] for row in rows}


# --- what differs first ---


class _Words:
    """Says what differs between this run and another's."""

    def __init__(self, called: str):
        self.other = called

    def first_decision(self, a: Runs, b: Runs) -> tuple[int, int, str] | None:
        """The first decision that differs, and in what."""
        for number, (one, other) in enumerate(zip_longest(a, b)):
            if one is None or other is None:
                who = "It" if one is None else self.other.capitalize()
                return number, number, f"{who} ended after {number} decisions; here they part."
            if found := list(self._differences(one, other)):
                after = next(self._states(one, other), found[0])
                return number, number, " ".join(dict.fromkeys((found[0], after)))
        return None

    def first_state(self, a: Runs, b: Runs) -> tuple[int, int, str] | None:
        """The first change of the stage or the hidden state that differs."""
        for one, other in zip_longest(_changes(a), _changes(b)):
            if one is None or other is None:
                late = one or other
                assert late is not None, "zip_longest ends when both do"
                who = self.other if one is None else "it"
                return late.decision, late.decision, f"Only {who} came to “{late.stage}”."
            if why := next(self._states(one, other), None):
                return one.decision, other.decision, why
        return None

    def _differences(self, one: DecisionRecord, other: DecisionRecord) -> Iterator[str]:
        first, second = one.action, other.action
        if isinstance(first, Keyframe) and isinstance(second, Keyframe):
            yield from self._poses(first, second)
        elif first.kind != second.kind:
            yield f"It chose {_named(first.kind)}, {self.other} {_named(second.kind)}."
        if first.stop != second.stop:
            stopped, went_on = ("It", self.other) if first.stop else (self.other, "it")
            yield f"{stopped.capitalize()} stopped, {went_on} went on."
        if one.outcome != other.outcome:
            yield f"Its motion: {_named(one.outcome)}; {self.other}’s: {_named(other.outcome)}."
        yield from self._states(one, other)

    def _poses(self, one: Keyframe, other: Keyframe) -> Iterator[str]:
        away = math.dist(one.position, other.position)
        if away > FAR:
            yield f"It went {100 * away:.0f} cm away from where {self.other} went."
        angle = _angle(one, other)
        if angle > TURNED:
            yield f"It turned the gripper {math.degrees(angle):.0f}° away from {self.other}’s."
        fingers = ["open" if each.opening >= 0.5 else "closed" for each in (one, other)]
        if fingers[0] != fingers[1]:
            yield f"Its fingers were {fingers[0]}, {self.other}’s {fingers[1]}."

    def _states(self, one: DecisionRecord, other: DecisionRecord) -> Iterator[str]:
        for name in one.hidden:
            here, there = one.hidden[name], other.hidden.get(name)
            if here != there:
                said = f"{_named(name)} was {_said(here)}, with {self.other} {_said(there)}"
                yield f"After it {said}."
        if one.stage != other.stage:
            told = f"“{one.stage}”, with {self.other} for “{other.stage}”"
            yield f"After it the task called for {told}."


def _angle(one: Keyframe, other: Keyframe) -> float:
    """Between two orientations, in radians; a gripper turned by half looks and acts the same."""
    (x, y, z, w), (a, b, c, d) = one.pose[3:], other.pose[3:]
    about_z = np.array([y, -x, w, -z])  # q * (0, 0, 1, 0)
    as_is = abs(np.dot((x, y, z, w), (a, b, c, d)))
    flipped = abs(np.dot(about_z, (a, b, c, d)))
    return float(2 * math.acos(min(1.0, max(as_is, flipped))))


def _changes(run: Iterable[DecisionPublic]) -> Iterator[DecisionPublic]:
    """The decisions that changed the stage or the hidden state."""
    known: tuple[str, HiddenState] | None = None
    for one in run:
        if (one.stage, one.hidden) != known:
            yield one
        known = (one.stage, one.hidden)


def _chosen(run: Runs, number: int) -> float:
    """When a decision was chosen: at the end of the one before, in simulated seconds."""
    return run[min(number, len(run)) - 1].time if number and run else 0.0


def _named(name: str) -> str:
    return str(name).replace("_", " ")


def _said(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
