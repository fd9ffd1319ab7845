"""When the hidden state of an episode changed: a witness that is let into the world by a policy.

A witness is shown poses and decisions, and a dense action lasts up to ten seconds. The world is
handed to policies alone, so a policy's wrapper hands it on to the witness, which then looks at
every frame.
"""

import base64
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hide_tasks.contract import (
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    HiddenState,
    Observation,
    Policy,
    Start,
)
from workers.protocol import HiddenChange

if TYPE_CHECKING:  # whoever reads a trace needs no simulator
    from hide_tasks.bullet.scene import Part
    from hide_tasks.bullet.world import World

THUMBNAIL_CAMERA = "front"
THUMBNAIL_QUALITY = 80  # of a JPEG


class HiddenTrace:
    """Witnesses one episode that is played by `watching(policy)`."""

    start: Start
    thumbnail: bytes  # JPEG, base64

    def __init__(self) -> None:
        self.changes: list[HiddenChange] = []
        self._decision = 0
        self._world: World | None = None

    def watching(self, policy: Policy) -> Policy:
        """The policy; this witness sees the world that it is bound to."""
        return _Bound(policy, self)

    def look_into(self, world: "World") -> None:
        """Take the world to look into."""
        self._world = world

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence["Part"], start: Start
    ) -> None:
        """Take what is true before the first decision."""
        self.start = start
        self._note(0.0, start.stage, start.hidden)

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Look at the hidden state."""
        if self._world:
            self._note(time, self._world.task.stage(), self._world.task.hidden_state())

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """Take what came after the last frame of the decision."""
        self._note(record.time, record.stage, record.hidden)
        self._decision = record.decision + 1

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """Take the last picture."""
        self._world = None
        self.thumbnail = base64.b64encode(_jpeg(observation.views[THUMBNAIL_CAMERA].rgb))

    def _note(self, time: float, stage: str, hidden: HiddenState) -> None:
        seen = HiddenChange(
            time=round(time, 6), decision=self._decision, stage=stage, hidden=hidden
        )
        if not self.changes or (seen.stage, seen.hidden) != _state(self.changes[-1]):
            self.changes.append(seen)


class _Bound:
    """A policy whose world is told to a trace as well; it has a belief only if the policy has."""

    def __init__(self, policy: Policy, trace: HiddenTrace):
        self._policy, self._trace = policy, trace
        if hasattr(policy, "belief"):
            self.belief = policy.belief

    def bind(self, world: "World", spec: EpisodeSpec) -> None:
        self._trace.look_into(world)
        if hasattr(self._policy, "bind"):
            self._policy.bind(world, spec)

    def reset(self, instruction: str, policy_seed: int) -> None:
        self._policy.reset(instruction, policy_seed)

    def act(self, observation: Observation) -> Any:
        return self._policy.act(observation)


def _state(change: HiddenChange) -> tuple[str, HiddenState]:
    return change.stage, change.hidden


def _jpeg(rgb: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "JPEG", quality=THUMBNAIL_QUALITY)
    return file.getvalue()
