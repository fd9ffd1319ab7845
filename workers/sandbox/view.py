"""Which files a policy's process sees: the interpreter, the code that it plays with, its own.

Not among them: homes, the server's data, runs with what is hidden in them, names with a dot.
"""

import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

HIDDEN = "HIDE_SANDBOX_HIDDEN"  # in the environment: folders that no policy sees
PACKAGES = ("hide_tasks", "seek_model", "workers")  # ours that a policy's process needs
CLOSING = ("landlock", "pyseccomp")
SCRATCH = Path("/tmp")  # a process has one of its own there, and shown the machine's it had none
RUNS = "runs"  # where `hide eval` and `hide train` write by default
TELLS_OF_EPISODES = ("results.json", "ledger.sqlite3")  # what is in a run's or a server's folder


@dataclass(frozen=True)
class View:
    """Absolute paths."""

    whole: tuple[Path, ...]  # files, and folders with all that is in them
    parts: tuple[Path, ...]  # folders without what is hidden
    hidden: frozenset[Path]
    search: tuple[Path, ...]  # where other modules than ours are looked for, in order

    def shown(self, folder: Path) -> Iterator[Path]:
        """What may be seen of a folder: its children, or their children where one is in part."""
        for child in sorted(folder.iterdir()):
            if self.hides(child) or child.is_symlink():  # a link may lead to what is hidden
                continue
            if child.is_dir() and any(child in one.parents for one in self.hidden):
                yield from self.shown(child)
            else:
                yield child

    def covered(self, folder: Path) -> Iterator[Path]:
        """What must not be seen of a folder that is shown; no two lie one in the other."""
        found = {one for one in self.hidden if folder in one.parents and one.exists()}
        found |= {child for child in folder.iterdir() if self.hides(child)}
        yield from sorted(one for one in found if found.isdisjoint(one.parents))

    def includes(self, folder: Path) -> bool:
        """True if a folder is shown, at least in part."""
        return _within(folder.resolve(), self.parts)

    def hides(self, path: Path) -> bool:
        """True if nothing of it is shown."""
        return path in self.hidden or path.name.startswith(".") or _tells(path)


def of_checkpoint(file: Path) -> View:
    """What a policy in a file of weights sees."""
    return _view([file], [], [])


def of_class(target: str, hidden: Iterable[Path] = ()) -> View:
    """What a class `module:Class` or `path/to/file.py:Class` sees: also its folder and this one."""
    source = target.rpartition(":")[0]
    files, folders = [], [Path.cwd()]
    if source.endswith(".py"):
        file = Path(source).resolve()
        files = [file] * file.is_file()
        folders.append(file.parent)
    return _view(files, folders, hidden)


def code() -> dict[str, Path]:
    """Our own modules by name, with what closes the process: all that is imported before that."""
    found = {}
    for name in (*PACKAGES, *CLOSING):
        spec = find_spec(name)
        if spec and spec.origin:
            origin = Path(spec.origin).resolve()
            found[name] = origin.parent if origin.stem == "__init__" else origin
    return found


def _view(files: list[Path], folders: list[Path], hidden: Iterable[Path]) -> View:
    search = [path for path in map(Path, map(os.path.abspath, sys.path)) if path.exists()]
    installed = [Path(prefix) for prefix in (sys.prefix, sys.base_prefix)]
    installed += [path.resolve() for path in installed]
    ours = set(code().values())
    named = [Path(path) for path in os.environ.get(HIDDEN, "").split(os.pathsep) if path]
    unseen = frozenset(path.resolve() for path in (*named, *hidden))
    bare = [path for path in search if not _holds(path, ours) and not _within(path, installed)]
    parts = [path.resolve() for path in (*bare, *folders) if path.is_dir()]
    parts = [path for path in parts if not _is_home(path) and path != SCRATCH]
    parts = [path for path in parts if not _within(path, unseen)]
    return View(
        whole=_once((*installed, *ours, *files)),
        parts=_once(parts),
        hidden=unseen,
        search=_once(path for path in search if _within(path, installed) or path in parts),
    )


def _holds(folder: Path, paths: Iterable[Path]) -> bool:
    return any(path.parent == folder.resolve() for path in paths)


def _within(path: Path, folders: Iterable[Path]) -> bool:
    return any(folder == path or folder in path.parents for folder in folders)


def _is_home(folder: Path) -> bool:
    """True for a user's home and what homes lie in: such a folder is never shown."""
    home = Path.home().resolve()
    return folder.resolve() in (home, *home.parents)


def _tells(path: Path) -> bool:
    if not path.is_dir():
        return False
    return path.name == RUNS or any((path / name).exists() for name in TELLS_OF_EPISODES)


def _once(paths: Iterable[Path]) -> tuple[Path, ...]:
    return tuple(dict.fromkeys(paths))
