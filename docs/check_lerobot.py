"""Loads an export of `hide demos --format lerobot` with LeRobot's own package, and looks at it.

Run it with the Python of an environment that has lerobot; it needs nothing of HIDE-SEEK:
    python docs/check_lerobot.py DIR [--reads 200]

Every frame's columns, all cameras, chunks of actions at 20 Hz, the statistics, a policy's
view of the features and a DataLoader are tried. Prints what was found and frames read a second;
exit status 1 and a message when something is not as it should be.
"""

import argparse
import json
import os
import random
import sys
from pathlib import Path
from time import perf_counter

os.environ["HF_HUB_OFFLINE"] = "1"  # before the packages are imported

import torch
from lerobot.configs.types import FeatureType
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.utils import dataset_to_policy_features
from torch.utils.data import DataLoader

WIDTHS = {"observation.state": 8, "observation.tip_pose": 7, "action": 8, "ee_delta": 7}
CHUNK = 10


def require(true: bool, message: str) -> None:
    """Ends the check unless something is as it should be."""
    if not true:
        sys.exit(f"check_lerobot: {message}")


def check_frame(frame: dict, at: int, cameras: list[str]) -> None:
    """What one item holds."""
    for camera in cameras:
        image = frame[camera]
        require(image.shape == (3, 128, 128), f"frame {at}: {camera} is {tuple(image.shape)}")
        require(image.dtype == torch.float32, f"frame {at}: {camera} is {image.dtype}")
        require(image.min() >= 0 and image.max() <= 1, f"frame {at}: {camera} is not in 0 to 1")
        require(image.std() > 0.02, f"frame {at}: {camera} shows nothing")
    for name, width in WIDTHS.items():
        require(frame[name].shape == (width,), f"frame {at}: {name} is {frame[name].shape}")
        require(frame[name].dtype == torch.float32, f"frame {at}: {name} is {frame[name].dtype}")
    require(isinstance(frame["task"], str) and frame["task"] != "", f"frame {at}: no task")
    require(isinstance(frame["stage_name"], str), f"frame {at}: no name of the stage")
    require(isinstance(json.loads(frame["hidden_state"]), dict), f"frame {at}: hidden state")


def check_episodes(data: LeRobotDataset) -> None:
    """That episodes follow each other without gaps, each with its verdicts and one task."""
    end = 0
    for number, episode in enumerate(data.meta.episodes):
        first, end_before = episode["dataset_from_index"], end
        end = episode["dataset_to_index"]
        require(first == end_before, f"episode {number} begins at {first}, not {end_before}")
        require(end - first == episode["length"], f"episode {number} has another length")
        require(episode["success"] and episode["exact"], f"episode {number} is not exact")
        task = data.meta.tasks.iloc[int(data[first]["task_index"])].name
        require(episode["tasks"] == [task], f"episode {number}: {episode['tasks']} is not {task}")
    require(end == len(data), f"the episodes hold {end} frames, the set {len(data)}")


def check_policy_view(data: LeRobotDataset) -> None:
    """That a policy of LeRobot is shown nothing hidden and learns one action."""
    kinds = {k: f.type for k, f in dataset_to_policy_features(data.meta.features).items()}
    shown = {name for name, kind in kinds.items() if kind is not FeatureType.ACTION}
    learnt = {name for name, kind in kinds.items() if kind is FeatureType.ACTION}
    wanted = set(data.meta.camera_keys)
    require(wanted != set(), "no camera")
    require(shown == wanted | {"observation.state", "observation.tip_pose"}, f"shown: {shown}")
    require(learnt == {"action"}, f"learnt: {learnt}")
    for name in (*wanted, *WIDTHS):
        found = data.meta.stats[name]
        marks = {"min", "max", "mean", "std", "count", "q01", "q99"}
        require(marks <= set(found), f"statistics of {name}: {sorted(found)}")


def check_chunks(folder: Path) -> None:
    """That actions come in chunks that continue from frame to frame, padded at the end."""
    times = [i / 20 for i in range(CHUNK)]
    data = LeRobotDataset("hide/export", root=folder, delta_timestamps={"action": times})
    plain = data.hf_dataset.with_format("numpy")
    first, last = data[0], data[data.meta.episodes[0]["dataset_to_index"] - 1]
    rows = torch.from_numpy(plain[:CHUNK]["action"])
    require(torch.equal(first["action"], rows), "a chunk is not the rows that follow")
    require(not first["action_is_pad"].any(), "the first chunk is padded")
    require(last["action_is_pad"].tolist() == [False] + [True] * (CHUNK - 1), "padding at the end")
    loader = DataLoader(data, batch_size=4, shuffle=True, num_workers=2)
    batch = next(iter(loader))
    require(batch["action"].shape == (4, CHUNK, 8), f"a batch is {tuple(batch['action'].shape)}")
    for camera in data.meta.camera_keys:
        require(batch[camera].shape == (4, 3, 128, 128), f"a batch's {camera}")


def main() -> None:
    """Checks a folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--reads", type=int, default=200)
    asked = parser.parse_args()
    data = LeRobotDataset("hide/export", root=asked.folder)
    require(data.fps == 20, f"{data.fps} frames a second")
    check_episodes(data)
    check_policy_view(data)
    chosen = random.Random(0).choices(range(len(data)), k=asked.reads)
    began = perf_counter()
    frames = [data[at] for at in chosen]
    seconds = perf_counter() - began
    for at, frame in zip(chosen, frames, strict=True):
        check_frame(frame, at, data.meta.camera_keys)
    began = perf_counter()
    count = min(asked.reads, len(data))
    for at in range(count):
        check_frame(data[at], at, data.meta.camera_keys)
    onward = perf_counter() - began
    check_chunks(asked.folder)
    print(
        f"{asked.folder}: {data.num_episodes} episodes, {len(data)} frames, "
        f"{data.meta.total_tasks} tasks, all as it should be; {asked.reads / seconds:.0f} frames/s "
        f"read at random, {count / onward:.0f} in order (cameras: {len(data.meta.camera_keys)})"
    )


if __name__ == "__main__":
    main()
