"""Put the rubbish into the bin, then wipe the one of three places where it had lain.

`wipe_desk_rubbish` with something to remember: the dirt is a clear film, and once the rubbish is
under the bin's flap the three places look the same.
"""

from itertools import pairwise
from typing import ClassVar

import numpy as np

from hide_tasks.assets.posting import FlapBin
from hide_tasks.assets.region import Region
from hide_tasks.assets.rubbish import HEIGHT as PAPER_HEIGHT
from hide_tasks.assets.rubbish import Paper
from hide_tasks.assets.sponge import HEIGHT as SPONGE_HEIGHT
from hide_tasks.assets.sponge import Film, Sponge
from hide_tasks.contract import Failure, HiddenState
from hide_tasks.layout import TABLE_TOP
from hide_tasks.poses import Array, compose, point, pose, quaternion
from hide_tasks.task import Alias, Grid, Moment
from hide_tasks.tasks.wipe_desk_rubbish import BIN_AREA, SPONGE_AREA, WipeDeskRubbish

PLACES = ("near", "middle", "far")  # as the robot sees them
MIDDLE = (0.25, 0.02)  # m, where the middle one is
SPACING = 0.135  # m from place to place: a sponge's length and a hand's breadth
JITTER, TURN = 0.01, 0.06  # m, rad; either way, of all three
SIDE = 0.115  # m of a place
MAT = (120, 150, 170)
FILM = (0.036, 0.040)  # m either way of a place's middle, across and along the stroke
ROWS = (3, 4)  # of spots of film, across and along
LYING = 0.012  # m either way of a place's middle that the rubbish lies
TOUCHED = 0.25  # share of a place's film; if more is gone, the place was wiped


class WipeDeskRubbishHard(WipeDeskRubbish):
    instructions = (
        "wipe the desk where the rubbish lay",
        "put the rubbish into the bin, then wipe the place where it lay",
        "throw the rubbish away and clean the spot that it was on with the sponge",
        "bin the rubbish and scrub the mat on which it was, and no other",
        "clean the place of the rubbish once the rubbish is in the bin",
        "after binning the rubbish, use the sponge where it had been",
    )
    histories = Grid(place=PLACES)
    keyframes = frozenset({9})
    remembers = "on which of the three places the rubbish lay"
    failures: ClassVar = {
        **WipeDeskRubbish.failures,
        Failure.WRONG_RECALL: "a place was wiped on which no rubbish had lain",
        Failure.UNFINISHED: "the place where the rubbish lay was not wiped",
    }
    spoils = WipeDeskRubbish.spoils | {Failure.WRONG_RECALL}
    reach = FILM[1]

    def build(self) -> None:
        layout = self.layout
        self.paper = Paper()
        (self.bin,) = layout.scatter([FlapBin([self.paper])], BIN_AREA, gap=0.0, turn=0.15)
        self.films = {place: [Film() for _ in range(ROWS[0] * ROWS[1])] for place in PLACES}
        every = [film for films in self.films.values() for film in films]
        (self.sponge,) = layout.scatter([Sponge(every)], SPONGE_AREA, gap=0.0, turn=0.4)
        self.sponge.at[2] += SPONGE_HEIGHT / 2
        layout.hold([self.sponge])
        self._lay_out()
        self._count()

    def _lay_out(self) -> None:
        """The places with their film, and the rubbish on one of them."""
        between = self.layout.between
        x, y = (at + between(-JITTER, JITTER) for at in MIDDLE)
        middle = pose(x, y, TABLE_TOP, quaternion(yaw=between(-TURN, TURN)))
        across, along, turn = (between(-most, most) for most in (LYING, LYING, 0.6))
        lying = pose(across, along, PAPER_HEIGHT / 2, quaternion(yaw=turn))
        places = {
            place: np.concatenate([point(middle, (i - 1) * SPACING, 0, 0), middle[3:]])
            for i, place in enumerate(PLACES)
        }
        for place, at in places.items():
            self.layout.add_at(Region(SIDE, color=MAT), at)
            self._spread(place, at)
        self.streak = places[self.variation.place]
        self.layout.add_at(self.paper, compose(self.streak, lying))
        self.wiping = f"wipe {self.variation.place}"

    def _spread(self, place: str, at: Array) -> None:
        steps = [(x, y) for x in _steps(0) for y in _steps(1)]
        for film, (x, y) in zip(self.films[place], steps, strict=True):
            self.layout.add_at(film, np.concatenate([point(at, x, y, 0), at[3:]]))

    @property
    def dirt(self) -> int:
        """How many spots of film are left where the rubbish lay."""
        return sum(not film.wiped for film in self.films[self.variation.place])

    def hidden_state(self) -> HiddenState:
        return {
            "rubbish_lay": self.variation.place,
            "rubbish_binned": self._binned(),
            "wiped": [place for place in PLACES if self._wiped(place)],
        }

    def violations(self) -> list[Failure]:
        wrong = any(self._wiped(place) for place in PLACES if place != self.variation.place)
        return [*super().violations(), *[Failure.WRONG_RECALL] * wrong]

    def aliases(self) -> list[Alias]:
        return [
            Alias(
                Moment(6, {"place": one}),
                Moment(6, {"place": other}),
                f"sponge in hand; the rubbish lay {one} or {other}",
            )
            for one, other in pairwise(PLACES)
        ]

    def _wiped(self, place: str) -> bool:
        films = self.films[place]
        return sum(film.wiped for film in films) > TOUCHED * len(films)


def _steps(axis: int) -> list[float]:
    return [float(x) for x in np.linspace(-FILM[axis], FILM[axis], ROWS[axis])]
