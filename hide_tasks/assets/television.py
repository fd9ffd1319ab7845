"""A television on its foot. It shows the same picture on every channel, and no number."""

from dataclasses import dataclass

from hide_tasks.assets.asset import Asset, Link, Shape, box, cylinder
from hide_tasks.poses import quaternion

SCALE = 0.8  # of RLBench's: the front camera looks over it
WIDTH, DEPTH, HEIGHT = 0.616 * SCALE, 0.118 * SCALE, 0.395 * SCALE  # m; RLBench change_channel
BEZEL = 0.016  # m round the screen
THICK = 0.036  # m of the panel
FOOT = 0.05  # m of the panel's lower edge over the table
CASE, SKY, SUN = (28, 29, 33), (112, 186, 236), (255, 214, 70)
HILLS, MEADOW = (70, 128, 84), (122, 178, 82)


@dataclass
class Television(Asset):
    """A television; its frame is the middle of its foot, x into the screen."""

    radius = 0.25

    def __post_init__(self) -> None:
        tall = HEIGHT - FOOT
        panel = box((THICK, WIDTH, tall), (0, 0, FOOT + tall / 2), CASE, bevel=0.004)
        foot = box((DEPTH, 0.24, 0.012), (0, 0, 0.006), CASE, bevel=0.003)
        neck = box((0.03, 0.06, FOOT), (0, 0, FOOT / 2), CASE)
        self.links = (Link("television", (panel, foot, neck, *self._picture(tall))),)

    def _picture(self, tall: float) -> tuple[Shape, ...]:
        wide, high, front = WIDTH - 2 * BEZEL, tall - 2 * BEZEL, -THICK / 2
        low = FOOT + BEZEL
        faces_back = tuple(quaternion(pitch=-1.5707963267948966).tolist())
        return (
            box((0.002, wide, high), (front, 0, low + high / 2), SKY, solid=False),
            box(
                (0.004, wide * 0.62, high * 0.42),
                (front, wide * 0.19, low + high * 0.21),
                HILLS,
                solid=False,
            ),
            box((0.006, wide, high * 0.26), (front, 0, low + high * 0.13), MEADOW, solid=False),
            cylinder(
                0.035,
                0.006,
                (front, -wide * 0.27, low + high * 0.68),
                SUN,
                rotation=faces_back,
                solid=False,
            ),
        )
