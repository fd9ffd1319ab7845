"""What is true of every task: one test each, over all of them. A new task needs no new test."""

import re
from collections import Counter
from itertools import product

import numpy as np
import pytest

from hide_tasks import ALL_TASKS, load, suite
from hide_tasks.amnesiac import options
from hide_tasks.certificate import compared
from hide_tasks.certificates import committed
from hide_tasks.contract import IMAGE_SIZE
from hide_tasks.episode import play
from hide_tasks.gates import IDLE_LIMIT, idle, solved
from hide_tasks.likeness import alike, likeness
from hide_tasks.machine import fingerprint
from hide_tasks.policies import Expert, Replay
from hide_tasks.script import library, twins
from hide_tasks.sources import sources_hash
from hide_tasks.task import Grid


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in ALL_TASKS],
)
def name(request):
    """A task's; its tests follow each other in one process."""
    return request.param


@pytest.fixture(scope="module")
def scripts(name):
    """An episode's spec and the script points of it and of its twins."""
    spec = suite.episode(name, "train", 0)
    return spec, library(spec)


def test_every_slot_of_an_instruction_is_filled(name):
    task = load(name)

    slots = set(task.words(next(iter(Grid(**task.axes())))))
    for template in task.instructions:
        assert set(re.findall(r"{(\w+)}", template)) <= slots


@pytest.mark.parametrize("split", suite.SPLITS)
def test_every_axis_is_balanced_within_a_split(name, split):
    variations = [spec.variation for spec in suite.episodes(name, split)]

    for axis, values in load(name).axes().items():
        counts = Counter(variation[axis] for variation in variations)
        assert len(counts) == min(len(values), len(variations))
        assert max(counts.values()) - min(counts.values()) <= 1


def test_the_committed_gates_belong_to_these_sources(name):
    gates = suite.committed(name)

    assert gates["sources"] == sources_hash(name), "run `make gates`"
    assert max(gates["idle_success"].values()) <= IDLE_LIMIT


@pytest.mark.parametrize("split", suite.SPLITS)
def test_every_scene_has_the_committed_hash(name, split):
    recorded = suite.committed(name)["splits"][split]["scene_hashes"]
    present = [suite.scene_hash(spec)[:16] for spec in suite.episodes(name, split)]

    assert present == recorded
    assert len(set(present)) == len(present)


def test_the_expert_succeeds_exactly_and_a_replay_ends_in_the_same_state(name):
    spec = suite.episode(name, "test", 0)
    result, records = play(spec, Expert())
    again, _ = play(spec, Replay([record.action for record in records]))

    assert solved(result, records), result.failure
    assert (again.exact, again.final_state_hash) == (True, result.final_state_hash)
    if suite.committed(name)["machine"] == fingerprint():
        recorded = suite.committed(name)["splits"]["test"]["final_state_hashes"][0]
        assert result.final_state_hash[:16] == recorded


def test_every_variation_was_solved_in_one_of_the_papers_numbers_of_keyframes(name):
    task, splits = load(name), suite.committed(name)["splits"]
    told = [axis for axis in task.axes() if axis not in task.looks]
    solved = set()
    for split in suite.SPLITS:
        keyframes = splits[split]["keyframes"]
        assert set(keyframes) <= task.keyframes
        for spec, _ in zip(suite.episodes(name, split), keyframes, strict=True):
            solved.add(tuple(spec.variation[axis] for axis in told))

    assert solved == set(product(*(task.axes()[axis] for axis in told)))


def test_doing_nothing_or_anything_does_not_succeed(name):
    assert idle(suite.episode(name, "val", 3)) == {"noop": False, "random": False}


def test_a_twin_stands_in_the_same_scene(name):
    spec = suite.episode(name, "train", 5)
    one = suite.build(spec)
    axes = {axis: v for axis, v in load(name).axes().items() if axis not in load(name).looks}
    twin = suite.build(spec.twin({axis: values[-1] for axis, values in axes.items()}))

    for a, b in zip(one.layout.assets, twin.layout.assets, strict=True):
        if a.links[0].mass == 0:  # what is loose may be what is hidden
            assert np.array_equal(a.at, b.at)


def test_declared_pairs_measured_anew_are_those_of_the_certificate(scripts):
    spec, found = scripts
    known = {alias["why"]: alias for alias in committed(spec.task)["aliases"]}
    numbers = {str(twin): number for number, twin in enumerate(twins(spec))}

    def at(moment):
        number = numbers[str({**spec.variation, **moment.twin})]
        return next(p for p in found if (p.script, p.keyframes) == (number, moment.keyframes))

    for alias in suite.build(spec).aliases():
        pair = compared(alias.why, at(alias.first), at(alias.second))
        assert pair["verified"], pair
        shown = known[alias.why]
        assert (pair["hidden"], pair["next"]) == (shown["hidden"], shown["next"])
        views = load(spec.task).cameras
        assert all(pair["pixels"][view] <= shown["pixels"][view] + 1e-4 for view in views)


def test_an_observation_holds_nothing_of_the_hidden_state(scripts):
    """Field by field and number by number, an alias moment is the same for every history."""
    spec, found = scripts
    if not committed(spec.task)["probe"]["blind"]:  # a picture may tell it, says the certificate
        assert committed(spec.task)["verdict"] == "weak"
        return
    alias = next(p for p in found if len(options(found, p.observation)) > 1)
    same = [p for p in found if alike(p.observation, alias.observation)]

    assert len({str(p.hidden) for p in same}) > 1
    assert set(vars(alias.observation)) == {
        "views",
        "gripper_pose",
        "gripper_opening",
        "joint_positions",
        "instruction",
    }
    cameras = load(spec.task).cameras
    assert tuple(alias.observation.views) == cameras
    for point in same:
        one, two = alias.observation, point.observation
        assert one.instruction == two.instruction
        assert np.abs(one.joint_positions - two.joint_positions).max() < 1e-5
        assert np.abs(one.gripper_pose - two.gripper_pose).max() < 1e-5
        assert one.gripper_opening == two.gripper_opening
        for camera in cameras:
            a, b = one.views[camera], two.views[camera]
            assert set(vars(a)) == {"rgb", "depth", "intrinsics", "camera_to_world"}
            assert a.rgb.shape == (IMAGE_SIZE, IMAGE_SIZE, 3)
            assert a.depth.shape == (IMAGE_SIZE, IMAGE_SIZE)
            assert np.abs(a.camera_to_world - b.camera_to_world).max() < 1e-5
            assert (a.rgb != b.rgb).any(axis=-1).mean() < 0.001
            assert (np.abs(a.depth - b.depth) > 1e-4).mean() < 0.001


def test_a_policy_without_memory_has_a_choice_where_something_is_hidden(scripts):
    spec, found = scripts

    choices = [some for p in found if len(some := options(found, p.observation)) > 1]
    if suite.build(spec).aliases():
        assert choices
    for some in choices if not suite.build(spec).aliases() else ():
        # no pair is declared: they are alike by the tolerance, but not the same
        one, other = (point.observation for point in list(some.values())[:2])
        assert max(likeness(one, other).pixels.values()) > 0.001
