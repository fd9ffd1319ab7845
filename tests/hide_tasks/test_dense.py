"""The expert in the dense action spaces: its motion, and that replaying it is exact."""

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.bullet.executor import JOINT_STEP
from hide_tasks.bullet.frames import tip_pose
from hide_tasks.contract import Failure, Stop
from hide_tasks.dense import CHUNK, DenseError, DenseExpert, Motion, motion
from hide_tasks.episode import play
from hide_tasks.policies import Replay, make

SPEC = next(s for s in suite.episodes("push_button_times", "val") if s.variation["count"] == 2)
SLIDES = suite.episode("search_drawer", "val", 0)  # the item slides as its drawer is pulled
DEEP = suite.episodes("search_drawer", "val", 3)[1:]
MODES = ("joint_position", "ee_delta")


@pytest.fixture(scope="module")
def twice() -> Motion:
    return motion(SPEC)


def test_a_row_is_an_eighth_and_a_seventh_number_of_opening(twice):
    joints, deltas = (np.array(twice.rows(mode)) for mode in MODES)

    assert joints.shape == (len(twice), 8)
    assert deltas.shape == (len(twice), 7)
    np.testing.assert_array_equal(joints[:, -1], deltas[:, -1])
    assert set(joints[:, -1]) == {0.0, 1.0}


def test_every_number_is_one_of_single_precision(twice):
    for mode in MODES:
        rows = np.array(twice.rows(mode))
        np.testing.assert_array_equal(rows, rows.astype(np.float32).astype(np.float64))


def test_the_joints_never_jump_further_than_a_row_may_move_them(twice):
    assert np.abs(np.diff(twice.joints, axis=0)).max() < JOINT_STEP


def test_the_steps_of_the_tip_lead_where_the_joints_lead(twice):
    present: list[np.ndarray] = []

    motion(SPEC, lambda world, _: present.append(world.robot.joints))

    for joints, goal, delta in zip(present, twice.joints, twice.deltas, strict=True):
        here, there = (tip_pose(q)[:3, 3] for q in (joints, goal.astype(float)))
        np.testing.assert_allclose(there - here, delta[:3], atol=1e-6)


def test_chunks_hold_every_row_once_and_in_order(twice):
    for mode in MODES:
        chunks = twice.chunks(mode)
        assert [len(chunk.chunk) for chunk in chunks[:-1]] == [CHUNK] * (len(chunks) - 1)
        assert [row for chunk in chunks for row in chunk.chunk] == twice.rows(mode)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [1, CHUNK, 50])
def test_replaying_the_motion_is_exact_in_chunks_of_any_size(twice, mode, size):
    result, _ = play(SPEC, Replay(twice.chunks(mode, size)))

    assert result.exact


@pytest.mark.parametrize("mode", MODES)
def test_what_moved_on_the_way_is_taken_where_it_is(mode):
    result, records = play(SLIDES, DenseExpert(mode))

    assert result.exact
    assert {record.action.kind for record in records} <= {mode, "stop"}


def test_the_motion_of_an_episode_is_the_same_again(twice):
    again = motion(SPEC)

    for name in ("joints", "deltas", "openings"):
        np.testing.assert_array_equal(getattr(again, name), getattr(twice, name))


def test_a_replay_ends_where_the_other_ends(twice):
    results = [play(SPEC, Replay(twice.chunks("joint_position")))[0] for _ in range(2)]

    assert results[0].final_state_hash == results[1].final_state_hash


def test_the_dense_expert_stops_when_its_motion_is_done(twice):
    expert = DenseExpert("joint_position", size=200)
    expert.bind(None, SPEC)
    expert.reset("", 0)

    answers = [expert.act(None) for _ in range(-(-len(twice) // 200) + 1)]

    assert isinstance(answers[-1], Stop)
    assert not any(isinstance(answer, Stop) for answer in answers[:-1])


def test_the_dense_expert_of_a_mode_goes_by_a_name():
    made = {mode: make(f"expert-{mode.replace('_', '-')}") for mode in MODES}

    assert {mode: policy.mode for mode, policy in made.items()} == {mode: mode for mode in MODES}


def test_an_episode_without_a_motion_is_the_dense_experts_failure(monkeypatch):
    monkeypatch.setattr("hide_tasks.bullet.planner.solutions", lambda _: [])

    result, _ = play(SPEC, DenseExpert("ee_delta"))

    assert result.failure is Failure.POLICY_ERROR
    assert "has no path" in result.detail


def test_a_keyframe_that_no_plan_reaches_is_named(monkeypatch):
    monkeypatch.setattr("hide_tasks.bullet.planner.solutions", lambda _: [])

    with pytest.raises(DenseError, match=r"keyframe of reach has no path: out_of_reach"):
        motion(SPEC)


def test_a_row_moves_the_arm_evenly_so_that_nothing_is_jerked_away():
    """What lies in a drawer slides when the drawer is pulled in twenty jerks a second."""
    results = [play(spec, DenseExpert("joint_position"))[0] for spec in DEEP]

    assert [result.exact for result in results] == [True, True]
