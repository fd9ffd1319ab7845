"""What a folder of LeRobot's dataset format v3.0 holds: names, features, statistics, tables.

Facts of the format, as its release 0.4.4 reads it: `meta/info.json` describes the folder,
`meta/episodes` says where every episode's frames are, `meta/tasks.parquet` numbers instructions.
"""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hide_tasks.contract import CAMERAS, CONTROL_HZ, IMAGE_SIZE

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = "v3.0"
FILES_A_CHUNK = 1000
DATA_MB, VIDEO_MB = 100, 200  # a file that has grown so far is followed by another
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA = f"data/{PLACE}.parquet"
VIDEO = f"videos/{{video_key}}/{PLACE}.mp4"
EPISODES = f"meta/episodes/{PLACE}.parquet"
INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"

VIDEOS = {camera: f"observation.images.{camera}" for camera in CAMERAS}
JOINTS = tuple(f"joint_{number}" for number in range(1, 8))
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
STEP = ("dx", "dy", "dz", "rx", "ry", "rz")
# LeRobot's policies see what begins with `observation` and learn what begins with `action`: the
# hidden state must be neither, and there is one action.
VECTORS: dict[str, tuple[str, ...]] = {
    "observation.state": (*JOINTS, "opening"),
    "observation.tip_pose": POSE,
    "action": (*JOINTS, "opening"),
    "ee_delta": (*STEP, "opening"),
}
SCALARS = {
    "stage": "int64",
    "stage_name": "string",
    "hidden_state": "string",
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Stats = dict[str, list[Any]]


def features(videos: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Every column and video, as `meta/info.json` declares them."""
    shape = [IMAGE_SIZE, IMAGE_SIZE, 3]
    names = ["height", "width", "channels"]
    vectors = {
        name: {"dtype": "float32", "shape": [len(parts)], "names": list(parts)}
        for name, parts in VECTORS.items()
    }
    scalars = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in SCALARS.items()}
    seen = {
        key: {"dtype": "video", "shape": shape, "names": names, "info": _video()} for key in videos
    }
    return {**seen, **vectors, **scalars}


def _video() -> dict[str, Any]:
    from hide_tasks.lerobot_video import CODEC, PIXELS

    return {
        "video.height": IMAGE_SIZE,
        "video.width": IMAGE_SIZE,
        "video.codec": CODEC,
        "video.pix_fmt": PIXELS,
        "video.is_depth_map": False,
        "video.fps": CONTROL_HZ,
        "video.channels": 3,
        "has_audio": False,
    }


def info(episodes: int, frames: int, tasks: int, videos: Sequence[str]) -> dict[str, Any]:
    """The document of `meta/info.json`; `videos` are the keys of the cameras that there are."""
    return {
        "codebase_version": VERSION,
        "robot_type": "panda",
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": CONTROL_HZ,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA,
        "video_path": VIDEO,
        "features": features(videos),
    }


def place(number: int) -> dict[str, int]:
    """The chunk and the file of the n-th file of a kind."""
    return {"chunk_index": number // FILES_A_CHUNK, "file_index": number % FILES_A_CHUNK}


# --- statistics ---------------------------------------------------------------------------------


def statistics_of(values: NDArray[Any]) -> Stats:
    """Of every number of a column (n, …) over its rows."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    marks = {name: np.quantile(rows, q, axis=0) for name, q in QUANTILES.items()}
    return {**{k: v.tolist() for k, v in {**found, **marks}.items()}, "count": [len(rows)]}


def histograms(images: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(3, 256) how many pixels (n, h, w, 3) have each value, by channel."""
    channels = images.reshape(-1, 3).T
    return np.array([np.bincount(channel, minlength=256) for channel in channels])


def statistics_of_pixels(counts: NDArray[np.int64], frames: int) -> Stats:
    """Of every channel of images, 0 to 1, from its histogram (3, 256); shaped (3, 1, 1)."""
    values, total = np.arange(256) / 255, counts.sum(1)
    mean = counts @ values / total
    spread = np.sqrt(np.maximum(counts @ values**2 / total - mean**2, 0.0))
    below = np.cumsum(counts, axis=1) / total[:, None]
    found = {
        "min": values[(counts > 0).argmax(1)],
        "max": values[255 - (counts[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": spread,
        **{name: values[(below >= q).argmax(1)] for name, q in QUANTILES.items()},
    }
    shaped = {name: one.reshape(3, 1, 1).tolist() for name, one in found.items()}
    return {**shaped, "count": [frames]}


def numeric() -> list[str]:
    """The columns that have statistics."""
    return [*VECTORS, *(name for name, kind in SCALARS.items() if kind != "string")]


# --- tables -------------------------------------------------------------------------------------


def frames_table(columns: Mapping[str, Any]) -> "pa.Table":
    """Rows of `data`; a column is an array (n, …) or a list of strings."""
    import pyarrow as pa

    arrays = {}
    for name in VECTORS:
        flat = pa.array(np.asarray(columns[name], np.float32).ravel())
        arrays[name] = pa.FixedSizeListArray.from_arrays(flat, len(VECTORS[name]))
    for name, kind in SCALARS.items():
        arrays[name] = pa.array(columns[name], pa.type_for_alias(kind))
    return pa.table(arrays)


def tasks_table(instructions: Sequence[str]) -> "pa.Table":
    """A numbered row for every instruction, which pandas reads as its index."""
    import pyarrow as pa

    index = "__index_level_0__"
    columns = [
        _pandas_column("task_index", "task_index", "int64", "int64"),
        _pandas_column(None, index, "unicode", "object"),
    ]
    about = {
        "index_columns": [index],
        "column_indexes": [_pandas_column(None, None, "unicode", "object")],
        "columns": columns,
        "pandas_version": "2.0.0",
    }
    numbers = pa.array(range(len(instructions)), pa.int64())
    table = pa.table({"task_index": numbers, index: pa.array(instructions, pa.string())})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})


def _pandas_column(
    name: str | None, field: str | None, kind: str, numpy_kind: str
) -> dict[str, Any]:
    return {
        "name": name,
        "field_name": field,
        "pandas_type": kind,
        "numpy_type": numpy_kind,
        "metadata": None,
    }
