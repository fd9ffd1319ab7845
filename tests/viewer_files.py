"""The viewer's files, made once for all data folders of the tests: each takes five seconds."""

import os
import shutil
from pathlib import Path

from web.viewer_assets import ViewerAssets, prepare

MADE = Path(__file__).parents[1] / "build" / "viewer"  # `make clean` removes it


def lay(data: Path) -> None:
    """Puts them where a server with this data folder looks for them; what is there stays."""
    folder = ViewerAssets(data).folder
    if (data / "viewer").exists():
        return
    prepare(MADE)  # does nothing if they are there and whole
    folder.mkdir(parents=True)
    for file in MADE.iterdir():
        if file.suffix != ".part":
            _link(file, folder / file.name)


def _link(file: Path, place: Path) -> None:
    try:
        os.link(file, place)
    except OSError:  # another file system
        shutil.copyfile(file, place)
