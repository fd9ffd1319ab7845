"""The built-in policies. Expert and amnesiac are privileged: they see the world itself."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from hide_tasks.amnesiac import Amnesiac
from hide_tasks.bullet.world import World
from hide_tasks.contract import Action, EpisodeSpec, Keyframe, Observation, Policy, Stop
from hide_tasks.dense import DenseExpert
from hide_tasks.layout import BOUNDS
from hide_tasks.motion.general import top_down
from hide_tasks.script import script

LOWEST = 0.77  # m, where random poses begin: a finger over the table


class Expert:
    """The task's script."""

    def bind(self, world: World, spec: EpisodeSpec) -> None:
        """Take the world to look into."""
        self.world = world

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Start the script."""
        self.script = script(self.world.task)

    def act(self, observation: Observation) -> Action:
        """The next keyframe of the script."""
        return next(self.script)[1]


class Random:
    """Random poses over the table, tool down."""

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Seed the episode's own generator."""
        self.rng = np.random.default_rng(policy_seed)

    def act(self, observation: Observation) -> Action:
        """A uniform pose in the workspace with open or shut fingers."""
        low, high = np.array(BOUNDS).T
        low[2] = LOWEST
        pose = top_down(self.rng.uniform(low, high), self.rng.uniform(-np.pi / 2, np.pi / 2))
        return Keyframe.at(pose, opening=float(self.rng.integers(2)))


class Noop:
    """Stays where it is until the budget is spent."""

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Action:
        """The pose that the arm has."""
        return Keyframe.at(
            observation.gripper_pose, opening=observation.gripper_opening, ignore_collisions=True
        )


class Replay:
    """Repeats recorded actions, then stops."""

    def __init__(self, actions: Sequence[Action]):
        self.actions = actions

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Back to the first action."""
        self.left = iter(self.actions)

    def act(self, observation: Observation) -> Action:
        """The next recorded action."""
        return next(self.left, Stop())


_MAKERS: dict[str, Callable[[], Policy]] = {
    "expert": Expert,
    "amnesiac": Amnesiac,
    "random": Random,
    "noop": Noop,
    "expert-joint-position": partial(DenseExpert, "joint_position"),
    "expert-ee-delta": partial(DenseExpert, "ee_delta"),
}
BUILTIN = tuple(_MAKERS)


def make(name: str) -> Policy:
    """A built-in policy by name.

    Raises:
        ValueError: there is none of this name.
    """
    if name not in _MAKERS:
        raise ValueError(f"No built-in policy '{name}'. All: {', '.join(BUILTIN)}.")
    return _MAKERS[name]()
