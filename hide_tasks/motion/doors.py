"""Keyframe verbs for sliding doors, by the handle; and for what stands behind them."""

import math

from hide_tasks.assets.cabinet import BAR, DETENT, TRAVEL, Door
from hide_tasks.motion.general import move, toward
from hide_tasks.poses import Array, compose, pose, quaternion
from hide_tasks.task import Arm, Move

STANDOFF = 0.08  # m before a handle
PITCHES = tuple(math.radians(angle) for angle in (50, 55, 45, 60, 65))
LOOK_ASIDE = 0.078  # m beside an open door's handle: room for open fingers
LOOK_YAW = math.radians(25)  # towards what the door has uncovered
HALF_FINGER = 0.011  # m of the shut fingers, across


def before(door: Door, pitch: float) -> Move:
    """In front of a door's handle."""
    return move(lambda: toward(door.handle, pitch, back=STANDOFF))


def grasp_handle(door: Door, pitch: float) -> Move:
    """Close the fingers on a door's handle."""
    return move(lambda: toward(door.handle, pitch), opened=False, touching=True)


def slide_open(door: Door, pitch: float) -> Move:
    """Bring the held handle to where the door is open, then let go."""
    return move(lambda: toward(_shifted(door, door.opening - TRAVEL), pitch), touching=True)


def look_behind(door: Door, pitch: float) -> Move:
    """Beside the handle of the open door with shut fingers, towards what it has uncovered."""
    return move(lambda: _beside(door, LOOK_ASIDE, pitch), opened=False)


def push_shut(door: Door, pitch: float) -> Move:
    """From there, push the handle until the detent takes it."""

    def where() -> Array:
        return _beside(door, HALF_FINGER + BAR - door.opening + DETENT / 4, pitch)

    return move(where, opened=False, touching=True)


def pitch_for(arm: Arm, door: Door) -> float:
    """How far to tilt the tool, rad, so that the arm can follow a door's handle all the way."""
    return PITCHES[arm.first_feasible(_chain(door, pitch) for pitch in PITCHES)]


def _chain(door: Door, pitch: float) -> list[Array]:
    frame = door.cabinet.at
    shut, opened = (compose(frame, door.offset(opening)) for opening in (0.0, TRAVEL))
    return [
        toward(shut, pitch, back=STANDOFF),
        toward(shut, pitch),
        toward(opened, pitch),
        _turned(opened, door.outward, LOOK_ASIDE, pitch),
        _turned(shut, door.outward, HALF_FINGER + BAR, pitch),
    ]


def _shifted(door: Door, outward: float) -> Array:
    return compose(door.handle, pose(0, door.outward * outward, 0))


def _beside(door: Door, inward: float, pitch: float) -> Array:
    return _turned(door.handle, door.outward, inward, pitch)


def _turned(handle: Array, outward: int, inward: float, pitch: float) -> Array:
    turn = quaternion(yaw=outward * LOOK_YAW)
    return toward(compose(handle, pose(0, -outward * inward, 0, turn)), pitch)
