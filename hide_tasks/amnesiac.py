"""The perfect policy without memory: perfect perception, perfect skills, no history.

At every decision it knows the scene, the instruction and the expert's scripts of every history
that fits the instruction. Its candidates are the script points that look like the present; it
chooses among their next keyframes with weights that the certificate optimised on train.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.world import World
from hide_tasks.certificates import committed
from hide_tasks.contract import Action, EpisodeSpec, Observation
from hide_tasks.likeness import alike, likeness
from hide_tasks.script import Point, library, same_action

Options = dict[str, Point]  # by the stage that they begin, or go on with from a keyframe on
Mix = Mapping[str, Mapping[str, float]]  # by what is open, the odds of each option


def signature(points: Sequence[Point]) -> str:
    """What the scripts of an episode and its twins consist of; mixes are kept by it."""
    runs: dict[int, list[str]] = {}
    for point in points:
        runs.setdefault(point.script, []).append(point.stage)
    return " / ".join(_folded(stages) for stages in runs.values())


def _folded(stages: Sequence[str]) -> str:
    counts = [(name, stages.count(name)) for name in dict.fromkeys(stages)]
    return ", ".join(f"{name} x{count}" for name, count in counts)


def matching(points: Sequence[Point], observation: Observation) -> list[Point]:
    """The script points that look like an observation.

    When nothing looks like it (the policy has led itself astray) it is the nearest point alone.
    """
    found = [point for point in points if alike(point.observation, observation)]
    return found or [min(points, key=lambda p: likeness(p.observation, observation).distance)]


def options(points: Sequence[Point], observation: Observation) -> Options:
    """The different next keyframes of the script points that look like an observation."""
    found: Options = {}
    for point in matching(points, observation):
        if not any(same_action(point.next, other.next) for other in found.values()):
            name = f"{point.stage} from {point.within}" if point.within else point.stage
            again = f"{name} ({point.script}.{point.keyframes})"
            found[again if name in found else name] = point
    return found


class Amnesiac:
    """Chooses by the mixes of the certificate, or by those that it is given."""

    def __init__(self, mixes: Mapping[str, Mix] | None = None):
        self.mixes = mixes
        self.known: EpisodeSpec | None = None  # whose scripts it has
        self.rolls = 0  # how often it played that episode

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        """Take the episode whose scripts it may know."""
        self.spec = spec

    def know(self, spec: EpisodeSpec, points: Sequence[Point]) -> None:
        """Take the scripts of an episode as found before: finding them means playing them."""
        self.spec = self.known = spec
        self.rolls, self.points = 0, points

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Learn the scripts of this scene; nothing of this episode is kept after a decision.

        Played again, an episode gets other odds of the same mix.
        """
        if self.known != self.spec:
            self.know(self.spec, library(self.spec))
        self.rng = np.random.default_rng([policy_seed, self.rolls])
        self.rolls += 1
        mixes = committed(self.spec.task).get("mixes", {}) if self.mixes is None else self.mixes
        self.mix: Mix = mixes.get(signature(self.points), {})

    def act(self, observation: Observation) -> Action:
        """One of the candidates' next keyframes."""
        found = options(self.points, observation)
        name = self.pick(found, observation) if len(found) > 1 else next(iter(found))
        return found[name].next

    def pick(self, found: Options, observation: Observation) -> str:
        """One of the options, by the mix; all alike where it does not know them."""
        names = list(found)
        return str(self.rng.choice(names, p=odds(self.mix, names)))


def odds(mix: Mix, names: Sequence[str]) -> NDArray[np.float64]:
    """The probability of each of the options that are open; they are named in any order."""
    weights = mix.get(look(names), {})
    found = np.array([weights.get(name, 1.0) for name in names]) + 1e-12
    return np.asarray(found / found.sum())


def look(names: Sequence[str]) -> str:
    """What a mix calls a present in which these options are open."""
    return " / ".join(sorted(names))
