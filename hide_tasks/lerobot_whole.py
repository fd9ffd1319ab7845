"""Puts recorded episodes together to one data set of LeRobot's format."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hide_tasks import lerobot_format as form
from hide_tasks.lerobot_episode import Part
from hide_tasks.lerobot_video import Joined

MB = 1024**2


def put_together(parts: Sequence[Part], folder: Path) -> None:
    """Writes the data set of the parts, in their order, into a folder that is not there yet."""
    whole = _Whole(folder)
    try:
        for part in parts:
            whole.add(part)
    finally:
        whole.close()
    whole.describe()


@dataclass
class _Whole:
    """A data set under way."""

    folder: Path
    instructions: list[str] = field(default_factory=list)
    episodes: list[dict[str, Any]] = field(default_factory=list)
    columns: dict[str, list[Any]] = field(default_factory=dict)  # of all episodes, for statistics
    pixels: Any = 0  # (c, 3, 256)
    frames: int = 0
    rows: "_Rows | None" = None
    videos: dict[str, tuple[int, Joined]] = field(default_factory=dict)

    def add(self, part: Part) -> None:
        """One more episode."""
        about, columns = part.about, part.columns()
        count = len(columns["frame_index"])
        columns |= self._numbers(about["instruction"], count)
        episode = {
            "episode_index": len(self.episodes),
            "tasks": [about.pop("instruction")],
            "length": count,
            **self._data(columns),
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + count,
            **{k: v for key in part.videos for k, v in self._video(key, part).items()},
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **about,
        }
        stats = _statistics(columns, part.videos, part.histograms, count)
        self.episodes.append(episode | _flat(stats))
        for name in form.numeric():
            self.columns.setdefault(name, []).append(columns[name])
        self.pixels = self.pixels + part.histograms
        self.frames += count

    def close(self) -> None:
        """Ends the files."""
        for _, video in self.videos.values():
            video.file.close()
        if self.rows:
            self.rows.writer.close()

    def describe(self) -> None:
        """Writes what `meta` holds."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        place = self.folder / form.EPISODES.format(**form.place(0))
        place.parent.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self.episodes), place)
        pq.write_table(form.tasks_table(self.instructions), self.folder / form.TASKS)
        columns = {name: np.concatenate(some) for name, some in self.columns.items()}
        keys = list(self.videos)
        stats = _statistics(columns, keys, self.pixels, self.frames)
        info = form.info(len(self.episodes), self.frames, len(self.instructions), keys)
        for path, document in ((form.STATS, stats), (form.INFO, info)):
            (self.folder / path).write_text(json.dumps(document, indent=1) + "\n")

    def _numbers(self, instruction: str, count: int) -> dict[str, Any]:
        if instruction not in self.instructions:
            self.instructions.append(instruction)
        task = self.instructions.index(instruction)
        return {
            "episode_index": np.full(count, len(self.episodes)),
            "index": np.arange(self.frames, self.frames + count),
            "task_index": np.full(count, task),
        }

    def _data(self, columns: dict[str, Any]) -> dict[str, int]:
        table = form.frames_table(columns)
        if self.rows and self.rows.size > form.DATA_MB * MB:
            self.rows.writer.close()
            self.rows = _Rows(self.folder, self.rows.number + 1, table.schema)
        self.rows = self.rows or _Rows(self.folder, 0, table.schema)
        self.rows.writer.write_table(table)
        return {f"data/{name}": value for name, value in form.place(self.rows.number).items()}

    def _video(self, key: str, part: Part) -> dict[str, Any]:
        number, video = self.videos.get(key, (-1, None))
        if video is None or video.path.stat().st_size > form.VIDEO_MB * MB:
            if video:
                video.file.close()
            number += 1
            path = self.folder / form.VIDEO.format(video_key=key, **form.place(number))
            video = Joined(path)
            self.videos[key] = number, video
        began, ended = video.add(part.video(key))
        found = {**form.place(number), "from_timestamp": began, "to_timestamp": ended}
        return {f"videos/{key}/{name}": value for name, value in found.items()}


class _Rows:
    """A file of frames that grows by episodes."""

    def __init__(self, folder: Path, number: int, schema: Any):
        import pyarrow.parquet as pq

        self.number = number
        self.path = folder / form.DATA.format(**form.place(number))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.writer = pq.ParquetWriter(self.path, schema)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self.path.stat().st_size


def _statistics(
    columns: dict[str, Any], videos: Sequence[str], pixels: Any, frames: int
) -> dict[str, form.Stats]:
    seen = {
        key: form.statistics_of_pixels(counts, frames)
        for key, counts in zip(videos, pixels, strict=True)
    }
    return seen | {name: form.statistics_of(columns[name]) for name in form.numeric()}


def _flat(stats: dict[str, form.Stats]) -> dict[str, Any]:
    return {
        f"stats/{feature}/{name}": value
        for feature, found in stats.items()
        for name, value in found.items()
    }
