"""A folder of demonstrations in LeRobot's format: dense actions, what cameras saw, what was hidden.

While episodes are recorded they lie in `.parts`, each whole or not there. When all that were
asked for are, the set is put together in `.whole`, which becomes `.ready`, and moved to its place:
a folder without `meta/info.json` is not finished, and the same command goes on.
"""

import errno
import fcntl
import importlib.util
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from hide_tasks import lerobot_format as form
from hide_tasks import suite
from hide_tasks.catalogue import suite_of
from hide_tasks.contract import EpisodeSpec, Split
from hide_tasks.demos import INDEX, DemosError
from hide_tasks.lerobot_episode import Part, record
from hide_tasks.sources import sources_hash

FORMAT = 1
REQUEST = "hide.json"
PARTS, WHOLE, READY = ".parts", ".whole", ".ready"
FOLDERS = ("data", "videos", "meta")  # in the order that they come: meta says that it is whole
PACKAGES = ("av", "pyarrow")


@dataclass(frozen=True)
class Export:
    """A folder that is or becomes a data set."""

    path: Path

    @classmethod
    def prepare(cls, path: Path, tasks: Sequence[str], split: Split, episodes: int | None) -> Self:
        """The folder made, or the one that is there, of the same request.

        Raises:
            DemosError: it holds something else, or packages are missing.
        """
        _require_packages()
        request = _request(tasks, split, episodes)
        export = cls(path)
        if path.exists() and (not path.is_dir() or _begun(path)):
            _require_same(path, request)
            export._require_ours()
        else:
            path.mkdir(parents=True, exist_ok=True)
            export._write(request)
        return export

    @classmethod
    @contextmanager
    def opened(
        cls, path: Path, tasks: Sequence[str], split: Split, episodes: int | None
    ) -> Iterator[Self]:
        """`prepare`, and no other process that comes this way writes until the block ends.

        Raises:
            DemosError: as `prepare`, or another export is at work in the folder.
        """
        export = cls.prepare(path, tasks, split, episodes)
        if export.finished:
            yield export
            return
        (path / PARTS).mkdir(exist_ok=True)
        with _held(path / PARTS / ".lock"):
            yield cls.prepare(path, tasks, split, episodes)  # again: it may have changed

    @property
    def finished(self) -> bool:
        """True when the data set is there."""
        return (self.path / form.INFO).is_file()

    def left(self, specs: Sequence[EpisodeSpec]) -> list[EpisodeSpec]:
        """The episodes that are neither recorded nor refused."""
        return [] if self.finished else [spec for spec in specs if not self._settled(spec)]

    def add(self, spec: EpisodeSpec) -> int:
        """Records an episode; its size in bytes.

        Raises:
            DemosError: it is not exact in rows of joint_position; it is left out.
        """
        part, folder = self.path / PARTS / f".{spec.name}", self._part(spec)
        shutil.rmtree(part, ignore_errors=True)
        try:
            record(spec, part)
        except DemosError as error:
            self._refusal(spec).parent.mkdir(parents=True, exist_ok=True)
            self._refusal(spec).write_text(f"{error}\n")
            raise
        part.replace(folder)
        return sum(file.stat().st_size for file in folder.iterdir())

    def refused(self, specs: Sequence[EpisodeSpec]) -> list[str]:
        """The names of the episodes that are left out."""
        if self.finished:
            return list(self._read().get("left_out", []))
        return [spec.name for spec in specs if self._refusal(spec).is_file()]

    def finish(self, specs: Sequence[EpisodeSpec]) -> None:
        """Puts the data set together, once every episode is recorded or refused, and tidies up.

        Raises:
            DemosError: none was exact, or something else lies where the set goes.
        """
        ready = self.path / READY
        if not self.finished:
            if not all(map(self._settled, specs)):
                return
            if not ready.is_dir():
                self._put_together(specs)
            self._require_ours()
            for name in FOLDERS:
                if (ready / name).is_dir():
                    (ready / name).replace(self.path / name)
        for folder in (ready, self.path / PARTS):
            shutil.rmtree(folder, ignore_errors=True)

    def _put_together(self, specs: Sequence[EpisodeSpec]) -> None:
        parts = [Part(self._part(spec)) for spec in specs if self._part(spec).is_dir()]
        if not parts:
            raise DemosError(f"{self.path}: no episode was exact, so there is no data set.")
        from hide_tasks.lerobot_whole import put_together

        whole = self.path / WHOLE
        shutil.rmtree(whole, ignore_errors=True)
        put_together(parts, whole)
        found = sorted(file for file in whole.rglob("*") if file.is_file())
        files = {file.relative_to(whole).as_posix(): file.stat().st_size for file in found}
        self._write({**self._read(), "left_out": self.refused(specs), "files": files})
        whole.replace(self.path / READY)

    def _require_ours(self) -> None:
        """Raises a DemosError if the set was altered, or something else lies where it goes."""
        if self.finished:
            for name, size in self._read().get("files", {}).items():
                file = self.path / name
                if not file.is_file() or file.stat().st_size != size:
                    raise DemosError(
                        f"{file} is not the {size} bytes that were exported. "
                        "Export to a new folder."
                    )
            return
        ready = self.path / READY
        for name in FOLDERS:
            if (self.path / name).exists() and ((ready / name).exists() or not ready.is_dir()):
                raise DemosError(
                    f"{self.path / name} is not of this export, which is not finished. "
                    "Move it away, or give another folder."
                )

    def _read(self) -> dict[str, Any]:
        return dict(json.loads((self.path / REQUEST).read_text()))

    def _write(self, document: dict[str, Any]) -> None:
        part = self.path / f".{REQUEST}.part"
        part.write_text(json.dumps(document, indent=1) + "\n")
        os.replace(part, self.path / REQUEST)

    def _part(self, spec: EpisodeSpec) -> Path:
        return self.path / PARTS / spec.name

    def _refusal(self, spec: EpisodeSpec) -> Path:
        return self.path / PARTS / f"{spec.name}.refused"

    def _settled(self, spec: EpisodeSpec) -> bool:
        return self._part(spec).is_dir() or self._refusal(spec).is_file()


def _request(tasks: Sequence[str], split: Split, episodes: int | None) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "suite": suite_of(tasks[0]),
        "version": suite.VERSION,
        "tasks": list(tasks),
        "split": split,
        "episodes": episodes,
        "sources": {task: sources_hash(task, certified=True) for task in tasks},
    }


def _begun(path: Path) -> bool:
    """Whether a folder holds more than what is left of an export killed in its first moment."""
    return any(entry.name != f".{REQUEST}.part" for entry in path.iterdir())


@contextmanager
def _held(path: Path) -> Iterator[None]:
    with path.open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
            message = f"Another export is at work in {path.parent.parent}; wait, or give another."
            raise DemosError(message) from None
        yield


def _require_same(path: Path, request: dict[str, Any]) -> None:
    """Raises a DemosError unless a folder holds an export of the same request."""
    hint = "Give another folder, or an empty one."
    if not path.is_dir():
        raise DemosError(f"{path} is no folder. {hint}")
    if (path / INDEX).exists():
        raise DemosError(f"{path} holds demonstrations of our own format. {hint}")
    if not (path / REQUEST).is_file():
        raise DemosError(f"{path} holds something else: there is no {REQUEST}. {hint}")
    try:
        there = dict(json.loads((path / REQUEST).read_text()))
    except (OSError, ValueError, TypeError) as error:
        raise DemosError(f"{path / REQUEST} is damaged: {error}") from None
    for name, value in request.items():
        if there.get(name) != value:
            raise DemosError(f"{path} holds an export with {_difference(name, there)}. {hint}")


def _difference(name: str, there: dict[str, Any]) -> str:
    if name == "sources":
        return "another version of the sources"
    value = there.get(name)
    return f"{name} {', '.join(map(str, value)) if isinstance(value, list) else value}"


def _require_packages() -> None:
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise DemosError(
            f"--format lerobot needs {' and '.join(missing)}, which is not installed. "
            "Install them with: pip install 'hide-seek[lerobot]'"
        )
