"""Micro-tasks: scenes drawn as points, each of which one memory can solve and no other.

No simulator: a table, a few pads, blocks and lamps, at random places that stay where they are
within an episode. Three tasks, each with decisions at which the frame looks the same whatever the
right answer is:

- `repeat`: visit the blue pad N times while the lamp is green, wait at the grey one while it is
  red, then visit the yellow one. N is told, and longer than any window; red comes at random, so the
  number of decisions does not tell the number of visits. The stage counter knows.
- `cue`: a white lid lies on one of four blocks at first; the blocks are covered for longer than any
  window; when they are bare again, return to the marked one. Only the first frame knows, and it is
  the one that looks like the present: the anchor.
- `outcome`: four pads light up at random, one a step; when the query lamp shines instead, go to the
  pad that was lit as many steps ago as was told, one to three. The window knows.

An episode is drawn from two sources of chance. `shown` decides what may be seen or is told at a
decision, `hidden` what must be remembered.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor

from seek_model.frames import Frames, Targets

Points = NDArray[np.float32]

TABLE = -0.5  # height of the table, cube
HALF = 0.1  # half a side of pads, blocks and lamps: 50 mm
HEIGHT = {"pad": 0.04, "block": 0.2, "lamp": 0.3}  # cube
PLACES = np.linspace(-0.72, 0.72, 4)  # rows and columns at which things may stand
JITTER = 0.06  # off those, either way
FRAMES = 7  # supervised of a training sequence (paper)
WINDOW = 6  # K (paper)

TABLE_COLOR = (0.55, 0.5, 0.45)
GREY, DARK, WHITE = (0.5, 0.5, 0.5), (0.2, 0.2, 0.25), (1.0, 1.0, 1.0)
RED, GREEN, BLUE, YELLOW = (0.9, 0.1, 0.1), (0.1, 0.8, 0.2), (0.1, 0.2, 0.9), (0.95, 0.85, 0.1)
BLOCKS = (RED, GREEN, BLUE, YELLOW)

COUNTS = (8, 9)  # the archive of K = 6 holds a visit before each decision, so it tells nothing
RED_SHARE = 0.2  # of the steps before each visit
COVERED = (7, 8, 9)  # steps
OUTCOME_STEPS = 10
AGO = (1, 2, 3)
NUMBER = {1: "one", 2: "two", 3: "three", 8: "eight", 9: "nine"}


class Step(NamedTuple):
    """One decision: what is seen and what is right."""

    points: Points  # (p, 3), cube
    colors: Points  # (p, 3), 0 to 1
    target: Points  # (3,), cube
    choice: int = -1  # which of the candidates is right, where memory decides; -1 elsewhere
    boundary: bool = False  # a stage ends here
    evidence: int = -1  # the step that an oracle would look back at


class Episode(NamedTuple):
    """A whole episode."""

    task: str
    instruction: str
    candidates: Points  # (c, 3), cube: the places among which memory decides
    steps: tuple[Step, ...]


# --- what stands in a scene ---------------------------------------------------------------------


@cache
def _shape(kind: str) -> Points:
    """Points of the top and the sides of a box that stands at the origin."""
    line = np.linspace(-HALF, HALF, 4)
    top = np.stack([*np.meshgrid(line, line), np.full((4, 4), HEIGHT[kind])], axis=-1)
    levels = np.arange(0.0, HEIGHT[kind], 0.07)
    sides = [
        (side if axis == 0 else along, along if axis == 0 else side, level)
        for level in levels for axis in (0, 1) for side in (-HALF, HALF) for along in line
    ]  # fmt: skip
    return np.concatenate([top.reshape(-1, 3), sides]).astype(np.float32)


def _at(x: float, y: float, height: float) -> Points:
    return np.array([x, y, height], dtype=np.float32)


@cache
def _table() -> Points:
    line = np.linspace(-0.96, 0.96, 13)
    x, y = np.meshgrid(line, line)
    return np.stack([x, y, np.full_like(x, TABLE)], axis=-1).reshape(-1, 3).astype(np.float32)


class _Thing(NamedTuple):
    kind: str
    x: float
    y: float

    @property
    def top(self) -> Points:
        return _at(self.x, self.y, TABLE + HEIGHT[self.kind])

    def surface(self) -> Points:
        return _shape(self.kind) + _at(self.x, self.y, TABLE)

    def lid(self) -> Points:
        return _shape("pad") + self.top


def _scatter(rng: Generator, kinds: Sequence[str]) -> list[_Thing]:
    cells = rng.choice(len(PLACES) ** 2, size=len(kinds), replace=False)
    off = rng.uniform(-JITTER, JITTER, size=(len(kinds), 2))
    return [
        _Thing(kind, float(PLACES[cell // 4] + dx), float(PLACES[cell % 4] + dy))
        for kind, cell, (dx, dy) in zip(kinds, cells, off, strict=True)
    ]


def _draw(*parts: tuple[Points, tuple[float, float, float]]) -> tuple[Points, Points]:
    """Points and colours of the table and of coloured parts on it."""
    parts = ((_table(), TABLE_COLOR), *parts)
    sizes = [len(points) for points, _ in parts]
    colors = np.array([color for _, color in parts], dtype=np.float32)
    return np.concatenate([points for points, _ in parts]), colors.repeat(sizes, axis=0)


# --- the three tasks ----------------------------------------------------------------------------


def repeat(shown: Generator, hidden: Generator) -> Episode:
    """Candidates: the blue pad and the yellow pad. Decisions: the last visit, and the step after.

    Chance is one half: both kinds of decision occur once an episode.
    """
    count = int(shown.choice(COUNTS))
    pad, other, waiting, lamp = _scatter(shown, ["pad", "pad", "pad", "lamp"])

    def scene(green: bool) -> tuple[Points, Points]:
        light = GREEN if green else RED
        return _draw(
            (pad.surface(), BLUE), (other.surface(), YELLOW),
            (waiting.surface(), GREY), (lamp.surface(), light),
        )  # fmt: skip

    steps: list[Step] = []
    visit = -1
    for number in range(count + 1):
        while hidden.random() < RED_SHARE:
            steps.append(Step(*scene(False), waiting.top, evidence=visit))
        last = number == count
        choice = {count - 1: 0, count: 1}.get(number, -1)
        target = other.top if last else pad.top
        steps.append(Step(*scene(True), target, choice, boundary=True, evidence=visit))
        visit = len(steps) - 1
    instruction = f"push the blue button {NUMBER[count]} times then the yellow button"
    return Episode("repeat", instruction, np.stack([pad.top, other.top]), tuple(steps))


def cue(shown: Generator, hidden: Generator) -> Episode:
    """Candidates: the four blocks. Decision: the last step. Chance is one quarter."""
    covered = int(shown.choice(COVERED))
    *blocks, left, right = _scatter(shown, ["block"] * 4 + ["pad"] * 2)
    colors = [BLOCKS[i] for i in shown.permutation(4)]
    marked = int(hidden.integers(4))

    def scene(bare: bool, lit: int, lid: int) -> tuple[Points, Points]:
        shades = colors if bare else [GREY] * 4
        pads = [WHITE if lit == number else DARK for number in (0, 1)]
        lids = [(blocks[lid].lid(), WHITE)] if lid >= 0 else []
        return _draw(
            *((block.surface(), shade) for block, shade in zip(blocks, shades, strict=True)),
            (left.surface(), pads[0]), (right.surface(), pads[1]), *lids,
        )  # fmt: skip

    steps = [Step(*scene(True, -1, marked), blocks[marked].top)]
    for lit in hidden.integers(2, size=covered).tolist():
        steps.append(Step(*scene(False, lit, -1), (left, right)[lit].top))
    steps.append(Step(*scene(True, -1, -1), blocks[marked].top, choice=marked, evidence=0))
    tops = np.stack([block.top for block in blocks])
    return Episode("cue", "return to the block that was in white at first", tops, tuple(steps))


def outcome(shown: Generator, hidden: Generator) -> Episode:
    """Candidates: the four pads. Decisions: the query steps. Chance is one quarter."""
    ago = int(shown.choice(AGO))
    *pads, lamp = _scatter(shown, ["pad"] * 4 + ["lamp"])
    # Queries lie more than three steps apart, so that none asks for another one's answer.
    first = int(shown.integers(3, 7))
    queries = range(first, OUTCOME_STEPS, 4)

    def scene(lit: int) -> tuple[Points, Points]:
        shades = [GREEN if lit == number else DARK for number in range(4)]
        return _draw(
            *((pad.surface(), shade) for pad, shade in zip(pads, shades, strict=True)),
            (lamp.surface(), DARK if lit >= 0 else YELLOW),
        )  # fmt: skip

    lit = hidden.integers(4, size=OUTCOME_STEPS).tolist()
    steps = []
    for t in range(OUTCOME_STEPS):
        if t in queries:
            right = lit[t - ago]
            steps.append(Step(*scene(-1), pads[right].top, choice=right, evidence=t - ago))
        else:
            steps.append(Step(*scene(lit[t]), pads[lit[t]].top))
    instruction = f"push the button that was green {NUMBER[ago]} steps before"
    return Episode("outcome", instruction, np.stack([pad.top for pad in pads]), tuple(steps))


TASKS: dict[str, Callable[[Generator, Generator], Episode]] = {
    "repeat": repeat,
    "cue": cue,
    "outcome": outcome,
}
CHANCE = {"repeat": 0.5, "cue": 0.25, "outcome": 0.25}


# --- batches ------------------------------------------------------------------------------------


class Cut(NamedTuple):
    """The steps of an episode up to `stop`; those from `start` on are supervised."""

    episode: Episode
    start: int
    stop: int


def draw(rng: Generator, task: str) -> Episode:
    """One episode of a task of `TASKS`."""
    shown, hidden = rng.spawn(2)
    return TASKS[task](shown, hidden)


def training_batch(
    rng: Generator, sequences: int, tasks: Sequence[str] = tuple(TASKS)
) -> tuple[Frames, Targets]:
    """Sequences of drawn tasks: seven supervised steps behind all the steps before them.

    As in training on demonstrations the seven start anywhere, with equal chance; but every second
    sequence ends with its episode, where most decisions are.
    """
    cuts = []
    for task in rng.choice(tasks, size=sequences):
        episode = draw(rng, str(task))
        last = len(episode.steps) - FRAMES
        start = int(rng.integers(last + 1)) if rng.random() < 0.5 else last
        cuts.append(Cut(episode, start, start + FRAMES))
    return collate(cuts)


def single_frames(
    rng: Generator, count: int, tasks: Sequence[str] = tuple(TASKS)
) -> tuple[Frames, Targets]:
    """As many steps as `count`, each of another scene and as if it were its episode's first."""
    cuts = []
    for task in rng.choice(tasks, size=count):
        episode = draw(rng, str(task))
        step = episode.steps[rng.integers(len(episode.steps))]
        cuts.append(Cut(episode._replace(steps=(step,)), 0, 1))
    return collate(cuts)


def collate(cuts: Sequence[Cut]) -> tuple[Frames, Targets]:
    """Cuts side by side, their ends in one column; shorter ones are padded in front."""
    steps = max(cut.stop for cut in cuts)
    present, supervised, number, rows = [], [], [], []
    for cut in cuts:
        numbers = np.arange(steps) - (steps - cut.stop)
        present.append(numbers >= 0)
        supervised.append(numbers >= cut.start)
        number.append(numbers.clip(min=0))
        rows.append([cut.episode.steps[n] if n >= 0 else None for n in numbers])
    there = torch.from_numpy(np.stack(present))
    owner = [
        np.full(len(step.points), frame)
        for frame, step in enumerate(step for row in rows for step in row)
        if step
    ]
    seen = [step for row in rows for step in row if step]
    frames = Frames(
        points=torch.from_numpy(np.concatenate([step.points for step in seen])),
        colors=torch.from_numpy(np.concatenate([step.colors for step in seen])),
        owner=torch.from_numpy(np.concatenate(owner)),
        instructions=tuple(cut.episode.instruction for cut in cuts),
        fingers=torch.tensor([1.0, 0.04, 0.04]).expand(len(cuts), steps, 3),
        pose=torch.tensor([0.0, 0, 0.5, 1, 0, 0, 0, -1, 0]).expand(len(cuts), steps, 9),
        decision=torch.from_numpy(np.stack(number)),
        present=there,
    )
    return frames, _targets(seen, there, torch.from_numpy(np.stack(supervised)))


def _targets(seen: Sequence[Step], present: Tensor, supervised: Tensor) -> Targets:
    """What is right at the steps seen, laid out where they are present."""
    nothing = torch.zeros(present.shape, dtype=torch.long)
    position = torch.zeros(*present.shape, 3)
    position[present] = torch.from_numpy(np.stack([step.target for step in seen]))
    boundary = torch.zeros(present.shape)
    boundary[present] = torch.tensor([float(step.boundary) for step in seen])
    evidence = torch.full(present.shape, -1)
    evidence[present] = torch.tensor([step.evidence for step in seen])
    return Targets(
        position=position,
        rotation=nothing[..., None].expand(*present.shape, 3),
        opening=nothing + 1,
        ignore_collisions=nothing,
        stage=(boundary.cumsum(dim=1) - boundary).long(),
        boundary=boundary,
        stop=torch.zeros(present.shape),
        evidence=evidence,
        supervised=supervised,
    )
