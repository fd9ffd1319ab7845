"""Put the rubbish into the bin, then wipe away the dirt that it lay on.

HIDE appendix, real-world task (c), seen by one external camera. "Removing the rubbish reveals the
area that needs to be cleaned": the rubbish lies on the dirt and covers it. It lies on the left or
on the right of the desk, which are the paper's two variations. Once the rubbish is away the dirt
is to be seen until it is wiped away, so hardly anything is to be remembered.
"""

from typing import ClassVar

import numpy as np

from hide_tasks.assets.rubbish import HEIGHT as PAPER_HEIGHT
from hide_tasks.assets.rubbish import Bin
from hide_tasks.assets.sheet import Sheet
from hide_tasks.assets.sponge import HEIGHT as SPONGE_HEIGHT
from hide_tasks.assets.sponge import Sponge, Spot
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.poses import Array, point, pose, quaternion
from hide_tasks.task import Grid
from hide_tasks.tasks.wipe_desk_rubbish import BIN_AREA, SPONGE_AREA, WipeDeskRubbish

SPOTS = 24
DIRT = (0.042, 0.017)  # m either way, along the rubbish and across it
AREAS = {
    "left": Area(x=(0.30, 0.38), y=(0.06, 0.09)),
    "right": Area(x=(0.30, 0.38), y=(-0.11, -0.08)),
}
TURN = 0.25  # rad either way


class RealWipeDeskRubbish(WipeDeskRubbish):
    instructions = ("clean the desk",)
    variations = Grid(rubbish=tuple(AREAS))
    keyframes = frozenset({9})
    cameras: ClassVar = ("front",)
    reach = DIRT[1]

    def build(self) -> None:
        layout = self.layout
        (self.bin,) = layout.scatter([Bin()], BIN_AREA, gap=0.0, turn=0.15)
        places = {name: self._somewhere(area) for name, area in AREAS.items()}
        spots = {name: [self._spot(place) for _ in range(SPOTS)] for name, place in places.items()}
        dirty = spots.pop(self.variation.rubbish)
        for spot in (spot for clean in spots.values() for spot in clean):
            spot.wiped = True
        (self.sponge,) = layout.scatter([Sponge(dirty)], SPONGE_AREA, gap=0.0, turn=0.4)
        self.sponge.at[2] += SPONGE_HEIGHT / 2
        self.streak = places[self.variation.rubbish]
        on_dirt = point(self.streak, 0, 0, PAPER_HEIGHT / 2)
        self.paper = layout.add_at(Sheet(), np.concatenate([on_dirt, self.streak[3:]]))
        self._count()

    def _somewhere(self, area: Area) -> Array:
        """A place for rubbish that lies along its x axis."""
        x, y = (self.layout.between(*axis) for axis in (area.x, area.y))
        yaw = self.layout.between(-TURN, TURN)
        return pose(x, y, TABLE_TOP, quaternion(yaw=yaw))

    def _spot(self, place: Array) -> Spot:
        """A spot of dirt somewhere under rubbish that lies at a place."""
        along, across = (self.layout.between(-half, half) for half in DIRT)
        at = np.concatenate([point(place, along, across, 0.0), place[3:]])
        return self.layout.add_at(Spot(), at)
