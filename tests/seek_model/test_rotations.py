"""Rotations survive being told in bins of five degrees."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hide_tasks import poses
from seek_model.rotations import angle_between, decode, encode, six, turned

NUMBER = st.floats(-1, 1)
QUATERNION = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).filter(lambda q: math.hypot(*q) > 0.1)
ANGLE = st.floats(-math.pi, math.pi)


@given(QUATERNION.map(np.array))
def test_a_rotation_comes_back_within_six_degrees(quaternion):
    bins = encode(quaternion)

    assert bins.min() >= 0 and bins.max() <= 71
    assert angle_between(decode(bins), quaternion) < 6


@given(x=ANGLE, z=ANGLE, off=st.floats(-0.05, 0.05), side=st.sampled_from([-1, 1]))
def test_nothing_blows_up_where_the_y_angle_is_a_right_angle(x, z, off, side):
    quaternion = poses.quaternion(x, side * math.pi / 2 + off, z)

    bins = encode(quaternion)

    assert angle_between(decode(bins), quaternion) < 6
    if abs(off) < 0.017:
        assert bins[1] == 36 + 18 * side and bins[2] == 36


@given(st.floats(-88.9, 88.9), st.floats(-180, 180), st.floats(-180, 180))
def test_every_angle_is_told_to_half_a_bin(y, x, z):
    quaternion = Rotation.from_euler("xyz", [x, y, z], degrees=True).as_quat()

    told = encode(quaternion) * 5.0 - 180

    off = (told - [x, y, z] + 180) % 360 - 180
    assert np.abs(off).max() <= 2.5 + 1e-4


@given(st.tuples(st.integers(0, 71), st.integers(19, 53), st.integers(0, 71)).map(np.array))
def test_bins_come_back_as_themselves(bins):
    np.testing.assert_array_equal(encode(decode(bins)), bins)


@given(tilt=st.floats(-2.4, 2.4), yaw=ANGLE)
def test_a_gripper_that_points_down_has_one_bin_about_x(tilt, yaw):
    down = poses.quaternion(math.pi + math.radians(tilt), 0.0, yaw)

    bins = encode(down)

    assert bins[0] == 0
    assert bins[1] == 36
    assert angle_between(decode(bins), down) < 5


def test_a_half_turn_and_its_negative_are_the_same_bin():
    assert encode(poses.quaternion(yaw=math.pi))[2] == 0
    assert encode(poses.quaternion(yaw=-math.pi))[2] == 0
    assert encode(poses.quaternion(yaw=math.radians(177.6)))[2] == 0
    assert encode(poses.quaternion(yaw=math.radians(177.4)))[2] == 71


@given(QUATERNION.map(np.array))
def test_a_quaternion_and_its_negative_are_one_rotation(quaternion):
    np.testing.assert_array_equal(encode(quaternion), encode(-quaternion))
    np.testing.assert_allclose(six(quaternion), six(-quaternion))
    assert angle_between(quaternion, -quaternion) < 1e-4


@given(QUATERNION.map(np.array))
def test_six_numbers_are_the_first_two_axes(quaternion):
    matrix = poses.rotation_matrix(quaternion)

    np.testing.assert_allclose(six(quaternion), [*matrix[:, 0], *matrix[:, 1]], atol=1e-9)


@given(roll=ANGLE, yaw=ANGLE, turn=ANGLE)
def test_turning_adds_to_the_heading(roll, yaw, turn):
    result = turned(poses.quaternion(roll, 0.3, yaw), turn)

    assert angle_between(result, poses.quaternion(roll, 0.3, yaw + turn)) < 1e-4
    assert result[3] >= 0


@given(QUATERNION.map(np.array), ANGLE)
def test_the_angle_between_is_the_angle_turned(quaternion, yaw):
    angle = angle_between(quaternion, turned(quaternion, yaw))

    assert angle == pytest.approx(abs(math.degrees(yaw)), abs=1e-4)


def test_any_number_of_leading_axes_is_kept():
    quaternions = np.random.default_rng(0).normal(size=(2, 5, 4))

    bins = encode(quaternions)

    assert bins.shape == (2, 5, 3) and six(quaternions).shape == (2, 5, 6)
    assert decode(bins).shape == turned(quaternions, 1.0).shape == (2, 5, 4)
    assert angle_between(quaternions, quaternions[0, 0]).shape == (2, 5)
    np.testing.assert_array_equal(bins[1, 3], encode(quaternions[1, 3]))
    np.testing.assert_allclose(np.linalg.norm(decode(bins), axis=-1), 1.0)
