"""Keyframe verbs: where the tip goes for what, and how the fingers are there.

Each gives a move, which is read when it is reached. `closed` fingers are for pressing; a move
that touches something tells the planner so.
"""

import math
from collections.abc import Callable

import numpy as np

from hide_tasks.contract import Keyframe
from hide_tasks.panda import HOME_POSE
from hide_tasks.poses import Array, compose, multiply, point, pose, quaternion
from hide_tasks.task import Move

DOWN = quaternion(roll=math.pi)  # the tool points at the table, its x axis away from the robot

Place = Callable[[], Array]


def move(where: Place, *, opened: bool = True, touching: bool = False) -> Move:
    """Go to a pose; the fingers are opened or closed there."""
    return lambda: Keyframe.at(where(), opening=float(opened), ignore_collisions=touching)


def top_down(position: Array, yaw: float = 0.0) -> Array:
    """The tip pose (7,) over a point with the tool pointing down."""
    return np.concatenate([position, multiply(quaternion(yaw=yaw), DOWN)])


def toward(frame: Array, pitch: float, *, back: float = 0.0, up: float = 0.0) -> Array:
    """The tip pose that looks along a frame's x axis, `pitch` rad downward.

    The fingers close along the frame's y axis. The tip is `back` metres behind the frame along
    the horizontal and `up` metres above it.
    """
    tilt = multiply(quaternion(pitch=pitch - math.pi / 2), DOWN)
    return compose(np.concatenate([point(frame, -back, 0, up), frame[3:]]), pose(0, 0, 0, tilt))


def over(where: Callable[[], Array], height: float, *, opened: bool, yaw: float = 0.0) -> Move:
    """Over a point (3,), the tool pointing down."""
    return move(lambda: top_down(where() + np.array([0, 0, height]), yaw), opened=opened)


def take(where: Callable[[], Array], *, yaw: float = 0.0) -> Move:
    """Close the fingers at a point (3,), the tool pointing down."""
    return move(lambda: top_down(where(), yaw), opened=False, touching=True)


def put(where: Callable[[], Array], *, yaw: float = 0.0) -> Move:
    """Open the fingers at a point (3,), the tool pointing down."""
    return move(lambda: top_down(where(), yaw), touching=True)


def home() -> Move:
    """Back to where every episode starts, fingers open."""
    return move(lambda: HOME_POSE)
