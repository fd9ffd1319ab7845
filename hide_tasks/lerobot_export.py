"""A folder of demonstrations in LeRobot's format: dense actions, what cameras saw, what was hidden.

While episodes are recorded they lie in `.parts`, each whole or not there. When all that were
asked for are, the set is put together beside its place and moved there: a folder without
`meta/info.json` is not finished, and the same command goes on.
"""

import importlib.util
import json
import os
import shutil
from collections.abc import Sequence
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
PARTS, WHOLE = ".parts", ".whole"
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
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            _require_same(path, request)
        else:
            path.mkdir(parents=True, exist_ok=True)
            part = path / f".{REQUEST}.part"
            part.write_text(json.dumps(request, indent=1) + "\n")
            part.replace(path / REQUEST)
        return cls(path)

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
            return list(json.loads((self.path / REQUEST).read_text()).get("left_out", []))
        return [spec.name for spec in specs if self._refusal(spec).is_file()]

    def finish(self, specs: Sequence[EpisodeSpec]) -> None:
        """Puts the data set together, once every episode is recorded or refused.

        Raises:
            DemosError: none was exact.
        """
        if self.finished or not all(map(self._settled, specs)):
            return
        parts = [Part(self._part(spec)) for spec in specs if self._part(spec).is_dir()]
        if not parts:
            raise DemosError(f"{self.path}: no episode was exact, so there is no data set.")
        from hide_tasks.lerobot_whole import put_together

        whole = self.path / WHOLE
        for folder in (whole, *(self.path / name for name in ("data", "videos"))):
            shutil.rmtree(folder, ignore_errors=True)
        put_together(parts, whole)
        self._note(self.refused(specs))
        for name in ("data", "videos", "meta"):  # meta says that it is whole
            (whole / name).replace(self.path / name)
        for folder in (whole, self.path / PARTS):
            shutil.rmtree(folder)

    def _note(self, left_out: list[str]) -> None:
        request = json.loads((self.path / REQUEST).read_text())
        part = self.path / f".{REQUEST}.part"
        part.write_text(json.dumps({**request, "left_out": left_out}, indent=1) + "\n")
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
