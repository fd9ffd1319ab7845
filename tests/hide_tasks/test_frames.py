"""Forward kinematics against PyBullet's own."""

import numpy as np
import pytest

from hide_tasks.bullet import frames
from tests.hide_tasks.bullet_arm import bullet_tip, postures


def test_the_tip_is_where_bullet_puts_it() -> None:
    with bullet_tip() as tip:
        for joints in postures(200, seed=1):
            assert np.abs(frames.tip_pose(joints) - tip(joints)).max() < 1e-6


def test_the_jacobian_is_the_derivative_of_the_tip() -> None:
    step = 1e-6
    for joints in postures(20, seed=2):
        jacobian, here = frames.jacobian(joints), frames.tip_pose(joints)
        for k in range(7):
            there = frames.tip_pose(joints + step * np.eye(7)[k])
            change = (there - here) / step
            spin = change[:3, :3] @ here[:3, :3].T
            expected = [*change[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
            assert np.allclose(jacobian[:, k], expected, atol=1e-5)


def test_a_wrong_shape_is_told() -> None:
    with pytest.raises(ValueError, match="joints has shape"):
        frames.tip_pose([0.0])
