"""SEEK as a policy of the play loop: reset, act, and what it believes."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hide_tasks.contract import Attention, Belief, Keyframe, Observation
from hide_tasks.layout import BOUNDS
from seek_model import checkpoint, rotations
from seek_model.checkpoint_header import BadCheckpoint
from seek_model.clouds import cloud_of, from_cube, to_cube
from seek_model.coarse import Pending, Recalled
from seek_model.config import Config
from seek_model.frames import Frames, Targets
from seek_model.memory import Archive
from seek_model.network import Network, Predictions
from seek_model.views import LOOKS

CPU = torch.device("cpu")
FINGER = 0.04  # m from shut to open, each
MOVED = 0.002  # m that the tip has moved when a plan was carried out
TURNED = 1.0  # degrees
DIGITS = 4  # of positions in m, so that they do not depend on the last bits of a sum


class SeekPolicy:
    """A policy of the contract. One instance plays many episodes, one after the other.

    A decision is remembered once it was carried out (models.md A11): at the next observation, if
    the arm moved or was not asked to. An action for which no path was found leaves no trace, so
    the same would be chosen again, for ever: the next one is told to ignore collisions if that one
    was not, and not to if it was.
    """

    def __init__(self, network: Network, config: Config, device: torch.device = CPU):
        self.network, self.config, self.device = network.eval().to(device), config, device
        self.reset("", 0)

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Forget everything."""
        self._archives: list[Archive] = self.network.begin(1, [policy_seed])
        self._pending: Pending | None = None
        self._asked: tuple[NDArray[np.float64], Keyframe] | None = None
        self._decision = 0
        self._belief: Belief | None = None

    @torch.no_grad()
    def act(self, observation: Observation) -> Keyframe:
        """The next keyframe."""
        in_vain = self._settle(observation.gripper_pose)
        frames = frames_of(observation, self._decision, self.config).to(self.device)
        predictions, self._pending = self.network.play(frames, self._archives, self.told())
        action = keyframe(predictions)
        if in_vain:
            other = not in_vain.ignore_collisions
            action = action.model_copy(update={"ignore_collisions": other})
        self._asked = observation.gripper_pose, action
        self._decision += 1
        self._belief = self._believed(predictions)
        return action

    def told(self) -> Targets | None:
        """What somebody tells it of the stages that are done and of the evidence: nothing."""
        return None

    def belief(self) -> Belief | None:
        """What it held to be true when it chose its last action; None without a memory."""
        return self._belief

    def _settle(self, pose: NDArray[np.float64]) -> Keyframe | None:
        """Remembers the last decision if it was carried out; its action if it was not."""
        memory, in_vain = self.config.model.memory, None
        if self._asked and not carried_out(self._asked[0], self._asked[1].pose, pose):
            in_vain = self._asked[1]
        always = memory is not None and memory.commit == "always"
        if self._pending and (always or not in_vain):
            self._pending.commit()
        self._pending = None
        return in_vain

    def _believed(self, predictions: Predictions) -> Belief | None:
        said, recalled = predictions.coarse, predictions.coarse.recalled
        if recalled is None or self.config.model.memory is None:
            return None
        memory, anchor = self.config.model.memory, recalled.slots.anchors[0]
        return Belief(
            stage_count=int(said.done[0]) if memory.stages else None,
            boundary=None if said.boundary is None else _share(said.boundary[0].sigmoid()),
            window=tuple(recalled.slots.windows[0]) if memory.window else None,
            anchor_index=anchor.entry.decision if anchor else None,
            anchor_similarity=round(anchor.similarity, DIGITS) if anchor else None,
            attention=attention_of(recalled, memory.window),
        )


def load(path: Path | str) -> SeekPolicy:
    """The policy of a checkpoint, on the first GPU if there is one.

    Raises:
        BadCheckpoint: the first thing that is wrong with the file.
        OSError: it cannot be read.
    """
    network, config, _ = checkpoint.load(Path(path))
    if config.model.memory and config.model.memory.anchor == "oracle":
        raise BadCheckpoint(
            f"config: {config.name} looks back where the demonstration's annotation says; "
            "it can be validated, but there is no annotation when it plays"
        )
    return SeekPolicy(network, config, torch.device("cuda") if torch.cuda.is_available() else CPU)


def carried_out(
    before: NDArray[np.float64], asked: NDArray[np.float64], after: NDArray[np.float64]
) -> bool:
    """True unless the arm was asked to move and stands where it stood; poses (7,) of the tip.

    This is all that a policy can know: no outcome is part of an observation.
    """
    return _apart(before, after) or not _apart(before, asked)


def _apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    moved = float(np.linalg.norm(one[:3] - other[:3])) > MOVED
    return moved or float(rotations.angle_between(one[3:], other[3:])) > TURNED


def frames_of(observation: Observation, decision: int, config: Config) -> Frames:
    """An observation as the network sees it: one sequence of one step."""
    views = config.model.views
    cloud = cloud_of(observation, views.points, views.voxel)
    points = torch.from_numpy(to_cube(cloud.points))
    pose, opening = observation.gripper_pose, float(observation.gripper_opening)
    placed = np.concatenate([to_cube(pose[:3]), rotations.six(pose[3:])])
    fingers = torch.tensor([opening, opening * FINGER, opening * FINGER])
    return Frames(
        points=points,
        colors=torch.from_numpy(cloud.colors).float() / 255,
        owner=torch.zeros(len(points), dtype=torch.long),
        instructions=[observation.instruction],
        fingers=fingers[None, None],
        pose=torch.from_numpy(placed).float()[None, None],
        decision=torch.tensor([[decision]]),
        present=torch.ones(1, 1, dtype=torch.bool),
    )


def keyframe(predictions: Predictions) -> Keyframe:
    """The action of a single frame's predictions."""
    said, place = predictions.said, predictions.position
    assert said is not None and place is not None, "a network plays with all of its branches"
    bins = said.rotation[0].argmax(dim=-1).cpu().numpy()
    stop = predictions.coarse.stop
    low, high = np.array(BOUNDS).T
    position = np.clip(from_cube(place[0].double().cpu().numpy()), low, high).round(DIGITS)
    return Keyframe.at(
        np.concatenate([position, rotations.decode(bins)]),
        opening=float(said.opening[0].argmax()),
        ignore_collisions=bool(said.ignore_collisions[0].argmax()),
        stop=stop is not None and bool(stop[0] > 0),
    )


def attention_of(recalled: Recalled, window: int) -> tuple[Attention, ...]:
    """How each view's look back was shared among the memories that there were."""
    present = recalled.slots.present[0].tolist()
    names = [f"window {age + 1}" for age in range(window)]
    names += ["anchor"] * (len(present) - window)
    slots = [*zip(names, present, strict=True), ("stage", True)]
    return tuple(
        Attention(view=look.name, slot=name, weight=_share(weight))
        for look, weights in zip(LOOKS, recalled.attention[0], strict=False)
        for (name, there), weight in zip(slots, weights, strict=True)
        if there
    )


def _share(value: Tensor | float) -> float:
    return round(min(max(float(value), 0.0), 1.0), DIGITS)
