"""The field's rule for finding keyframes in a dense trajectory, to hold our own against.

A keyframe is where the gripper opens or shuts, where the arm stops, and the end (James and
Davison 2022, PerAct 2022). The experts' keyframes come from their scripts; that the rule finds
them too shows that both speak of the same thing.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.robot import ARM
from hide_tasks.bullet.world import World

SLOW = 0.1  # rad/s: a joint that moves less stands
PAUSE = 4  # frames after a stop in which no other is found
NEAR, ALIGNED = 0.01, 0.2  # m and rad between two poses that are one place


class Frame(NamedTuple):
    """The robot at one 20th of a second."""

    pose: NDArray[np.float64]  # (7,) of the tip
    speed: float  # of the fastest joint, rad/s
    opened: bool  # what the fingers were last told


@dataclass
class Trajectory:
    """A camcorder that keeps the robot's motion at 20 Hz."""

    world: World
    frames: list[Frame] = field(default_factory=list)

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Keep where the robot is."""
        robot = self.world.robot
        speed = max(abs(state[1]) for state in robot.client.getJointStates(robot.id, ARM))
        self.frames.append(Frame(robot.tip_pose, speed, robot.open_fingers))


def discover(frames: Sequence[Frame]) -> list[int]:
    """The numbers of the keyframes in a trajectory, as PerAct and its followers find them."""
    found: list[int] = []
    pause = 0
    for i in range(len(frames)):
        stops = pause <= 0 and _stands(frames, i)
        pause = PAUSE if stops else pause - 1
        last = i == len(frames) - 1
        if i > 0 and (stops or last or frames[i].opened != frames[i - 1].opened):
            found.append(i)
    if len(found) > 1 and found[-1] - 1 == found[-2]:
        del found[-2]
    return found


def _stands(frames: Sequence[Frame], i: int) -> bool:
    """True where the arm is slow and the gripper unchanged from two frames before to one after."""
    around = [frames[j].opened for j in range(i - 2, i + 2) if j < len(frames)]
    return i < len(frames) - 2 and len(set(around)) == 1 and frames[i].speed < SLOW


def distinct(frames: Sequence[Frame], found: Sequence[int]) -> list[Frame]:
    """The keyframes that were found, less those that only a slow arm or a wait accounts for.

    The simulator starts and ends motions gently and lets everything come to rest before and after
    the fingers move, so the rule finds more than one keyframe at one place. Of these the last is
    kept; every motion of the fingers is a keyframe of its own.
    """
    kept, acted = [frames[0]], True
    for i in found:
        acts = frames[i].opened != frames[i - 1].opened
        if _same_place(frames[i], kept[-1]) and not (acts and acted):
            kept[-1], acted = frames[i], acts or acted
        else:
            kept, acted = [*kept, frames[i]], acts
    return kept[1:]


def _same_place(a: Frame, b: Frame) -> bool:
    apart = float(np.linalg.norm(a.pose[:3] - b.pose[:3]))
    turned = 2 * math.acos(min(1.0, abs(float(a.pose[3:] @ b.pose[3:]))))
    return apart < NEAR and turned < ALIGNED
