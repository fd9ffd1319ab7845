"""One episode of the dense expert for LeRobot: played, judged, kept in a folder of its own."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hide_tasks import lerobot_format as form
from hide_tasks import lerobot_video as video
from hide_tasks.contract import (
    CONTROL_HZ,
    EpisodeResult,
    EpisodeSpec,
    HiddenState,
    Observation,
)
from hide_tasks.demos import DemosError

if TYPE_CHECKING:
    from hide_tasks.bullet.world import World
    from hide_tasks.dense import Motion
    from hide_tasks.script import Step

FRAMES, PIXELS, ABOUT = "frames.parquet", "pixels.npy", "episode.json"


@dataclass
class _Frames:
    """What is seen, and what is hidden, before every row of a motion."""

    observations: list[Observation] = field(default_factory=list)
    steps: list["Step"] = field(default_factory=list)
    hidden: list[HiddenState] = field(default_factory=list)

    def __call__(self, world: "World", step: "Step") -> None:
        self.observations.append(world.observe())
        self.steps.append(step)
        self.hidden.append(world.task.hidden_state())


def record(spec: EpisodeSpec, folder: Path) -> None:
    """Plays an episode and writes its videos, frames and facts into a folder.

    Raises:
        DemosError: the motion is not exact when it is replayed as rows of joint_position.
    """
    from hide_tasks.dense import DenseError, motion
    from hide_tasks.episode import play
    from hide_tasks.policies import Replay

    frames = _Frames()
    try:
        found = motion(spec, frames)
    except DenseError as error:
        raise DemosError(f"{spec.name}: {error}.") from None
    result, _ = play(spec, Replay(found.chunks("joint_position")))
    if not result.exact:
        raise DemosError(f"{spec.name}: the dense expert was not exact: {result.failure}.")
    folder.mkdir(parents=True)
    _write(folder, spec, frames, found, result)


def _write(
    folder: Path, spec: EpisodeSpec, frames: _Frames, found: "Motion", result: EpisodeResult
) -> None:
    import pyarrow.parquet as pq

    pixels = []
    for camera in frames.observations[0].views:
        images = np.array([seen.views[camera].rgb for seen in frames.observations])
        video.write(folder / f"{form.VIDEOS[camera]}.mp4", images)
        pixels.append(form.histograms(images))
    np.save(folder / PIXELS, np.array(pixels))
    pq.write_table(form.frames_table(_columns(frames, found)), folder / FRAMES)
    (folder / ABOUT).write_text(json.dumps(_about(spec, result), indent=1) + "\n")


def _columns(frames: _Frames, found: "Motion") -> dict[str, Any]:
    """Every column; the numbers of frame, episode and task in the whole set come later."""
    count, seen = len(found), frames.observations
    numbers = np.arange(count)
    return {
        "observation.state": [[*one.joint_positions, one.gripper_opening] for one in seen],
        "observation.tip_pose": [one.gripper_pose for one in seen],
        "action": found.rows("joint_position"),
        "ee_delta": found.rows("ee_delta"),
        "stage": [step.number for step in frames.steps],
        "stage_name": [step.stage for step in frames.steps],
        "hidden_state": [json.dumps(state, sort_keys=True) for state in frames.hidden],
        "timestamp": (numbers / CONTROL_HZ).astype(np.float32),
        "frame_index": numbers,
        **{name: np.zeros(count, np.int64) for name in ("episode_index", "index", "task_index")},
    }


def _about(spec: EpisodeSpec, result: EpisodeResult) -> dict[str, Any]:
    return {
        "name": spec.name,
        "hide_task": spec.task,
        "split": spec.split,
        "split_index": spec.index,
        "variation": json.dumps(spec.variation, sort_keys=True),
        "instruction": result.instruction,
        "success": result.success,
        "exact": result.exact,
        "scene_hash": result.scene_hash,
        "final_state_hash": result.final_state_hash,
    }


@dataclass(frozen=True)
class Part:
    """An episode that was recorded."""

    folder: Path

    @property
    def about(self) -> dict[str, Any]:
        """Its name, verdicts and what else identifies it."""
        return dict(json.loads((self.folder / ABOUT).read_text()))

    @property
    def histograms(self) -> Any:
        """(c, 3, 256) how many pixels of a camera have each value."""
        return np.load(self.folder / PIXELS)

    def columns(self) -> dict[str, Any]:
        """Its frames: arrays (n, …), or lists of strings."""
        import pyarrow.parquet as pq

        return dict(self._columns_of(pq.read_table(self.folder / FRAMES)))

    def _columns_of(self, table: Any) -> Iterator[tuple[str, Any]]:
        for name in table.column_names:
            column = table.column(name).combine_chunks()
            if name in form.VECTORS:
                width = len(form.VECTORS[name])
                yield name, column.flatten().to_numpy().reshape(-1, width)
            elif form.SCALARS[name] == "string":
                yield name, column.to_pylist()
            else:
                yield name, column.to_numpy()

    @property
    def videos(self) -> list[str]:
        """The keys of its cameras, in their order."""
        return [key for key in form.VIDEOS.values() if self.video(key).is_file()]

    def video(self, key: str) -> Path:
        """What a camera saw."""
        return self.folder / f"{key}.mp4"
