"""The arm as PyBullet has it, to hold ours against."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pybullet
import pybullet_data
from numpy.typing import NDArray

from hide_tasks.bullet import frames
from hide_tasks.bullet.joint_space import LOWER, UPPER

Array = NDArray[np.float64]
Judge = Callable[[Array], Array]
PANDA = f"{pybullet_data.getDataPath()}/franka_panda/panda.urdf"
GRASPTARGET = 11


@contextmanager
def bullet_tip() -> Iterator[Judge]:
    """Where PyBullet puts the tip (4, 4)."""
    client = pybullet.connect(pybullet.DIRECT)
    robot = pybullet.loadURDF(
        PANDA, frames.BASE.tolist(), useFixedBase=True, physicsClientId=client
    )

    def tip(joints: Array) -> Array:
        for joint, angle in enumerate(joints):
            pybullet.resetJointState(robot, joint, angle, physicsClientId=client)
        state = pybullet.getLinkState(
            robot, GRASPTARGET, computeForwardKinematics=True, physicsClientId=client
        )
        transform = np.eye(4)
        transform[:3, :3] = np.reshape(pybullet.getMatrixFromQuaternion(state[5]), (3, 3))
        transform[:3, 3] = state[4]
        return transform

    try:
        yield tip
    finally:
        pybullet.disconnect(client)


def postures(count: int, seed: int) -> Array:
    """Random postures inside the limits."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 7))
