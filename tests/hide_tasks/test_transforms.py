"""Poses and transforms."""

import numpy as np
import pytest

from hide_tasks.bullet import frames, transforms
from tests.hide_tasks.bullet_arm import postures


def test_poses_and_transforms_are_the_same_thing() -> None:
    for joints in postures(100, seed=3):
        transform = frames.tip_pose(joints)
        pose = transforms.matrix_to_pose(transform)

        assert np.allclose(transforms.pose_to_matrix(pose), transform, atol=1e-12)
        assert np.allclose(transforms.pose_to_matrix([*pose[:3], *-3 * pose[3:]]), transform)


def test_a_quaternion_that_is_zero_is_told() -> None:
    with pytest.raises(ValueError, match="quaternion that is not zero"):
        transforms.pose_to_matrix([0.0] * 7)
