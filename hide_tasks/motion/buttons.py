"""Keyframe verbs for push buttons: the fingers are shut."""

import numpy as np

from hide_tasks.assets.button import Button
from hide_tasks.layout import TABLE_TOP
from hide_tasks.motion.general import move, top_down
from hide_tasks.panda import FINGERTIP
from hide_tasks.poses import Array
from hide_tasks.task import Move

HOVER = 0.083  # m above a button (RLBench push_button)
PRESS = 0.0075  # m that a press goes down: well over the 5 mm that count, under the cap's 8 mm
WITHDRAWN = 0.35  # m above the table


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


def _over(button: Button, height: float) -> Array:
    return top_down(button.top[:3] + np.array([0.0, 0.0, height]))
