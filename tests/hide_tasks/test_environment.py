"""The tasks as Gymnasium environments."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from hide_tasks import ALL_TASKS, load, suite
from hide_tasks.catalogue import suite_of
from hide_tasks.contract import InvalidAction
from hide_tasks.environment import HideEnvironment, as_row
from hide_tasks.episode import play
from hide_tasks.policies import Expert

TASK = "push_button_times"
ID = f"hide/{TASK}-v1"
MODES = ("keyframe", "joint_position", "ee_delta")


@pytest.fixture
def make():
    made = []

    def _make(name=ID, **kwargs):
        made.append(gymnasium.make(name, **kwargs))
        return made[-1]

    yield _make
    for one in made:
        one.close()


def still(environment):
    """A row of ee_delta that leaves everything as it is."""
    row = np.zeros(environment.action_space.shape)
    row[-2] = 1.0
    return row


@pytest.mark.parametrize("mode", MODES)
def test_gymnasiums_own_checker_finds_nothing_but_that_metres_are_not_normalised(make, mode):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(make(action_mode=mode).unwrapped)

    assert all("symmetric and normalized" in str(one.message) for one in said)


@pytest.mark.parametrize("name", ALL_TASKS)
def test_every_task_is_registered_and_declares_what_it_shows(make, name):
    environment = make(f"{suite_of(name)}/{name}-v1", split="val")
    observation, info = environment.reset(options={"index": 3})

    assert observation in environment.observation_space
    assert info["episode"] == f"{name}-val-003"
    assert set(load(name).cameras) < set(observation)


def test_the_experts_actions_end_where_they_end_in_an_evaluation(make):
    spec = suite.episode(TASK, "val", 2)
    result, records = play(spec, Expert())

    environment = make(split="val")
    environment.reset(options={"index": 2})
    rewards = []
    for record in records:
        _, reward, terminated, truncated, info = environment.step(as_row(record.action))
        rewards.append(reward)
        assert (info["stage"], info["hidden"]) == (record.stage, record.hidden)

    assert (terminated, truncated, sum(rewards)) == (True, False, 1.0)
    assert rewards.index(1.0) == [record.success for record in records].index(True)
    again = info["result"]
    assert (again["exact"], again["final_state_hash"]) == (True, result.final_state_hash)
    assert (again["scene_hash"], again["decisions"]) == (result.scene_hash, result.decisions)


def test_a_seed_names_an_episode_and_the_next_reset_draws_another(make):
    environment = make()
    names = [environment.reset(seed=7)[1]["episode"]]
    names += [environment.reset()[1]["episode"] for _ in range(3)]

    again = [environment.reset(seed=7)[1]["episode"], environment.reset()[1]["episode"]]
    assert again == names[:2]
    assert len(set(names)) == 4


def test_the_budget_spent_in_vain_truncates_and_asks_for_a_reset(make):
    environment = make(action_mode="ee_delta", split="val")
    environment.reset(seed=1)
    for _ in range(suite.row_budget(TASK)):
        *_, reward, terminated, truncated, info = environment.step(still(environment))

    assert (reward, terminated, truncated) == (0.0, False, True)
    assert "rows of dense actions is spent" in info["result"]["detail"]
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        environment.unwrapped.step(still(environment))


def test_stop_ends_the_episode(make):
    environment = make(action_mode="joint_position")
    observation, _ = environment.reset(seed=1)
    row = np.array([*observation["joint_positions"], 1.0, 1.0])

    *_, terminated, truncated, info = environment.step(row)

    assert (terminated, truncated) == (True, False)
    assert info["result"]["failure"] == "undercount"


def test_nothing_hidden_is_in_an_observation(make):
    environment = make(split="test")
    one, info = environment.reset(options={"index": 0})
    environment.reset(options={"index": 1})
    again, _ = environment.reset(options={"index": 0})

    known = {"gripper_pose", "gripper_opening", "joint_positions", "instruction"}
    assert set(one) == known | set(load(TASK).cameras)
    assert all(
        set(one[name]) == {"rgb", "depth", "intrinsics", "camera_to_world"}
        for name in load(TASK).cameras
    )
    np.testing.assert_array_equal(one["front"]["rgb"], again["front"]["rgb"])
    assert info["hidden"] == {"presses_done": 0}


def test_a_picture_shows_the_scene_from_the_front(make):
    environment = make(render_mode="rgb_array")
    observation, _ = environment.reset(seed=4)
    picture = environment.render()

    assert picture.shape == (512, 512, 3)
    small = picture.reshape(128, 4, 128, 4, 3).mean(axis=(1, 3))
    assert np.abs(small - observation["front"]["rgb"]).mean() < 6


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"split": "exam"}, "No split 'exam'. There are train, val"),
        ({"action_mode": "torque"}, "There are keyframe, joint_position, ee_delta"),
        ({"rules": "none"}, "There are hide, parity"),
        ({"render_mode": "human"}, "There are None, rgb_array"),
    ],
)
def test_an_environment_that_cannot_be_is_told_what_there_is(kwargs, message):
    with pytest.raises(ValueError, match=message):
        HideEnvironment(TASK, **kwargs)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"variation": 1}, "No option variation"),
        ({"index": 25}, "0 to 24"),
        ({"index": 2.7}, "index is 2.7; expected a whole number"),
        ({"index": True}, "index is True"),
        ({"index": "3"}, "index is '3'"),
        ({3: 4}, "No option 3"),
        ([3], "expected a dictionary"),
    ],
)
def test_an_episode_that_there_is_not_is_refused(make, options, message):
    environment = make(split="val")
    environment.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        environment.reset(options=options)
    environment.step(as_row(_withdrawn()))  # the episode before goes on


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (np.zeros(3), r"shape \(3,\); expected \(10,\)"),
        (None, "finite"),
        ("left", "no row of numbers: 'left'"),
    ],
)
def test_an_action_that_is_none_is_refused_and_nothing_moves(make, row, message):
    environment = make().unwrapped
    environment.reset(seed=0)
    row = np.full(environment.action_space.shape, np.nan) if row is None else row

    with pytest.raises(InvalidAction, match=message):
        environment.step(row)
    assert environment.step(as_row(_withdrawn()))[-1]["stage"] == "reach"


def _withdrawn():
    from hide_tasks.contract import Keyframe

    return Keyframe(position=(0.25, 0.0, 1.2), quaternion=(1.0, 0.0, 0.0, 0.0))
