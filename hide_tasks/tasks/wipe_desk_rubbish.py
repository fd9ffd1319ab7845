"""Put the rubbish into the bin, then wipe the dirt off the desk.

HIDE appendix A.1 (h). Nothing is hidden: the rubbish lies on the desk or in the bin, and the
dirt is to be seen until it is wiped away. The paper's own scores without memory say the same
(100 of 100), so the certificate calls its demand of memory weak.
"""

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np

from hide_tasks.assets.rubbish import HEIGHT as PAPER_HEIGHT
from hide_tasks.assets.rubbish import Bin, Paper
from hide_tasks.assets.sponge import HEIGHT as SPONGE_HEIGHT
from hide_tasks.assets.sponge import Sponge, Spot
from hide_tasks.contract import Category, Failure, HiddenState
from hide_tasks.layout import TABLE_TOP, Area
from hide_tasks.motion.general import move, over, put, take, top_down
from hide_tasks.poses import Array, point, pose, quaternion, yaw_of
from hide_tasks.task import Alias, Checks, Grid, Move, Stage, Task

SPOTS = 50  # RLBench wipe_desk
STREAK = (0.038, 0.11)  # m either way across and along; one stroke wipes 0.05 either way
BEYOND = 0.02  # m that a stroke begins before the streak and ends behind it
STREAK_AREA = Area(x=(0.26, 0.34), y=(0.00, 0.04))
STREAK_TURN = 0.25  # rad either way; the streak runs across the desk
SPONGE_AREA = Area(x=(0.20, 0.36), y=(0.24, 0.30))
BIN_AREA = Area(x=(0.14, 0.24), y=(-0.36, -0.33))
ON_STREAK = (0.03, 0.06)  # m from the streak's middle that the rubbish lies, across and along
GRIP = 0.004  # m above a thing's middle that the fingers take it
LIFT = 0.25  # m; RLBench put_rubbish_in_bin
OVER_BIN = 0.08  # m of the tip over the bin's mouth
GLIDE = 0.001  # m of the wiping sponge over the desk
FELL = 0.1  # m under the table's top


class WipeDeskRubbish(Task):
    category = Category.HISTORICAL_STATE_RECALL
    instructions: ClassVar[tuple[str, ...]] = (
        "wipe dirt off the desk",
        "use the sponge to clean up the desk",
        "remove the dirt from the desk",
        "clean the dirt off the desk with the sponge",
        "grab the sponge and wipe the mess off the desk",
        "scrub the desk until no dirt is left",
    )
    variations = Grid()
    keyframes = frozenset({8, 9})
    remembers = "nothing: the rubbish and the dirt are to be seen"
    failures: ClassVar = {
        Failure.SKIPPED_STEP: "the desk was wiped before the rubbish was in the bin",
        Failure.NOT_PLACED: "the rubbish is not in the bin",
        Failure.UNFINISHED: "dirt is left",
        Failure.DROPPED_OBJECT: "the rubbish or the sponge fell off the desk",
    }
    spoils = frozenset({Failure.DROPPED_OBJECT})
    wiping = "wipe"  # the name of that stage
    reach = STREAK[1]  # m either way that the dirt goes on along a stroke

    def build(self) -> None:
        layout = self.layout
        (self.bin,) = layout.scatter([Bin()], BIN_AREA, gap=0.0, turn=0.15)
        spots = [Spot() for _ in range(SPOTS)]
        (self.sponge,) = layout.scatter([Sponge(spots)], SPONGE_AREA, gap=0.0, turn=0.4)
        self.sponge.at[2] += SPONGE_HEIGHT / 2
        x, y = (layout.between(*axis) for axis in (STREAK_AREA.x, STREAK_AREA.y))
        turn = quaternion(yaw=layout.between(-STREAK_TURN, STREAK_TURN))
        self.streak = pose(x, y, TABLE_TOP, turn)  # along its y
        at = self._on_streak(*ON_STREAK, PAPER_HEIGHT / 2)
        self.paper = layout.add_at(Paper(), at)
        for spot in spots:
            layout.add_at(spot, self._on_streak(*STREAK, 0.0))
        self._count()

    def _on_streak(self, across: float, along: float, height: float) -> Array:
        """A random pose on the streak, at most so far from its middle."""
        between = self.layout.between
        place = point(self.streak, between(-across, across), between(-along, along), height)
        return np.concatenate([place, quaternion(yaw=between(-0.6, 0.6))])

    def _count(self) -> None:
        self.early = self.count(
            "wiped_before_binning",
            lambda: len(self.sponge.spots) - self.sponge.left,
            up=0.5,
            down=0.5,
            when=lambda: not self._binned(),
        )

    def hidden_state(self) -> HiddenState:
        return {"rubbish_binned": self._binned(), "spots_left": self.dirt}

    def stage(self) -> str:
        if not self._binned():
            return "bin the rubbish"
        if not self.dirt:
            return "withdraw"
        return self.wiping if self.robot.holds(self.sponge) else "take the sponge"

    def expert(self) -> Iterator[Stage]:
        paper, sponge = yaw_of(self.paper.at), yaw_of(self.sponge.at)
        yield Stage(
            "bin the rubbish",
            over(self._paper, 0.10, opened=True, yaw=paper),
            take(self._paper, yaw=paper),
            over(self._paper, LIFT, opened=False, yaw=paper),
            put(self._over_bin, yaw=yaw_of(self.bin.at)),
        )
        yield Stage(
            "take the sponge",
            over(self._sponge, 0.10, opened=True, yaw=sponge),
            take(self._sponge, yaw=sponge),
        )
        yield Stage(self.wiping, self._wipe(1, opened=False), self._wipe(-1, opened=True))
        yield Stage("withdraw", over(self._sponge, 0.15, opened=True, yaw=yaw_of(self.streak)))

    def checks(self) -> Checks:
        return {"rubbish_in_bin": self._binned(), "desk_clean": self.dirt == 0}

    def missing(self) -> Failure:
        return Failure.UNFINISHED if self._binned() else Failure.NOT_PLACED

    def violations(self) -> list[Failure]:
        low = min(self.paper.position[2], self.sponge.position[2])
        fell = low < TABLE_TOP - FELL
        early = self.early.total > 0
        return [Failure.SKIPPED_STEP] * early + [Failure.DROPPED_OBJECT] * fell

    def aliases(self) -> list[Alias]:
        return []

    @property
    def dirt(self) -> int:
        """How many spots are left."""
        return self.sponge.left

    def _binned(self) -> bool:
        return self.bin.contains(self.paper.position) and not self.robot.holds(self.paper)

    def _wipe(self, end: int, *, opened: bool) -> Move:
        """The sponge at one end of the streak, across it."""
        height = SPONGE_HEIGHT / 2 + GRIP + GLIDE

        def where() -> Array:
            place = point(self.streak, 0, end * (self.reach + BEYOND), height)
            return top_down(place, yaw_of(self.streak))

        return move(where, opened=opened, touching=True)

    def _over_bin(self) -> Array:
        return _above(self.bin.mouth, OVER_BIN)

    def _paper(self) -> Array:
        return _above(self.paper.position, GRIP)

    def _sponge(self) -> Array:
        return _above(self.sponge.position, GRIP)


def _above(position: Sequence[float], height: float) -> Array:
    x, y, z = position
    return np.array([x, y, z + height])
