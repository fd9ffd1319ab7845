"""Files that people take for checkpoints: recognised by their first bytes, never opened.

Why none of them is loaded: pickles and TorchScript run code of their author's, `torch.export`
archives fall back to pickles, and ONNX graphs name operators and files outside of themselves.
"""

from pathlib import Path

LOOK = 65_536  # bytes at either end of a file
AS_CHECKPOINT = "Save it with seek_model.checkpoint.save, which writes a .safetensors file."
SAFETENSORS = b"{"  # after eight bytes of length, which may be like any format's first ones
ZIP, PICKLE, GZIP, HDF5 = b"PK\x03\x04", b"\x80", b"\x1f\x8b", b"\x89HDF\r\n"
PROTOCOLS = range(2, 6)  # of pickles
ONNX_VERSION = 0x08  # the first field of an ONNX model: its version, as a number
SAVED = "a file of torch.save, a pickle"
ARCHIVES = {  # by a name that only such an archive has in it; the first that fits
    b"/constants.pkl": "TorchScript, a program: it would run code of its author's",
    b"/archive_format": "an archive of torch.export (.pt2), which may hold pickles and libraries",
    b"/aotinductor": "an archive of AOTInductor (.pt2), which holds compiled libraries",
    b"/data.pkl": SAVED,
}


def named(path: Path) -> str | None:
    """What a file is that is no safetensors file, and what to do; None if nothing is known.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(LOOK)
        file.seek(max(0, path.stat().st_size - LOOK))
        what = None if start[8:9] == SAFETENSORS else _kind(start, file.read())
    return f"{what}. {AS_CHECKPOINT}" if what else None


def is_saved(path: Path) -> bool:
    """True if a file is of torch.save; a server can convert it.

    Raises:
        OSError: it cannot be read.
    """
    return (named(path) or "").startswith(SAVED)


def _kind(start: bytes, end: bytes) -> str | None:
    if start.startswith(ZIP):
        found = (what for name, what in ARCHIVES.items() if name in start or name in end)
        return next(found, "a zip archive")
    if start.startswith(GZIP):
        return "a gzip archive"
    if start.startswith(HDF5):
        return "an HDF5 file"
    if start.startswith(PICKLE) and start[1:2] and start[1] in PROTOCOLS:
        return "a pickle, which would run code of its author's"
    if start[:1] and start[0] == ONNX_VERSION and b"onnx" in start.lower():
        return "an ONNX model, whose operators are not SEEK's"
    return None
