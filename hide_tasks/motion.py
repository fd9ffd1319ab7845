"""Keyframe verbs: where the tip goes for what, and how the fingers are there.

Each gives a move, which is read when it is reached. `closed` fingers are for pressing; a move
that touches something tells the planner so.
"""

import math
from collections.abc import Callable

import numpy as np

from hide_tasks.assets.button import Button
from hide_tasks.assets.chest import BAR, DETENT, Chest, Drawer
from hide_tasks.contract import Keyframe
from hide_tasks.layout import TABLE_TOP
from hide_tasks.panda import FINGERTIP, HOME_POSE
from hide_tasks.poses import Array, compose, multiply, point, pose, quaternion
from hide_tasks.task import Arm, Move

DOWN = quaternion(roll=math.pi)  # the tool points at the table, its x axis away from the robot
HOVER = 0.083  # m above a button (RLBench push_button)
PRESS = 0.0065  # m that a press goes down: over the 5 mm that count, under the cap's 8 mm
STANDOFF = 0.08  # m before a handle
PITCHES = tuple(math.radians(angle) for angle in (20, 15, 10, 25, 30, 5, 40, 50, 60, 70))
LOOK_PITCH, LOOK_BACK, LOOK_UP = math.radians(75), 0.0, 0.24  # from an open drawer's handle
WITHDRAWN = 0.35  # m above the table

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


def above(button: Button) -> Move:
    """Hover over a button with shut fingers."""
    return move(lambda: _over(button, HOVER), opened=False)


def press(button: Button) -> Move:
    """Push a button's cap down."""
    return move(lambda: _over(button, FINGERTIP - PRESS), opened=False, touching=True)


def withdraw(button: Button) -> Move:
    """Rise from a button."""
    height = TABLE_TOP + WITHDRAWN
    return move(lambda: _over(button, height - button.top[2]), opened=False)


def before(drawer: Drawer, pitch: float, *, opened: bool = True) -> Move:
    """In front of a drawer's handle."""
    return move(lambda: toward(drawer.handle, pitch, back=STANDOFF), opened=opened)


def grasp_handle(drawer: Drawer, pitch: float) -> Move:
    """Close the fingers on a drawer's handle."""
    return move(lambda: toward(drawer.handle, pitch), opened=False, touching=True)


def slide_to(drawer: Drawer, opening: float, pitch: float) -> Move:
    """Bring the held handle to where the drawer is open so far, then let go."""

    def where() -> Array:
        return toward(drawer.handle, pitch, back=opening - drawer.opening)

    return move(where, touching=True)


def push_shut(drawer: Drawer, pitch: float) -> Move:
    """Push a drawer's handle with shut fingers until the detent takes it."""

    def where() -> Array:
        behind = FINGERTIP * math.cos(pitch) + BAR
        return toward(drawer.handle, pitch, back=behind - drawer.opening + DETENT / 4)

    return move(where, opened=False, touching=True)


def pitch_for(arm: Arm, chest: Chest, level: str, pull: float) -> float:
    """How far to tilt the tool, rad, so that the arm can follow a drawer's handle all the way."""
    shut = chest.frame(*chest.handle_offset(level)[:3])
    backs = (pull + STANDOFF, pull, 0.0, STANDOFF)
    chains = ([toward(shut, pitch, back=back) for back in backs] for pitch in PITCHES)
    return PITCHES[arm.first_feasible(chains)]


def look_into(drawer: Drawer) -> Move:
    """Back and up from the handle, the wrist camera towards the drawer."""
    return move(lambda: toward(drawer.handle, LOOK_PITCH, back=LOOK_BACK, up=LOOK_UP))


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


def _over(button: Button, height: float) -> Array:
    return top_down(button.top[:3] + np.array([0.0, 0.0, height]))
