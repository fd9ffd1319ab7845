"""Forward kinematics of the arm: the frames of its links, and how the tip moves with the joints.

Metres, radians, world frame; joints are (7,), frames (4, 4).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from hide_tasks.bullet.kernels import Array, as_array, compiled

BASE = np.array([-0.26, -0.01, 0.764])  # m, the robot's base in the world (RLBench)

# The chain of panda.urdf: quarter turns about x and the offset of each joint in its parent (m).
_TURNS = np.array([0, -1, 1, 1, -1, 1, 1])
OFFSETS = np.array(
    [
        [0.0, 0.0, 0.333],
        [0.0, 0.0, 0.0],
        [0.0, -0.316, 0.0],
        [0.0825, 0.0, 0.0],
        [-0.0825, 0.384, 0.0],
        [0.0, 0.0, 0.0],
        [0.088, 0.0, 0.0],
    ]
)
FLANGE = 0.107  # m from joint 7 to the hand, which is turned by -45 degrees
HAND_TO_TIP = 0.105  # m from the hand to the tip
HAND, TIP, FRAMES = 8, 9, 10  # indices into `link_frames`; 0 is the base, 1 to 7 the links


@compiled
def fill_frames(q: Array, frames: Array) -> None:
    """Write the frames of base, links 1 to 7, hand and tip into (10, 4, 4)."""
    frames[:] = 0.0
    for i in range(FRAMES):
        frames[i, 3, 3] = 1.0
    for r in range(3):
        frames[0, r, r] = 1.0
        frames[0, r, 3] = BASE[r]
    for i in range(7):
        c, s = math.cos(q[i]), math.sin(q[i])
        parent, child = frames[i], frames[i + 1]
        for r in range(3):
            x, y, z = parent[r, 0], parent[r, 1], parent[r, 2]
            child[r, 3] = parent[r, 3] + (x * OFFSETS[i, 0] + y * OFFSETS[i, 1]) + z * OFFSETS[i, 2]
            if _TURNS[i] == 1:
                y, z = z, -y
            elif _TURNS[i] == -1:
                y, z = -z, y
            child[r, 0] = c * x + s * y
            child[r, 1] = c * y - s * x
            child[r, 2] = z
    h = math.sqrt(0.5)
    for r in range(3):
        x, y, z = frames[7, r, 0], frames[7, r, 1], frames[7, r, 2]
        frames[8, r, 0] = h * (x - y)
        frames[8, r, 1] = h * (x + y)
        frames[8, r, 2] = z
        frames[8, r, 3] = frames[7, r, 3] + FLANGE * z
        for k in range(3):
            frames[9, r, k] = frames[8, r, k]
        frames[9, r, 3] = frames[8, r, 3] + HAND_TO_TIP * z


@compiled
def fill_jacobian(frames: Array, jac: Array) -> None:
    """Write the velocity of the tip per joint into (6, 7): linear above angular, world frame."""
    for i in range(7):
        z0, z1, z2 = frames[i + 1, 0, 2], frames[i + 1, 1, 2], frames[i + 1, 2, 2]
        d0 = frames[TIP, 0, 3] - frames[i + 1, 0, 3]
        d1 = frames[TIP, 1, 3] - frames[i + 1, 1, 3]
        d2 = frames[TIP, 2, 3] - frames[i + 1, 2, 3]
        jac[0, i] = z1 * d2 - z2 * d1
        jac[1, i] = z2 * d0 - z0 * d2
        jac[2, i] = z0 * d1 - z1 * d0
        jac[3, i] = z0
        jac[4, i] = z1
        jac[5, i] = z2


@compiled
def tip_frame(q: Array) -> Array:
    """`tip_pose` for kernels: the frame (4, 4) of the tip."""
    frames: Array = np.empty((FRAMES, 4, 4))
    fill_frames(q, frames)
    tip: Array = frames[TIP]
    return tip


def link_frames(joints: ArrayLike) -> Array:
    """World frames (10, 4, 4) of the base, links 1 to 7, the hand and the tip."""
    frames = np.empty((FRAMES, 4, 4))
    fill_frames(as_array(joints, (7,), "joints"), frames)
    return frames


def tip_pose(joints: ArrayLike) -> Array:
    """World transform (4, 4) of the tip."""
    return np.asarray(link_frames(joints)[TIP])


def jacobian(joints: ArrayLike) -> Array:
    """Velocity of the tip per joint velocity (6, 7): linear above angular, in the world frame."""
    jac = np.empty((6, 7))
    fill_jacobian(link_frames(joints), jac)
    return jac
