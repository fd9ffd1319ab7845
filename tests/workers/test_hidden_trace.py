"""The hidden state as a trace tells it, beside what the episode itself says."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import (
    MAX_CHUNK,
    Action,
    Belief,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    JointPosition,
    Policy,
    Stop,
)
from hide_tasks.episode import play
from hide_tasks.policies import Expert, Replay
from workers.hidden_trace import HiddenTrace
from workers.protocol import HiddenChange

SPEC = suite.episode("push_button_times", "test", 0)


class Arm:
    """A witness of the expert that writes down its joints, 20 times a second."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    def watching(self, world: World) -> None:
        self.world = world

    def begin(self, *_: Any) -> None:
        pass

    def frame(self, time: float, poses: Any) -> None:
        if time:
            joints = self.world.robot.joints.tolist()
            self.rows.append((*joints, float(self.world.robot.opening >= 0.5)))

    def decided(self, *_: Any) -> None:
        pass

    def end(self, *_: Any) -> None:
        pass


class ShownExpert(Expert):
    """The expert; its world is shown to an Arm."""

    def __init__(self, arm: Arm):
        self.arm = arm

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        super().bind(world, spec)
        self.arm.watching(world)


class Believes(Expert):
    def belief(self) -> Belief:
        return Belief(stage_count=1)


def traced(
    spec: EpisodeSpec, policy: Policy
) -> tuple[HiddenTrace, EpisodeResult, list[DecisionRecord]]:
    trace = HiddenTrace()
    return trace, *play(spec, trace.watching(policy), witnesses=[trace])


def dense(spec: EpisodeSpec) -> list[Action]:
    """The expert's motions as joint targets, ten seconds an action."""
    arm = Arm()
    play(spec, ShownExpert(arm), witnesses=[arm])
    chunks = [arm.rows[i : i + MAX_CHUNK] for i in range(0, len(arm.rows), MAX_CHUNK)]
    return [*(JointPosition(chunk=tuple(chunk)) for chunk in chunks), Stop()]


def rows(changes: Sequence[HiddenChange]) -> list[tuple[str, dict]]:
    return [(change.stage, change.hidden) for change in changes]


@pytest.mark.parametrize("task", ["push_button_times", "search_drawer"])
def test_the_rows_agree_with_the_decisions(task: str) -> None:
    trace, _, records = traced(suite.episode(task, "test", 0), Expert())

    first, *_ = changes = trace.changes
    assert (first.time, first.decision) == (0.0, 0)
    assert (first.stage, first.hidden) == (trace.start.stage, trace.start.hidden)
    assert [change.time for change in changes] == sorted(change.time for change in changes)
    assert all(one != two for one, two in zip(rows(changes), rows(changes)[1:], strict=False))
    for record in records:
        until_then = [change for change in changes if change.decision <= record.decision]
        assert rows(until_then)[-1] == (record.stage, record.hidden)
        assert until_then[-1].time <= record.time


def test_every_change_within_a_dense_action_is_a_row() -> None:
    by_keyframes, _, _ = traced(SPEC, Expert())
    actions = dense(SPEC)

    trace, result, records = traced(SPEC, Replay(actions))

    assert result.success
    assert len(records) < len(trace.changes)
    assert rows(trace.changes) == rows(by_keyframes.changes)
    within = [change for change in trace.changes[1:] if change.time < records[change.decision].time]
    assert len(within) >= SPEC.variation["count"]
    for event in (event for record in records for event in record.events):
        assert any(0 <= change.time - event.time <= 0.051 for change in trace.changes)


def test_a_trace_does_not_alter_the_episode() -> None:
    bare, plain = play(SPEC, Expert())
    _, result, records = traced(SPEC, Expert())

    assert result.final_state_hash == bare.final_state_hash
    assert records == plain


def test_a_policy_keeps_its_belief_and_gets_none() -> None:
    believes = traced(SPEC, Believes())[2]
    silent = traced(SPEC, Expert())[2]

    assert {record.belief for record in believes} == {Belief(stage_count=1)}
    assert {record.belief for record in silent} == {None}


def test_the_thumbnail_shows_the_front_camera() -> None:
    trace, _, _ = traced(SPEC, Replay([]))

    with World(suite.build(SPEC)) as world:
        seen = world.observe().views["front"].rgb
    with Image.open(io.BytesIO(base64.b64decode(trace.thumbnail))) as picture:
        assert (picture.format, picture.size) == ("JPEG", seen.shape[1::-1])
        assert np.abs(np.asarray(picture, float) - seen).mean() < 5
