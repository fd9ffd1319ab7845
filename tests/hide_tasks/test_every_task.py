"""What is true of every task: one test each, over all of them. A new task needs no new test."""

import re
from collections import Counter

import numpy as np
import pytest

from hide_tasks import ALL_TASKS, load, suite
from hide_tasks.amnesiac import options
from hide_tasks.contract import CAMERAS, IMAGE_SIZE
from hide_tasks.episode import play
from hide_tasks.gates import IDLE_LIMIT, idle, solved
from hide_tasks.likeness import alike, likeness
from hide_tasks.machine import fingerprint
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import library, points, same_action
from hide_tasks.sources import sources_hash
from hide_tasks.task import Grid

every_task = pytest.mark.parametrize("name", ALL_TASKS)
SAMPLE = (("test", 0), ("val", 7), ("train", 61))


@every_task
def test_every_slot_of_an_instruction_is_filled(name):
    task = load(name)

    slots = set(task.words(next(iter(Grid(**task.axes())))))
    for template in task.instructions:
        assert set(re.findall(r"{(\w+)}", template)) <= slots


@every_task
@pytest.mark.parametrize("split", suite.SPLITS)
def test_every_axis_is_balanced_within_a_split(name, split):
    variations = [spec.variation for spec in suite.episodes(name, split)]

    for axis, values in load(name).axes().items():
        counts = Counter(variation[axis] for variation in variations)
        assert len(counts) == min(len(values), len(variations))
        assert max(counts.values()) - min(counts.values()) <= 1


@every_task
def test_the_committed_gates_belong_to_these_sources(name):
    committed = suite.committed(name)

    assert committed["sources"] == sources_hash(name), "run `make gates`"
    assert max(committed["idle_success"].values()) <= IDLE_LIMIT


@every_task
@pytest.mark.parametrize("split", suite.SPLITS)
def test_every_scene_has_the_committed_hash(name, split):
    committed = suite.committed(name)["splits"][split]["scene_hashes"]
    present = [suite.scene_hash(spec)[:16] for spec in suite.episodes(name, split)]

    assert present == committed
    assert len(set(present)) == len(present)


@every_task
@pytest.mark.parametrize(("split", "index"), SAMPLE)
def test_the_expert_succeeds_exactly_and_a_replay_ends_in_the_same_state(name, split, index):
    spec = suite.episode(name, split, index)
    result, records = play(spec, Expert())
    again, _ = play(spec, Replay([record.action for record in records]))

    assert solved(result, records), result.failure
    assert (again.exact, again.final_state_hash) == (True, result.final_state_hash)
    if suite.committed(name)["machine"] == fingerprint():
        committed = suite.committed(name)["splits"][split]["final_state_hashes"][index]
        assert result.final_state_hash[:16] == committed


@every_task
def test_scripts_have_the_papers_numbers_of_keyframes(name):
    task = load(name)
    axes = {axis: values for axis, values in task.axes().items() if axis not in task.looks}
    spec = suite.episode(name, "train", 0)
    counts = set()
    for variation in Grid(**axes):
        twin = spec.twin(variation)
        result, _ = play(twin, Expert())
        assert result.exact, (twin.variation, result.failure)
        counts.add(result.decisions)

    assert counts
    assert counts <= task.keyframes


@every_task
def test_doing_nothing_or_anything_does_not_succeed(name):
    assert idle(suite.episode(name, "val", 3)) == {"noop": False, "random": False}


@every_task
def test_a_twin_stands_in_the_same_scene(name):
    spec = suite.episode(name, "train", 5)
    one = suite.build(spec)
    axes = {axis: v for axis, v in load(name).axes().items() if axis not in load(name).looks}
    twin = suite.build(spec.twin({axis: values[-1] for axis, values in axes.items()}))

    for a, b in zip(one.layout.assets, twin.layout.assets, strict=True):
        if a.links[0].mass == 0:  # what is loose may be what is hidden
            assert np.array_equal(a.at, b.at)


@every_task
def test_declared_pairs_look_the_same_and_call_for_different_actions(name):
    spec = suite.episode(name, "val", 1)
    known = {}
    for alias in suite.build(spec).aliases():
        first, second = (
            known.setdefault(str(m.twin), points(spec.twin(m.twin)))[m.keyframes]
            for m in (alias.first, alias.second)
        )
        distance = likeness(first.observation, second.observation)
        assert distance.alike, (alias.why, distance)
        assert first.hidden != second.hidden
        assert not same_action(first.next, second.next)


@every_task
def test_an_observation_holds_nothing_of_the_hidden_state(name):
    """Field by field and number by number, an alias moment is the same for every history."""
    spec = suite.episode(name, "val", 1)
    found = library(spec)
    alias = next((p for p in found if len(options(found, p.observation)) > 1), None)
    if alias is None:
        assert not suite.build(spec).aliases()
        return
    same = [p for p in found if alike(p.observation, alias.observation)]

    assert len({str(p.hidden) for p in same}) > 1
    assert set(vars(alias.observation)) == {
        "views",
        "gripper_pose",
        "gripper_opening",
        "joint_positions",
        "instruction",
    }
    assert set(alias.observation.views) == set(CAMERAS)
    for point in same:
        one, two = alias.observation, point.observation
        assert one.instruction == two.instruction
        assert np.abs(one.joint_positions - two.joint_positions).max() < 1e-5
        assert np.abs(one.gripper_pose - two.gripper_pose).max() < 1e-5
        assert abs(one.gripper_opening - two.gripper_opening) < 1e-3
        for camera in CAMERAS:
            a, b = one.views[camera], two.views[camera]
            assert set(vars(a)) == {"rgb", "depth", "intrinsics", "camera_to_world"}
            assert a.rgb.shape == (IMAGE_SIZE, IMAGE_SIZE, 3)
            assert a.depth.shape == (IMAGE_SIZE, IMAGE_SIZE)
            assert np.abs(a.camera_to_world - b.camera_to_world).max() < 1e-5
            assert (a.rgb != b.rgb).any(axis=-1).mean() < 0.001
            assert (np.abs(a.depth - b.depth) > 1e-4).mean() < 0.001


@every_task
def test_a_policy_without_memory_has_a_choice_where_something_is_hidden(name):
    spec = suite.episode(name, "val", 1)
    found = library(spec)

    choice = any(len(options(found, point.observation)) > 1 for point in found)
    assert choice == bool(suite.build(spec).aliases())
