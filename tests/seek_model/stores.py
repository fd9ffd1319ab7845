"""Small demonstrations and stores without a simulator.

One camera pattern looks straight down at a level plate, so the plate's height and colour tell
which keyframe a point belongs to.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from hide_tasks.contract import CAMERAS, IMAGE_SIZE, EpisodeResult, EpisodeSpec
from hide_tasks.demos import DEPTH_UNIT, Demonstration, Folder, evidence_of, write
from seek_model.store import Store, build

CAMERA_HEIGHT = 1.9  # m
FOCAL = 150.0  # pixels
SHADE = 10  # by which colours of consecutive keyframes differ


def plate_height(keyframe: int) -> float:
    """m."""
    return 0.9 - 0.01 * keyframe


def demonstration(
    task: str = "count", split: str = "train", index: int = 0, keyframes: int = 5
) -> Demonstration:
    """Stages of two keyframes each; the hidden state changes with every second keyframe."""
    rng = np.random.default_rng([index, keyframes, *task.encode()])
    times = np.arange(keyframes)
    variation = {"count": index}
    shape = (keyframes, len(CAMERAS), IMAGE_SIZE, IMAGE_SIZE)
    depth = np.array([CAMERA_HEIGHT - plate_height(t) for t in times]) / DEPTH_UNIT
    position = rng.uniform((0.0, -0.2, 0.8), (0.4, 0.2, 1.2), (keyframes, 3))
    turn = rng.normal(size=(keyframes, 4))
    action = np.concatenate([position, turn / np.linalg.norm(turn, axis=1, keepdims=True)], axis=1)
    hidden = tuple({"done": int(t // 2)} for t in times)
    return Demonstration(
        spec=EpisodeSpec(task=task, split=split, index=index, variation=variation),
        sources="0" * 64,
        result=_result(task, split, index, variation, keyframes),
        stages=tuple(f"stage {t // 2}" for t in times),
        hidden=hidden,
        rgb=np.broadcast_to((SHADE * times)[:, None, None, None, None], (*shape, 3)).astype("u1"),
        depth=np.broadcast_to(depth.round()[:, None, None, None], shape).astype(np.uint16),
        intrinsics=_per_camera(keyframes, [[FOCAL, 0, 64], [0, FOCAL, 64], [0, 0, 1]]),
        camera_to_world=_per_camera(
            keyframes, [[1, 0, 0, 0.2], [0, -1, 0, 0], [0, 0, -1, CAMERA_HEIGHT], [0, 0, 0, 1]]
        ),
        gripper_pose=np.roll(action, 1, axis=0),
        gripper_opening=rng.uniform(size=keyframes),
        joint_positions=rng.normal(size=(keyframes, 7)),
        action_pose=action,
        action_opening=(times % 2).astype(np.float64),
        ignore_collisions=times % 3 == 1,
        stop=times == keyframes - 1,
        stage=times // 2,
        boundary=(times % 2 == 1) | (times == keyframes - 1),
        evidence=evidence_of(hidden),
    )


def _per_camera(keyframes: int, matrix: list[list[float]]) -> np.ndarray:
    return np.tile(np.array(matrix, np.float64), (keyframes, len(CAMERAS), 1, 1))


def _result(task, split, index, variation, decisions) -> EpisodeResult:
    return EpisodeResult(
        task=task,
        split=split,
        index=index,
        variation=variation,
        instruction=f"{task} to {index}",
        success=True,
        exact=True,
        failure=None,
        decisions=decisions,
        stage="",
        scene_hash="",
        final_state_hash="",
    )


def record(path: Path, keyframes: Mapping[tuple[str, str], list[int]]) -> Path:
    """A folder of demonstrations: for every task and split, how many keyframes each has."""
    tasks, splits = ({key[i] for key in keyframes} for i in (0, 1))
    folder = Folder(path, dict.fromkeys(tasks, "0" * 64), tuple(splits))
    folder.write()
    for (task, split), counts in keyframes.items():
        for index, count in enumerate(counts):
            made = demonstration(task, split, index, count)
            write(made, folder.file(made.spec))
    return path


def store(path: Path, keyframes: Mapping[tuple[str, str], list[int]]) -> Store:
    """The store of such a folder, with about a hundred points a keyframe."""
    return build(record(path / "demos", keyframes), path / "store", points=100, voxel=0.05)


def changed(made: Demonstration, name: str, where: object, value: object) -> Demonstration:
    """The same with other values in one array."""
    array = getattr(made, name).copy()
    array[where] = value
    return replace(made, **{name: array})
