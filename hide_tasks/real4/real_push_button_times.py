"""Press the named one of three buttons exactly N times, then withdraw the arm upward.

HIDE appendix, real-world task (a), seen by one external camera. As in `push_button_times` the
cap springs back and the arm rises to the same pose, so the picture is the same before the first
press and after the last. The paper counts three variations, one, two or three presses. Its three
buttons have colours that it does not name: red, green and blue here, each of them the named one
equally often.
"""

from typing import ClassVar

from hide_tasks.layout import Area
from hide_tasks.task import Grid
from hide_tasks.tasks.push_button_times import PushButtonTimes

COLORS = ("red", "green", "blue")


class RealPushButtonTimes(PushButtonTimes):
    instructions = ("push the {color} button {count} times",)
    variations = Grid(count=(1, 2, 3))
    histories = Grid(color=COLORS)
    keyframes = frozenset({4, 6, 8})
    cameras: ClassVar = ("front",)
    palette: ClassVar = COLORS
    area: ClassVar = Area(x=(0.14, 0.46), y=(-0.29, 0.29))  # towards the camera
