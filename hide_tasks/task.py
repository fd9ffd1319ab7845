"""What a task is: a scene, a hidden state, an expert, checks, and names for what went wrong.

One instance is one episode: built once, never reset.
"""

import itertools
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import ClassVar, Protocol

import numpy as np

from hide_tasks.assets.asset import Asset
from hide_tasks.contract import (
    CAMERAS,
    Category,
    Event,
    Failure,
    HiddenState,
    Keyframe,
    Value,
    Variation,
)
from hide_tasks.layout import Layout
from hide_tasks.poses import Array

Checks = dict[str, bool]
Move = Callable[[], Keyframe]  # read when it is reached: moved objects need no bookkeeping


class Arm(Protocol):
    """What a task may ask of the robot."""

    @property
    def tip_height(self) -> float:
        """The tip's height above the table, m."""

    def holds(self, asset: Asset) -> bool:
        """True while the gripper holds the asset."""

    def first_feasible(self, chains: Iterator[list[Array]]) -> int:
        """Which of the chains of tip poses is the first that the arm can follow throughout."""


@dataclass(frozen=True)
class Stage:
    """A named part of an expert's script: an annotation that cannot drift."""

    name: str
    moves: tuple[Move, ...]

    def __init__(self, name: str, *moves: Move):
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "moves", moves)


class Grid:
    """Variations as named points: every combination of the axes' values."""

    def __init__(self, **axes: tuple[Value, ...]):
        self.axes = axes

    def __len__(self) -> int:
        return math.prod(len(values) for values in self.axes.values())

    def __iter__(self) -> Iterator[Variation]:
        for point in itertools.product(*self.axes.values()):
            yield dict(zip(self.axes, point, strict=True))

    def balanced(self, count: int, rng: np.random.Generator) -> list[Variation]:
        """`count` variations in random order; each value of each axis as often as any other, ±1.

        No variation comes twice before all came once if the grid has one axis or two.
        Of three axes, none tells another if their lengths share no factor.
        """
        axes = {
            name: [values[i] for i in rng.permutation(len(values))]
            for name, values in self.axes.items()
        }
        points = [
            dict(zip(axes, self._diagonal(i, list(axes.values())), strict=True))
            for i in range(count)
        ]
        return [points[i] for i in rng.permutation(count)]

    @staticmethod
    def _diagonal(i: int, axes: list[list[Value]]) -> Iterator[Value]:
        period = 0
        for values in axes:
            shift = i // math.lcm(period, len(values)) if period else 0
            period = math.lcm(period or 1, len(values))
            yield values[(i + shift) % len(values)]


@dataclass
class Counter:
    """Counts rising edges with hysteresis; evaluated at every physics step."""

    name: str
    reading: Callable[[], float]
    up: float  # it counts when the reading rises above this
    down: float  # and again only after it fell below this
    when: Callable[[], bool] = lambda: True  # else an edge is not counted
    total: int = 0
    high: bool | None = None  # unknown before the first step: what is high then was never raised

    def watch(self) -> bool:
        """True when this step counted."""
        value = self.reading()
        if self.high is None:
            self.high = value > self.up
            return False
        if self.high:
            self.high = value >= self.down
            return False
        if value <= self.up:
            return False
        self.high = True
        counted = self.when()
        self.total += counted
        return counted


@dataclass(frozen=True)
class Moment:
    """A point of an expert's episode: after so many keyframes, in the twin with this history."""

    keyframes: int
    twin: Variation = field(default_factory=dict)


@dataclass(frozen=True)
class Alias:
    """Two moments that look the same and call for different next keyframes."""

    first: Moment
    second: Moment
    why: str


class Task(ABC):
    """A robot task. A subclass is one file; its module's name is its name."""

    category: ClassVar[Category]
    instructions: ClassVar[tuple[str, ...]]  # the paper's wording first, then its paraphrases
    variations: ClassVar[Grid]
    histories: ClassVar[Grid] = Grid()  # what an episode draws beside the paper's variation
    keyframes: ClassVar[frozenset[int]]  # the paper's counts; a script has one of them
    looks: ClassVar[tuple[str, ...]] = ()  # axes that change how things look and nothing else
    cameras: ClassVar[tuple[str, ...]] = CAMERAS  # what a policy sees through, in this order
    remembers: ClassVar[str]  # the hidden state, in one sentence
    failures: ClassVar[Mapping[Failure, str]]  # what goes wrong here, and how
    spoils: ClassVar[frozenset[Failure]] = (
        frozenset()
    )  # violations after which success is out of reach

    robot: Arm

    def __init__(self, variation: Mapping[str, Value], rng: np.random.Generator):
        self.variation = SimpleNamespace(**variation)
        self.layout = Layout(rng)
        self.counters: list[Counter] = []
        self.build()
        self.instruction = self.wording(variation)

    # --- what a task says of itself ---

    @abstractmethod
    def build(self) -> None:
        """Place the assets and set up the counters; the same draws for every variation."""

    @abstractmethod
    def hidden_state(self) -> HiddenState:
        """z: what the history determines and the present picture does not show."""

    @abstractmethod
    def stage(self) -> str:
        """The name of the expert's stage that the world calls for now."""

    @abstractmethod
    def expert(self) -> Iterator[Stage]:
        """The script."""

    def detours(self) -> list[Iterator[Stage]]:
        """Other scripts that do it right, for a policy that comes off the expert's way."""
        return []

    @abstractmethod
    def checks(self) -> Checks:
        """The named conditions of success."""

    @abstractmethod
    def missing(self) -> Failure:
        """Why it is not done yet."""

    def violations(self) -> list[Failure]:
        """What has been done wrong so far; each spoils `exact`."""
        return []

    @abstractmethod
    def aliases(self) -> list[Alias]:
        """Pairs of moments of this episode and its twins that look the same; none if none do."""

    # --- what every task has ---

    @classmethod
    def task_name(cls) -> str:
        """The name of its file."""
        return cls.__module__.rsplit(".", 1)[-1]

    @classmethod
    def axes(cls) -> dict[str, tuple[Value, ...]]:
        """Everything that is chosen for an episode: the variation's axes and its history's."""
        return {**cls.variations.axes, **cls.histories.axes}

    @classmethod
    def told(cls) -> tuple[str, ...]:
        """The axes that change the instruction."""
        axes = cls.axes()
        first = {axis: values[0] for axis, values in axes.items()}
        return tuple(
            axis
            for axis, values in axes.items()
            if len({cls.wording({**first, axis: value}) for value in values}) > 1
        )

    @classmethod
    def hidden_axes(cls) -> dict[str, tuple[Value, ...]]:
        """The axes that neither the instruction names nor the picture shows."""
        known = {*cls.told(), *cls.looks}
        return {axis: values for axis, values in cls.axes().items() if axis not in known}

    @classmethod
    def words(cls, variation: Mapping[str, Value]) -> Mapping[str, Value]:
        """What fills the slots of the instructions: the variation's own values."""
        return variation

    @classmethod
    def wording(cls, variation: Mapping[str, Value], paraphrase: int = 0) -> str:
        """The instruction for a variation."""
        text = cls.instructions[paraphrase].format(**cls.words(variation))
        return re.sub(r"\b1 times\b", "1 time", text)

    @classmethod
    def budget(cls) -> int:
        """How many decisions an episode may take: 1.5 times the longest script, at least 25."""
        return max(25, math.ceil(1.5 * max(cls.keyframes)))

    def count(
        self,
        name: str,
        reading: Callable[[], float],
        *,
        up: float,
        down: float,
        when: Callable[[], bool] = lambda: True,
    ) -> Counter:
        """A counter that is watched at every physics step."""
        counter = Counter(name, reading, up, down, when)
        self.counters.append(counter)
        return counter

    def watch(self, time: float) -> list[Event]:
        """What was counted at this step."""
        return [
            Event(time=time, name=counter.name, total=counter.total)
            for counter in self.counters
            if counter.watch()
        ]
