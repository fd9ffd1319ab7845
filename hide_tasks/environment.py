"""Every task as a Gymnasium environment: importing this module registers `hide/<task>-v1`.

    import gymnasium
    import hide_tasks.environment

    environment = gymnasium.make("hide/push_button_times-v1", split="val")

The suite's name is the namespace, its version the version: `hide-hard/…-v1`, `real4/…-v1`. An
environment plays by the code that evaluations play by, so the same actions end in the same state.
"""

import string
from typing import Any, cast, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hide_tasks import SUITES, load, suite
from hide_tasks.bullet.cameras import camera
from hide_tasks.bullet.joint_space import LOWER, UPPER
from hide_tasks.bullet.world import World
from hide_tasks.contract import (
    IMAGE_SIZE,
    Action,
    ActionMode,
    CameraView,
    EpisodeSpec,
    InvalidAction,
    Keyframe,
    Observation,
    Rules,
    Split,
    parse_action,
)
from hide_tasks.episode import Episode, budget_of
from hide_tasks.layout import BOUNDS

FARTHEST = 4.5  # m, where the background of a depth image is at most
REACH = 2.0  # m that the tip can be from the origin
RENDERED = 512  # pixels, both ways, of `render`
MOVE, TURN = 0.05, 0.5  # m and rad of one row of ee_delta, either way


class HideEnvironment(gymnasium.Env[dict[str, Any], NDArray[np.float64]]):
    """One task; every reset is another episode of a split.

    Observations are those of a policy (`contract.Observation`): per camera of the task `rgb`,
    `depth` (m), `intrinsics` and `camera_to_world`; `gripper_pose`, `gripper_opening`,
    `joint_positions`, `instruction`. Nothing hidden is among them; `info` tells it: `episode`,
    `stage`, `hidden`, `checks`, `success`, and, when the episode is over, `result`.

    An action is a row of numbers whose last two are the opening (from 0.5 on: open) and stop
    (from 0.5 on: the episode ends after it), with what its mode needs before them:

    - `keyframe`: position (m), quaternion x y z w; between these and the opening 1 to let the
      planner touch things; one step is one planned motion.
    - `joint_position`: seven joints (rad); one step is a 20th of a second.
    - `ee_delta`: displacement (m) and rotation vector (rad) of the tip in the world frame; one
      step is a 20th of a second.

    The reward is 1 at the step where success is reached, else 0. An episode terminates when
    nothing can change its verdicts any more, and is truncated when its budget is spent in vain.
    """

    metadata = {  # noqa: RUF012, as in its base
        "render_modes": ["rgb_array"],
        "render_fps": 20,
    }

    def __init__(
        self,
        task: str,
        *,
        split: Split = "train",
        action_mode: ActionMode = "keyframe",
        rules: Rules = "hide",
        render_mode: str | None = None,
    ):
        """An environment of a task.

        Raises:
            UnknownTask: no suite has it.
            ValueError: no such split, action mode, rules or render mode.
        """
        for name, value, known in (
            ("split", split, tuple(suite.SPLITS)),
            ("action_mode", action_mode, get_args(ActionMode)),
            ("rules", rules, get_args(Rules)),
            ("render_mode", render_mode, (None, *self.metadata["render_modes"])),
        ):
            if value not in known:
                raise ValueError(f"No {name} {value!r}. There are {', '.join(map(str, known))}.")
        self.task, self.split, self.action_mode, self.rules = task, split, action_mode, rules
        self.render_mode = render_mode
        self.observation_space = observation_space(load(task).cameras)
        self.action_space = action_space(action_mode)
        self._world: World | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the episode that `options` name by its `index`, else one that the seed draws.

        Raises:
            ValueError: `options` hold something else, or the split has no such episode; the
                episode that was begun goes on.
        """
        super().reset(seed=seed)
        spec = suite.episode(self.task, self.split, self._index({} if options is None else options))
        self.close()
        self._world = World(suite.build(spec))
        self._episode = Episode(spec, self._world, self.rules, budget_of(spec, self.rules))
        self._seen = self._world.observe()
        return as_dict(self._seen), self._info(spec)

    def step(
        self, action: NDArray[np.float64]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action.

        Raises:
            InvalidAction: not a row of numbers of the action space's width, not finite, or with
                a quaternion of no length; nothing has moved.
            gymnasium.error.ResetNeeded: the episode is over, or none was begun.
        """
        if self._world is None or self._episode.over():
            raise gymnasium.error.ResetNeeded("The episode is over; call reset() first.")
        before = self._world.success
        self._episode.take(self._seen, self._parsed(action))
        self._seen = self._world.observe()
        over, vain = self._episode.over(), bool(self._episode.spent_in_vain())
        reward = float(self._world.success and not before)
        info = self._info(self._episode.spec)
        return as_dict(self._seen), reward, over and not vain, over and vain, info

    def render(self) -> NDArray[np.uint8]:
        """(512, 512, 3) what the front camera sees.

        Raises:
            gymnasium.error.ResetNeeded: no episode was begun.
        """
        if self._world is None:
            raise gymnasium.error.ResetNeeded("There is nothing to see; call reset() first.")
        front = camera("front", RENDERED, RENDERED)
        images = self._world.renderer.render([front], self._world.poses())
        return cast("NDArray[np.uint8]", images.rgb[0])

    def close(self) -> None:
        """Free the simulator."""
        if self._world is not None:
            self._world.scene.close()
            self._world = None

    def _index(self, options: dict[str, Any]) -> int:
        if not isinstance(options, dict):
            raise ValueError(f'Options are {options!r}; expected a dictionary as {{"index": 3}}.')
        if others := options.keys() - {"index"}:
            raise ValueError(f"No option {', '.join(sorted(map(str, others)))}; there is index.")
        if "index" in options:
            index = options["index"]
            if isinstance(index, bool) or not isinstance(index, int | np.integer):
                raise ValueError(f"Option index is {index!r}; expected a whole number.")
            return int(index)
        return int(self.np_random.integers(suite.SPLITS[self.split]))

    def _parsed(self, action: NDArray[np.float64]) -> Action:
        try:
            row = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            raise InvalidAction(f"The action is no row of numbers: {action!r}.") from None
        if row.shape != self.action_space.shape:
            raise InvalidAction(
                f"The action has shape {row.shape}; expected {self.action_space.shape} "
                f"of {self.action_mode}."
            )
        return parse_action(_fields(self.action_mode, row.tolist()))

    def _info(self, spec: EpisodeSpec) -> dict[str, Any]:
        assert self._world is not None
        task = self._world.task
        info: dict[str, Any] = {
            "episode": spec.name,
            "stage": task.stage(),
            "hidden": task.hidden_state(),
            "checks": task.checks(),
            "success": self._world.success,
        }
        if self._episode.over():
            info["result"] = self._episode.result().model_dump(mode="json", exclude={"timing"})
        return info


def observation_space(cameras: tuple[str, ...]) -> spaces.Dict:
    """Of a task that is seen by these cameras."""
    view: dict[str, spaces.Space[Any]] = {
        "rgb": spaces.Box(0, 255, (IMAGE_SIZE, IMAGE_SIZE, 3), np.uint8),
        "depth": spaces.Box(0.0, FARTHEST, (IMAGE_SIZE, IMAGE_SIZE), np.float32),
        "intrinsics": spaces.Box(0.0, 4.0 * IMAGE_SIZE, (3, 3), np.float64),
        "camera_to_world": spaces.Box(-FARTHEST, FARTHEST, (4, 4), np.float64),
    }
    found: dict[str, spaces.Space[Any]] = {name: spaces.Dict(view) for name in cameras}
    found |= {
        "gripper_pose": spaces.Box(-REACH, REACH, (7,), np.float64),
        "gripper_opening": spaces.Box(0.0, 1.0, (1,), np.float64),
        "joint_positions": spaces.Box(-np.pi, 1.25 * np.pi, (7,), np.float64),
        "instruction": spaces.Text(400, charset=string.printable),
    }
    return spaces.Dict(found)


def action_space(mode: ActionMode) -> spaces.Space[NDArray[np.float64]]:
    """Of an action mode: the bounds to sample from; what lies beyond them is taken, too."""
    low, high = np.array(BOUNDS).T
    limits = {
        "keyframe": ([*low, -1, -1, -1, -1, 0], [*high, 1, 1, 1, 1, 1]),
        "joint_position": (list(LOWER), list(UPPER)),
        "ee_delta": ([-MOVE] * 3 + [-TURN] * 3, [MOVE] * 3 + [TURN] * 3),
    }[mode]
    least, most = (np.array(values, np.float64) for values in limits)
    box = spaces.Box(np.append(least, [0, 0]), np.append(most, [1, 1]), dtype=np.float64)
    return cast("spaces.Space[NDArray[np.float64]]", box)


def as_dict(observation: Observation) -> dict[str, Any]:
    """An observation as an element of `observation_space`."""
    return {name: _view(view) for name, view in observation.views.items()} | {
        "gripper_pose": observation.gripper_pose,
        "gripper_opening": np.array([observation.gripper_opening]),
        "joint_positions": observation.joint_positions,
        "instruction": observation.instruction,
    }


def as_row(action: Keyframe) -> NDArray[np.float64]:
    """A keyframe as an element of the action space of mode `keyframe`."""
    flags = [action.ignore_collisions, action.opening, action.stop]
    return np.array([*action.position, *action.quaternion, *flags], np.float64)


def _view(view: CameraView) -> dict[str, NDArray[Any]]:
    return {
        "rgb": view.rgb,
        "depth": view.depth,
        "intrinsics": view.intrinsics,
        "camera_to_world": view.camera_to_world,
    }


def _fields(mode: ActionMode, row: list[float]) -> dict[str, Any]:
    *motion, opening, stop = row
    if mode == "keyframe":
        return {
            "kind": mode,
            "position": motion[:3],
            "quaternion": motion[3:7],
            "ignore_collisions": motion[7] >= 0.5,
            "opening": opening,
            "stop": stop >= 0.5,
        }
    return {"kind": mode, "chunk": [[*motion, opening]], "stop": stop >= 0.5}


for _suite, _tasks in SUITES.items():
    for _task in _tasks:
        gymnasium.register(
            f"{_suite}/{_task}-v{suite.VERSION}",
            "hide_tasks.environment:HideEnvironment",
            kwargs={"task": _task},
        )
