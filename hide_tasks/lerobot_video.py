"""Videos of what a camera saw: written frame by frame, and joined without encoding again.

Colour is kept for every pixel (4:4:4), since tasks turn on the colours of small things; frames
refer to none after them, so a frame is found by its number.
"""

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hide_tasks.contract import CONTROL_HZ

CODEC, ENCODER, PIXELS = "h264", "libx264", "yuv444p"
OPTIONS = {"crf": "18", "g": "10", "bf": "0", "threads": "1"}


def write(path: Path, images: Iterable[NDArray[np.uint8]]) -> None:
    """A video of images (h, w, 3) at 20 Hz."""
    import av

    with av.open(str(path), "w") as file:
        stream: Any = None
        for image in images:
            if stream is None:
                stream = file.add_stream(ENCODER, rate=CONTROL_HZ, options=OPTIONS)
                stream.height, stream.width, stream.pix_fmt = *image.shape[:2], PIXELS
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        file.mux(stream.encode())


class Joined:
    """A video that grows by whole videos. A context: leaving it ends the file."""

    def __init__(self, path: Path):
        import av

        path.parent.mkdir(parents=True, exist_ok=True)
        self.path, self.frames = path, 0
        self.file: Any = av.open(str(path), "w")
        self.stream: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.file.close()

    def add(self, path: Path) -> tuple[float, float]:
        """Appends a video of `write`; the seconds at which it begins and ends in this one."""
        import av

        began = self.frames
        with av.open(str(path)) as other:
            source: Any = other.streams.video[0]
            if self.stream is None:
                self.stream = self.file.add_stream_from_template(source)
            step = round(1 / (CONTROL_HZ * source.time_base))
            for packet in other.demux(source):
                if packet.size:
                    packet.pts = packet.dts = self.frames * step
                    packet.stream = self.stream
                    self.file.mux(packet)
                    self.frames += 1
        return began / CONTROL_HZ, self.frames / CONTROL_HZ
