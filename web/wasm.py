"""WebAssembly as a file: a header, then sections, each a kind, a size and its content."""

from collections.abc import Iterator


def without_names(wasm: bytes) -> bytes:
    """The module without its custom section `name`, which only debuggers read.

    Raises:
        ValueError: this is no WebAssembly.
    """
    if wasm[:4] != b"\0asm":
        raise ValueError("not WebAssembly: expected it to begin with '\\0asm'")
    return wasm[:8] + b"".join(section for section in _sections(wasm) if not _is_names(section))


def _sections(wasm: bytes) -> Iterator[bytes]:
    at = 8
    while at < len(wasm):
        size, body = _number(wasm, at + 1)
        yield wasm[at : body + size]
        at = body + size


def _is_names(section: bytes) -> bool:
    if section[0] != 0:
        return False
    _, body = _number(section, 1)
    length, name = _number(section, body)
    return section[name : name + length] == b"name"


def _number(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned LEB128 number, and where it ends."""
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at
