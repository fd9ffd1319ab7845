"""Keyframe verbs for hinged lids: shut fingers slip under the tab, lift, and push back from behind.

The fingers push and never hold the lid, so a straight line serves: they slide along the lid.
"""

import itertools
import math
from typing import NamedTuple

from hide_tasks.assets.shoe_boxes import LENGTH, Lid
from hide_tasks.motion.general import move, toward
from hide_tasks.poses import Array, compose, pose, quaternion
from hide_tasks.task import Arm, Move

# Metres from the hinge: before it (back, towards the robot), over it (up).
LEVEL = 0.020  # the finger's lower side clears the wall
BEFORE, UNDER = LENGTH + 0.09, LENGTH + 0.002
LIFTED = (-0.03, 0.15)  # past the hinge: the lid falls to its stop
OFF = (0.20, 0.20)
LOOK = (0.10, 0.27)
BEHIND = (-0.125, 0.178)
OVER = (0.08, 0.14)  # the lid leans forward and falls shut
BEHIND_PITCH = math.radians(55)
LOOK_PITCH = math.radians(80)


class Reach(NamedTuple):
    """How the tool is held while it lifts a lid, rad."""

    first: float  # pitch at the tab
    last: float  # pitch when the lid is open
    inward: float  # yaw


REACHES = tuple(
    Reach(*map(math.radians, (first, last, inward)))
    for (first, last), inward in itertools.product(((0, 0), (5, 5), (10, 10)), (12, 16, 8, 20, 24))
)


def reach_for(arm: Arm, lid: Lid) -> Reach:
    """How the arm can hold the tool to lift a lid all the way."""
    return REACHES[arm.first_feasible(_lifting(lid, reach) for reach in REACHES)]


def before_tab(lid: Lid, reach: Reach) -> Move:
    """Before a lid's tab with shut fingers."""
    return move(lambda: _tip(lid, reach.first, BEFORE, LEVEL, reach.inward), opened=False)


def slip_under(lid: Lid, reach: Reach) -> Move:
    """Under the tab: it rides up on the fingers."""
    return move(
        lambda: _tip(lid, reach.first, UNDER, LEVEL, reach.inward), opened=False, touching=True
    )


def lift(lid: Lid, reach: Reach) -> Move:
    """Up and past the hinge."""
    return move(lambda: _tip(lid, reach.last, *LIFTED, reach.inward), opened=False, touching=True)


def back_off(lid: Lid, reach: Reach) -> Move:
    """Away from the open lid."""
    return move(lambda: _tip(lid, reach.last, *OFF, reach.inward), touching=True)


def look_into(lid: Lid) -> Move:
    """Over the open box, the wrist camera towards it."""
    return move(lambda: toward(_at(lid, *LOOK), LOOK_PITCH), opened=False)


def behind_lid(lid: Lid) -> Move:
    """Behind the open lid with shut fingers."""
    return move(lambda: toward(_at(lid, *BEHIND), BEHIND_PITCH), opened=False)


def push_over(lid: Lid) -> Move:
    """Push the lid forward until it falls shut."""
    return move(lambda: toward(_at(lid, *OVER), BEHIND_PITCH), opened=False, touching=True)


def _lifting(lid: Lid, reach: Reach) -> list[Array]:
    first, last, inward = reach
    return [
        _tip(lid, first, BEFORE, LEVEL, inward),
        _tip(lid, first, UNDER, LEVEL, inward),
        _tip(lid, last, *LIFTED, inward),
        _tip(lid, last, *OFF, inward),
    ]


def _at(lid: Lid, back: float, up: float, yaw: float = 0.0) -> Array:
    return compose(lid.hinge, pose(-back, 0, up, quaternion(yaw=yaw)))


def _tip(lid: Lid, pitch: float, back: float, up: float, inward: float) -> Array:
    """The tool points inward; for the left lid it is turned over, as the wrist allows it."""
    left = lid.side == "left"
    turn = pose(0, 0, 0, quaternion(yaw=math.pi if left else 0.0))
    return compose(toward(_at(lid, back, up, -inward if left else inward), pitch), turn)
