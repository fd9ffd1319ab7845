"""Checkpoints made by hand: headers that are right or wrong, and weights that fit no network."""

import json
import struct
from pathlib import Path
from typing import Any

from seek_model.checkpoint_header import FORMAT, Provenance
from seek_model.config import Config

PROVENANCE = Provenance(
    project="0.1.0",
    torch="2.13.0",
    suite="hide",
    version=1,
    data="d" * 64,
    tasks=("search_drawer",),
    phase="first",
    step=1,
    seed=0,
    seconds=1.0,
)


def content(*, name: str = "by-hand", weights: bytes = bytes(8), **metadata: Any) -> bytes:
    """A checkpoint with one tensor, which no network has."""
    told = {
        "format": FORMAT,
        "config": Config(name=name).model_dump_json(),
        "provenance": PROVENANCE.model_dump_json(),
    }
    header = {
        "__metadata__": told | metadata,
        "stranger": {
            "dtype": "F32",
            "shape": [len(weights) // 4],
            "data_offsets": [0, len(weights)],
        },
    }
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + weights


def written(path: Path, **changes: Any) -> Path:
    """The same as a file."""
    path.write_bytes(content(**changes))
    return path


WRONG = {
    "not safetensors": (b"\x80\x04pickled", "this is a pickle"),
    "short": (b"12", "a file of 2 bytes"),
    "truncated": (content()[:-4], "4 follow the header"),
    "cut in its header": (content()[:40], "ends within its header"),
    "too long": (content() + b"more", "follow the header"),
    "huge header": (struct.pack("<Q", 2**62) + b"{}", "give a header of 4611686018427387904 bytes"),
    "other format": (content(format="other 9"), "format is 'other 9'"),
    "no configuration": (content(config="{}"), "config.name"),
}
