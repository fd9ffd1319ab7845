"""What the cameras saw, read from a recording: one picture a decision, and one of the end."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image
from rerun.chunk import RrdReader

from hide_tasks.contract import CAMERAS
from workers.recording_layout import DECISION, TIME, camera_path

BLOB = "EncodedImage:blob"
SHOWN = 400  # ms that a picture of a preview stays
LAST = 1600  # ms that its last one stays
MOST = 40  # pictures of a preview; of a longer episode they are spread over it


class Picture(NamedTuple):
    """What a camera saw before a decision, or at the end."""

    decision: int
    time: float  # simulated seconds
    jpeg: bytes  # 128 x 128


def pictures(path: Path) -> dict[str, list[Picture]]:
    """The pictures of every camera, in order.

    Raises:
        ValueError, OSError, RuntimeError: the file is no recording, or cut.
    """
    return {name: found for name in CAMERAS if (found := _of_camera(path, name))}


def _of_camera(path: Path, name: str) -> list[Picture]:
    entity = f"{camera_path(name)}/rgb"
    found = []
    for chunk in RrdReader(path).stream().filter(content=[entity]).to_chunks():
        rows = chunk.to_record_batch()
        if BLOB in rows.schema.names:
            times = rows.column(TIME).cast("int64").to_pylist()
            seen = zip(rows.column(DECISION).to_pylist(), times, rows.column(BLOB), strict=True)
            found += [Picture(k, time / 1e9, _bytes(blob)) for k, time, blob in seen]
    return sorted(found)


def _bytes(blob: Any) -> bytes:
    """Of a row: a list of one list of bytes."""
    return bytes(blob.values[0].values.to_numpy())


def preview(seen: Sequence[Picture]) -> bytes:
    """An animated WebP of some pictures, 128 x 128, that repeats; the last stays longer."""
    step = max(1, -(-len(seen) // MOST))
    frames = [Image.open(io.BytesIO(one.jpeg)) for one in (*seen[:-1:step], seen[-1])]
    file = io.BytesIO()
    durations = [SHOWN] * (len(frames) - 1) + [LAST]
    frames[0].save(
        file,
        "WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=durations,
        loop=0,
        quality=60,
        method=0,
    )
    return file.getvalue()
