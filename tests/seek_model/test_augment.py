"""One placement for a sequence: rigid, in bounds, the same for all that it holds."""

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seek_model.augment import NONE, Placement, draw, inside
from seek_model.clouds import to_cube
from seek_model.config import Augment
from seek_model.rotations import angle_between, turned

DOWN = np.array([1.0, 0.0, 0.0, 0.0])

WIDE = Augment(shift=(0.125, 0.125, 0.125), turn=45.0)


def rigid(shift: float) -> Placement:
    return Placement((shift, -shift, shift / 2), 0.7)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_every_target_stays_in_the_cube(seed):
    rng = np.random.default_rng(seed)
    targets = rng.uniform((-0.3, -0.5, 0.6), (0.7, 0.5, 1.6), (rng.integers(1, 12), 3))

    placement = draw(rng, targets, WIDE)

    assert np.abs(placement.positions(targets)).max() <= 1.0
    assert np.abs(placement.shift).max() <= 0.125 * 2
    assert abs(placement.turn) <= np.radians(45)


def test_targets_in_every_corner_leave_no_room():
    corners = np.array([(x, y, z) for x in (-0.3, 0.7) for y in (-0.5, 0.5) for z in (0.6, 1.6)])

    assert draw(np.random.default_rng(0), corners, WIDE) is NONE


def test_shifts_and_turns_fill_their_ranges():
    rng = np.random.default_rng(0)
    drawn = [draw(rng, np.array([[0.2, 0.0, 1.1]]), WIDE) for _ in range(300)]

    shifts, turns = np.array([p.shift for p in drawn]), np.degrees([p.turn for p in drawn])
    np.testing.assert_allclose(shifts.min(axis=0), -0.25, atol=0.01)
    np.testing.assert_allclose(shifts.max(axis=0), 0.25, atol=0.01)
    assert (turns.min() < -43, turns.max() > 43) == (True, True)


def test_distances_between_points_and_targets_are_kept():
    rng = np.random.default_rng(0)
    world = rng.uniform((-0.1, -0.2, 0.7), (0.5, 0.2, 1.3), (40, 3))
    targets, points = world[:5], torch.from_numpy(to_cube(world)).float()

    placed = rigid(0.2).points(points).numpy()
    moved = rigid(0.2).positions(targets)

    before = np.linalg.norm(to_cube(targets)[:, None] - to_cube(world), axis=-1)
    after = np.linalg.norm(moved[:, None] - placed, axis=-1)
    np.testing.assert_allclose(before, after, atol=1e-5)
    np.testing.assert_allclose(moved, placed[:5], atol=1e-6)


def test_a_gripper_turns_with_what_it_points_at():
    placement = Placement((0.0, 0.0, 0.0), np.radians(30))

    quaternion = placement.quaternions(DOWN[None])

    np.testing.assert_allclose(angle_between(quaternion, turned(DOWN[None], np.radians(30))), 0)
    np.testing.assert_allclose(angle_between(quaternion, DOWN[None]), 30, atol=1e-6)
    step = placement.positions(np.array([[0.3, 0.0, 1.1], [0.2, 0.0, 1.1]])) @ [1, 0, 0]
    np.testing.assert_allclose(step, [0.2 * np.cos(np.radians(30)), 0], atol=1e-9)


def test_without_a_placement_nothing_moves():
    world = np.array([[0.3, 0.1, 1.0]])

    np.testing.assert_array_equal(NONE.positions(world), to_cube(world))
    np.testing.assert_array_equal(NONE.quaternions(DOWN[None]), DOWN[None])
    assert torch.equal(NONE.points(torch.ones(2, 3)), torch.ones(2, 3))


def test_the_cubes_sides_are_inside():
    positions = torch.tensor([[1.0, -1.0, 0.0], [1.001, 0.0, 0.0], [0.0, 0.0, -1.1]])

    assert inside(positions).tolist() == [True, False, False]
