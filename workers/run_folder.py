"""A run's folder: `results.json` is the truth, `decisions.jsonl` and `recordings/` belong to it.

An episode is finished when `results.json` names it; its decisions and its recording are on disk
before that. So a run that is killed at any moment loses at most the episodes in flight, and
opening the folder again clears what they left behind.
"""

import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from hide_tasks.contract import (
    Action,
    DecisionRecord,
    EpisodeResult,
    InvalidAction,
    parse_action,
)
from workers.protocol import UNMEASURED, digest_of_documents
from workers.results import Results

RESULTS = "results.json"
DECISIONS = "decisions.jsonl"
RECORDINGS = "recordings"
LOCK = ".lock"
PART = ".part"  # ends the name of a file that is still being written


class FolderError(ValueError):
    """The folder cannot take this run; nothing in it was touched."""


class RunFolder:
    """The folder of one run, held by one process. Made by `opened`; use it in a `with`."""

    def __init__(self, path: Path, results: Results, lock: int):
        self.path = path
        self.results = results
        self._lock = lock

    @classmethod
    def opened(cls, path: Path, wanted: Results) -> Self:
        """A new folder for these results, or the one that is there, cleared of unfinished episodes.

        Raises:
            FolderError: it holds another run or something else, is in use, or cannot be written.
        """
        try:
            _examine(path, wanted)
            path.mkdir(parents=True, exist_ok=True)
            lock = _lock(path)
            try:
                return cls._taken(path, wanted, lock)
            except BaseException:
                os.close(lock)
                raise
        except OSError as error:
            raise FolderError(f"{path} cannot be written: {error.strerror}.") from None

    @classmethod
    def _taken(cls, path: Path, wanted: Results, lock: int) -> Self:
        there = _examine(path, wanted)  # again: it may have changed before it was ours
        (path / RECORDINGS).mkdir(exist_ok=True)
        results = there.grown(wanted) if there else wanted.dated()
        folder = cls(path, results, lock)
        folder._save()
        folder.tidy()
        return folder

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._lock)

    @property
    def recordings(self) -> Path:
        """Where recordings are written."""
        return self.path / RECORDINGS

    def commit(self, result: EpisodeResult, decisions: Sequence[DecisionRecord]) -> None:
        """Keeps a finished episode, whatever happens next."""
        lines = [_line(result.task, result.index, decision) for decision in decisions]
        with open(self.path / DECISIONS, "a", encoding="utf-8") as file:
            file.writelines(lines)
            _flush(file)
        documents = [decision.model_dump(mode="json") for decision in decisions]
        self.results = self.results.with_episode(result).sealed(
            name_of(result), run_digest(result, documents), self._hashed(result)
        )
        self._save()

    def _hashed(self, result: EpisodeResult) -> dict[str, str]:
        """The hash of the episode's recording, by its path."""
        if result.recording is None or not (self.path / result.recording).is_file():
            return {}
        with (self.path / result.recording).open("rb") as file:
            return {result.recording: hashlib.file_digest(file, "sha256").hexdigest()}

    def tidy(self) -> None:
        """Removes what unfinished episodes left behind, and brings the decisions into order.

        Raises:
            FolderError: a line of the decisions is damaged.
        """
        keys = [(episode.task, episode.index) for episode in self.results.episodes]
        place = {key: number for number, key in enumerate(keys)}
        lines = [line for line in decision_lines(self.path) if _key(line) in place]
        _replace(self.path / DECISIONS, sorted(lines, key=lambda line: place[_key(line)]))
        for file in self.recordings.glob(f"*{PART}"):
            file.unlink()

    def _save(self) -> None:
        text = json.dumps(self.results.model_dump(mode="json"), indent=1) + "\n"
        _replace(self.path / RESULTS, [text])


def name_of(result: EpisodeResult) -> str:
    """An episode's name in files and messages."""
    return f"{result.task}-{result.split}-{result.index:03d}"


def run_digest(result: EpisodeResult, decisions: list[Any]) -> str:
    """SHA-256 of a result and its decisions' documents; what the clock said does not count."""
    return digest_of_documents(
        result.model_dump(mode="json", exclude=UNMEASURED), None, decisions, []
    )


def read(path: Path) -> Results:
    """The results in a run's folder.

    Raises:
        FolderError: there are none.
    """
    try:
        return Results.model_validate_json((path / RESULTS).read_bytes())
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise FolderError(f"{path / RESULTS} is not a run's: {where} {fault['msg']}.") from None
    except OSError as error:
        raise FolderError(f"{path} is no run's folder: {error.strerror}, {RESULTS}.") from None


def read_actions(path: Path) -> dict[tuple[str, int], list[Action]]:
    """The recorded actions of every finished episode, by (task, index).

    Raises:
        FolderError: the folder is not a run's, or its decisions are damaged.
    """
    actions: dict[tuple[str, int], list[Action]] = {key: [] for key in read(path).finished}
    for line in decision_lines(path):
        if _key(line) in actions:
            actions[_key(line)].append(_action(line))
    return actions


def _examine(path: Path, wanted: Results) -> Results | None:
    """The results that are there, None in a new folder.

    Raises:
        FolderError: they are another run's, or the folder is something else.
    """
    if not path.exists():
        return None
    if not path.is_dir():
        raise FolderError(f"{path} is a file; expected a folder for the run.")
    names = {file.name for file in path.iterdir()}
    if LOCK in names:  # ours, before its first results were written
        names -= {LOCK, RECORDINGS, *(f".{name}{PART}" for name in (RESULTS, DECISIONS))}
    if not names:
        return None
    if RESULTS not in names:
        raise FolderError(f"{path} holds something else ({min(names)}); give a new folder.")
    there = read(path)
    if difference := there.same_run(wanted):
        raise FolderError(f"{path} holds a run with {difference}; give a new folder.")
    return there


def _lock(path: Path) -> int:
    lock = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(lock)
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise FolderError(f"{path} is in use by another run; wait, or give another.") from None
        raise
    return lock


def decision_lines(path: Path) -> list[str]:
    """Complete lines; a last line without its end was cut off by a crash."""
    try:
        text = (path / DECISIONS).read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return []
    return [f"{line}\n" for line in text.split("\n")[:-1]]


def _line(task: str, index: int, decision: DecisionRecord) -> str:
    return json.dumps({"task": task, "index": index, **decision.model_dump(mode="json")}) + "\n"


def _key(line: str) -> tuple[str, int]:
    try:
        decision: dict[str, Any] = json.loads(line)
        return decision["task"], decision["index"]
    except (ValueError, KeyError, TypeError):
        raise FolderError(f"{DECISIONS} is damaged at: {line[:60].strip()}") from None


def _action(line: str) -> Action:
    try:
        return parse_action(json.loads(line)["action"])
    except (KeyError, InvalidAction) as error:
        raise FolderError(f"{DECISIONS} is damaged: {error}") from None


def _replace(path: Path, lines: Iterable[str]) -> None:
    """Writes a file whole or not at all, power cuts included."""
    part = path.with_name(f".{path.name}{PART}")
    with open(part, "w", encoding="utf-8") as file:
        file.writelines(lines)
        _flush(file)
    part.replace(path)
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _flush(file: Any) -> None:
    file.flush()
    os.fsync(file.fileno())
