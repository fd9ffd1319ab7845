"""The viewer's files, made once from the wheel of the SDK and kept in the data folder.

`rerun_notebook` is found, never imported: it would bring IPython. Of its WebAssembly the debug
names (a third) are left out and the rest is compressed. The layout is written by a process of its
own, because the SDK has no place in the server's.
"""

import gzip
import hashlib
import json
import logging
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from hide_tasks import SUITES
from hide_tasks.catalogue import cameras_of
from hide_tasks.contract import CAMERAS
from web.wasm import without_names

logger = logging.getLogger(__name__)

SCRIPT, WASM, LAYOUT = "web-viewer.js", "re_viewer_bg.wasm", "layout.rbl"
PACKED = f"{WASM}.gz"
MANIFEST = "manifest.json"  # written last: what it names is whole
COMPRESSION = 6  # of gzip: 43 MB become 13.8 MB in 2 s (0.41)
LAYOUT_LIMIT = 120  # s
WRITE_LAYOUT = (
    "import sys; from pathlib import Path; from workers.recording_layout import write_layout; "
    "write_layout(Path(sys.argv[1]), sys.argv[2:])"
)


def layout_for(cameras: Sequence[str]) -> str:
    """The name of the layout for recordings of these cameras."""
    return LAYOUT if tuple(cameras) == CAMERAS else f"layout-{'-'.join(cameras)}.rbl"


LAYOUTS = {layout_for(seen): seen for seen in (CAMERAS, *map(cameras_of, SUITES))}


class ViewerMissing(RuntimeError):
    """The viewer's files are not there and cannot be made; the message says why."""


class ViewerFiles(NamedTuple):
    """The viewer's files on disk."""

    script: Path
    wasm: Path  # gzip
    layouts: dict[str, Path]  # by name


class ViewerAssets:
    """The viewer's files, made in the background on `begin` or when they are first asked for."""

    def __init__(self, data: Path):
        self.version = version("rerun-sdk")
        self.folder = data / "viewer" / self.version
        self.layout_version = _hash(_layout_source())[:12]  # it changes more often than the viewer
        self._future: Future[ViewerFiles] | None = None
        self._lock = threading.Lock()

    def begin(self) -> "Future[ViewerFiles]":
        """The files to come. After a failure the next call tries again."""
        with self._lock:
            if self._future is None or (self._future.done() and self._future.exception()):
                self._future = Future()
                arguments = (self._future, self.folder)
                threading.Thread(target=_prepare, args=arguments, daemon=True).start()
            return self._future


def _prepare(future: "Future[ViewerFiles]", folder: Path) -> None:
    try:
        future.set_result(prepare(folder))
    except Exception as error:
        logger.exception("The viewer's files could not be made")
        future.set_exception(ViewerMissing(f"The viewer's files could not be made: {error}"))


def prepare(folder: Path) -> ViewerFiles:
    """The viewer's files in a folder; what is missing, damaged or of another source is made anew.

    Raises:
        ViewerMissing: the wheel with the viewer is not installed.
        OSError, subprocess.SubprocessError: a file could not be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wheel, layout_source = wheel_folder(), _layout_source()
    known = _manifest(folder)
    made = {
        SCRIPT: _kept(folder / SCRIPT, known, wheel / "widget.js", _write_script),
        PACKED: _kept(folder / PACKED, known, wheel / WASM, _write_wasm),
        **{
            name: _kept(folder / name, known, layout_source, partial(_write_layout, cameras))
            for name, cameras in LAYOUTS.items()
        },
    }
    if made != known:
        _write(folder / MANIFEST, lambda path: path.write_text(json.dumps(made, indent=1)))
    layouts = {name: folder / name for name in LAYOUTS}
    return ViewerFiles(folder / SCRIPT, folder / PACKED, layouts)


def wheel_folder() -> Path:
    """Where the wheel has the viewer.

    Raises:
        ViewerMissing: it is not installed.
    """
    package = find_spec("rerun_notebook")
    if not package or not package.submodule_search_locations:
        raise ViewerMissing("rerun_notebook is not installed; expected rerun-sdk[notebook].")
    return Path(package.submodule_search_locations[0]) / "static"


# --- keeping ---

Entry = dict[str, str]
Write = Callable[[Path, Path], object]  # from, to


def _kept(path: Path, known: dict[str, Entry], source: Path, write: Write) -> Entry:
    """What the manifest says of a file, which is written first if it is not as it should be."""
    stat = source.stat()
    origin = f"{stat.st_size} {stat.st_mtime_ns}"
    entry = known.get(path.name)
    if entry and entry["source"] == origin and _hash(path) == entry["content"]:
        return entry
    _write(path, lambda part: write(source, part))
    return {"source": origin, "content": _hash(path)}


def _write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file whole or not at all, also when two servers do it at once."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f"{path.name}.", suffix=".part")
    os.close(handle)
    part = Path(name)
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _write_script(source: Path, path: Path) -> None:
    path.write_bytes(source.read_bytes() + b"\nexport { WebViewer };\n")


def _write_wasm(source: Path, path: Path) -> None:
    path.write_bytes(gzip.compress(without_names(source.read_bytes()), COMPRESSION, mtime=0))


def _write_layout(cameras: Sequence[str], source: Path, path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / LAYOUT
        command = [sys.executable, "-c", WRITE_LAYOUT, str(made), *cameras]
        subprocess.run(
            command,
            check=True,
            timeout=LAYOUT_LIMIT,
            stdin=subprocess.DEVNULL,
            cwd=source.parents[1],  # where `workers` is found, installed or not
        )
        shutil.copyfile(made, path)


def _layout_source() -> Path:
    found = find_spec("workers.recording_layout")
    assert found and found.origin, "workers is a package of this project"
    return Path(found.origin)


def _hash(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def _manifest(folder: Path) -> dict[str, Entry]:
    try:
        found = json.loads((folder / MANIFEST).read_text())
        return {
            name: {key: entry[key] for key in ("source", "content")}
            for name, entry in found.items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}
