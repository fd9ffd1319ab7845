"""Keyframe verbs for drawers: by the handle, tilted as the arm can follow."""

import math

from hide_tasks.assets.chest import BAR, DETENT, Chest, Drawer
from hide_tasks.motion.general import move, toward
from hide_tasks.panda import FINGERTIP
from hide_tasks.poses import Array
from hide_tasks.task import Arm, Move

STANDOFF = 0.08  # m before a handle
PITCHES = tuple(math.radians(angle) for angle in (20, 15, 10, 25, 30, 5, 40, 50, 60, 70))
LOOK_PITCH, LOOK_BACK, LOOK_UP = math.radians(75), 0.0, 0.24  # from an open drawer's handle


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
