"""Demonstrations: the expert's episodes keyframe by keyframe, for training, as files of arrays.

A folder holds `demos.json` and `<task>/<split>-<index>.npz`. Whatever stands under its final name
is whole, so recording that was interrupted goes on where it was. Files are read with numpy alone:
nothing is unpickled, and the simulator is imported only by `record`.
"""

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, get_args

import numpy as np
from numpy.typing import NDArray

from hide_tasks import SUITES, suite
from hide_tasks.catalogue import suite_of
from hide_tasks.contract import (
    IMAGE_SIZE,
    Action,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    HiddenState,
    Keyframe,
    Observation,
    Split,
    Start,
)
from hide_tasks.sources import sources_hash

if TYPE_CHECKING:
    from hide_tasks.bullet.scene import Part
    from hide_tasks.bullet.world import World
    from hide_tasks.script import Step

FORMAT = 1
INDEX = "demos.json"
DEPTH_UNIT = 1e-4  # m of one step of a stored depth; 65535 of them are 6.5 m

_CAMERAS = -1  # as many as the task has
_ARRAYS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "rgb": (np.uint8, (_CAMERAS, IMAGE_SIZE, IMAGE_SIZE, 3)),
    "depth": (np.uint16, (_CAMERAS, IMAGE_SIZE, IMAGE_SIZE)),
    "intrinsics": (np.float64, (_CAMERAS, 3, 3)),
    "camera_to_world": (np.float64, (_CAMERAS, 4, 4)),
    "gripper_pose": (np.float64, (7,)),
    "gripper_opening": (np.float64, ()),
    "joint_positions": (np.float64, (7,)),
    "action_pose": (np.float64, (7,)),
    "action_opening": (np.float64, ()),
    "ignore_collisions": (np.bool_, ()),
    "stop": (np.bool_, ()),
    "stage": (np.int64, ()),
    "boundary": (np.bool_, ()),
    "evidence": (np.int64, ()),
}


class DemosError(ValueError):
    """A folder or a file of demonstrations cannot be used; the message names it and says why."""


@dataclass(frozen=True)
class Demonstration:
    """An exact episode of the expert with n keyframes; row t of an array belongs to keyframe t.

    Cameras come in the order of the task's, c of them; poses are those of the contract.
    """

    spec: EpisodeSpec
    sources: str  # hash of the code that played and drew it
    result: EpisodeResult  # without timing
    stages: tuple[str, ...]  # the name of every keyframe's stage
    hidden: tuple[HiddenState, ...]  # before every keyframe
    rgb: NDArray[np.uint8]  # (n, c, h, w, 3)
    depth: NDArray[np.uint16]  # (n, c, h, w) in DEPTH_UNIT; 0 where there is none, or too far
    intrinsics: NDArray[np.float64]  # (n, c, 3, 3)
    camera_to_world: NDArray[np.float64]  # (n, c, 4, 4)
    gripper_pose: NDArray[np.float64]  # (n, 7) of the tip, before the keyframe
    gripper_opening: NDArray[np.float64]  # (n,) 0 shut, 1 open
    joint_positions: NDArray[np.float64]  # (n, 7) rad
    action_pose: NDArray[np.float64]  # (n, 7) what the keyframe asks for
    action_opening: NDArray[np.float64]  # (n,)
    ignore_collisions: NDArray[np.bool_]  # (n,)
    stop: NDArray[np.bool_]  # (n,) true of the last alone
    stage: NDArray[np.int64]  # (n,) the stage's number, from 0; a name may come again
    boundary: NDArray[np.bool_]  # (n,) the stage ends with this keyframe
    evidence: NDArray[np.int64]  # (n,) the last earlier keyframe that changed z; -1: none

    def __len__(self) -> int:
        return len(self.stop)

    @property
    def instruction(self) -> str:
        """What the policy was told."""
        return self.result.instruction

    def metres(self, keyframe: int) -> NDArray[np.float32]:
        """(c, h, w) depths before a keyframe along the optical axes; NaN where there is none."""
        steps = self.depth[keyframe]
        return np.where(steps > 0, steps * np.float32(DEPTH_UNIT), np.float32(np.nan))


# --- recording ----------------------------------------------------------------------------------


class _Script:
    """The expert, who remembers the steps that it took."""

    def bind(self, world: "World", spec: EpisodeSpec) -> None:
        self.task = world.task

    def reset(self, instruction: str, policy_seed: int) -> None:
        from hide_tasks.script import steps

        self.left = steps(self.task)
        self.taken: list[Step] = []

    def act(self, observation: Observation) -> Action:
        self.taken.append(next(self.left))
        return self.taken[-1].keyframe


@dataclass
class _Notes:
    """A witness of what is seen before every keyframe, and of the hidden state around it."""

    observations: list[Observation] = field(default_factory=list)
    hidden: list[HiddenState] = field(default_factory=list)

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: "Sequence[Part]", start: Start
    ) -> None:
        self.hidden.append(start.hidden)

    def frame(self, time: float, poses: NDArray[np.float64]) -> None:
        """Nothing between keyframes is kept."""

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        self.observations.append(observation)
        self.hidden.append(record.hidden)

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """What is seen after the last keyframe calls for none."""


def record(spec: EpisodeSpec) -> Demonstration:
    """The expert's episode.

    Raises:
        DemosError: the expert was not exact.
    """
    from hide_tasks.episode import play

    expert, notes = _Script(), _Notes()
    result, _ = play(spec, expert, witnesses=[notes])
    if not result.exact:
        reason = f": {result.detail}" if result.detail else ""
        raise DemosError(f"{spec.name}: the expert was not exact: {result.failure}{reason}.")
    numbers = [step.number for step in expert.taken]
    return Demonstration(
        spec=spec,
        sources=_sources(spec.task),
        result=EpisodeResult(**result.model_dump(exclude={"timing"})),
        stages=tuple(step.stage for step in expert.taken),
        hidden=tuple(notes.hidden[:-1]),
        **_seen(notes.observations),
        **_asked([step.keyframe for step in expert.taken]),
        stage=np.array(numbers),
        boundary=np.array([a != b for a, b in zip(numbers, [*numbers[1:], -1], strict=True)]),
        evidence=evidence_of(notes.hidden[:-1]),
    )


def _seen(observations: Sequence[Observation]) -> dict[str, Any]:
    def images(part: str) -> list[list[NDArray[Any]]]:
        return [[getattr(view, part) for view in seen.views.values()] for seen in observations]

    steps = np.round(np.array(images("depth"), np.float64) / DEPTH_UNIT)
    known = np.isfinite(steps) & (steps <= np.iinfo(np.uint16).max)
    return {
        "rgb": np.array(images("rgb")),
        "depth": np.where(known, steps, 0.0).astype(np.uint16),
        "intrinsics": np.array(images("intrinsics")),
        "camera_to_world": np.array(images("camera_to_world")),
        "gripper_pose": np.array([seen.gripper_pose for seen in observations]),
        "gripper_opening": np.array([float(seen.gripper_opening) for seen in observations]),
        "joint_positions": np.array([seen.joint_positions for seen in observations]),
    }


def _asked(keyframes: Sequence[Keyframe]) -> dict[str, Any]:
    return {
        "action_pose": np.array([keyframe.pose for keyframe in keyframes]),
        "action_opening": np.array([keyframe.opening for keyframe in keyframes]),
        "ignore_collisions": np.array([keyframe.ignore_collisions for keyframe in keyframes]),
        "stop": np.array([keyframe.stop for keyframe in keyframes]),
    }


def evidence_of(hidden: Sequence[HiddenState]) -> NDArray[np.int64]:
    """(n,) for every keyframe the last earlier one during which the hidden state changed, or -1.

    It is where somebody who may look back once should look; `hidden` is the state before each.
    """
    found = [-1]
    for i in range(1, len(hidden)):
        found.append(i - 1 if hidden[i] != hidden[i - 1] else found[-1])
    return np.array(found[: len(hidden)], np.int64)


@lru_cache(maxsize=64)
def _sources(task: str) -> str:
    return sources_hash(task, certified=True)  # what is drawn counts here


# --- one file -----------------------------------------------------------------------------------


def write(demonstration: Demonstration, path: Path) -> None:
    """Writes a file whole or not at all."""
    document = {
        "format": FORMAT,
        "spec": demonstration.spec.model_dump(),
        "sources": demonstration.sources,
        "result": demonstration.result.model_dump(mode="json", exclude={"timing"}),
        "stages": demonstration.stages,
        "hidden": demonstration.hidden,
    }
    arrays = {name: getattr(demonstration, name) for name in _ARRAYS}
    path.parent.mkdir(parents=True, exist_ok=True)
    _replace(path, lambda part: _compress(part, json.dumps(document), arrays))


def _compress(part: Path, document: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    with open(part, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, document=np.array(document), **arrays)


def _replace(path: Path, fill: Callable[[Path], object]) -> None:
    part = path.with_name(f".{path.name}.part")  # the next attempt takes the same name
    try:
        fill(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read(path: Path) -> Demonstration:
    """A file of `write`.

    Raises:
        DemosError: it is damaged, of another format, or of another version of the suite.
    """
    try:
        # A damaged file would stay open if np.load had opened it.
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as file:
            held = {name: file[name] for name in file.files}
    except (OSError, EOFError, ValueError, TypeError, zipfile.BadZipFile, zlib.error) as error:
        raise DemosError(f"{path} is damaged or no demonstration: {error}") from None
    if missing := {"document", *_ARRAYS} - set(held):
        raise DemosError(f"{path} lacks arrays: {', '.join(sorted(missing))}.")
    document = _document(path, str(held["document"]))
    demonstration = Demonstration(**document, **{name: held[name] for name in _ARRAYS})
    _require_shapes(demonstration, path)
    return demonstration


def _document(path: Path, text: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
        if document.pop("format") != FORMAT:
            raise DemosError(f"{path} is of another format than {FORMAT}. Record it again.")
        document["spec"] = EpisodeSpec.model_validate(document["spec"])
        document["result"] = EpisodeResult.model_validate(document["result"])
        document["stages"] = tuple(document["stages"])
        document["hidden"] = tuple(document["hidden"])
    except DemosError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DemosError(f"{path} is damaged: {error}") from None
    _require_suite(document["spec"].suite, document["spec"].version, path)
    return dict(document)


def _require_shapes(demonstration: Demonstration, path: Path) -> None:
    count, cameras = len(demonstration.stages), demonstration.rgb.shape[1:2]
    for name, (kind, sizes) in _ARRAYS.items():
        array = getattr(demonstration, name)
        shape = (count, *cameras, *sizes[1:]) if sizes[:1] == (_CAMERAS,) else (count, *sizes)
        if array.dtype != kind or array.shape != shape or not count:
            raise DemosError(
                f"{path}: {name} is {array.dtype} {array.shape}; "
                f"expected {np.dtype(kind)} {shape} with a row for every keyframe"
            )


def _require_suite(name: str, version: int, path: Path) -> None:
    if name not in SUITES or version != suite.VERSION:
        known = ", ".join(f"{one} {suite.VERSION}" for one in SUITES)
        raise DemosError(
            f"{path} is of suite {name} {version}; this build knows {known}. "
            "Record it again into another folder."
        )


# --- a folder -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Folder:
    """A folder of demonstrations of one version of the suite."""

    path: Path
    sources: dict[str, str]  # per task, the code that its episodes were recorded by
    splits: tuple[Split, ...]
    suite: str = suite.SUITE  # that all its tasks are of

    @property
    def tasks(self) -> tuple[str, ...]:
        """Those that were asked for, by name."""
        return tuple(sorted(self.sources))

    @classmethod
    def open(cls, path: Path) -> Self:
        """A folder that is there.

        Raises:
            DemosError: it is none, or one of another version of the suite.
        """
        file = path / INDEX
        try:
            held = json.loads(file.read_text())
            if held["format"] != FORMAT:
                raise DemosError(f"{path} is of format {held['format']}, not {FORMAT}.")
            _require_suite(held["suite"], held["version"], path)
            splits = tuple(split for split in get_args(Split) if split in held["splits"])
            return cls(path, dict(held["sources"]), splits, held["suite"])
        except FileNotFoundError:
            hint = "`hide demos --out DIR` makes one."
            raise DemosError(f"{path} is no folder of demonstrations: no {INDEX}. {hint}") from None
        except NotADirectoryError:
            raise DemosError(f"{path} is no folder. Give one of `hide demos`.") from None
        except DemosError:
            raise
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DemosError(f"{file} is damaged: {error}") from None

    @classmethod
    def prepare(cls, path: Path, tasks: Sequence[str], split: Split) -> Self:
        """The folder made, or the one that is there, ready for more of these tasks.

        Raises:
            DemosError: it holds something else, another suite, or demonstrations by other sources.
        """
        strangers = path.exists() and (not path.is_dir() or any(path.iterdir()))
        there = cls.open(path) if strangers else cls(path, {}, (), suite_of(tasks[0]))
        if others := {suite_of(task) for task in tasks} - {there.suite}:
            raise DemosError(
                f"{path} is for demonstrations of suite {there.suite}, not {', '.join(others)}. "
                "Give another folder for each suite."
            )
        wanted = {task: _sources(task) for task in tasks}
        for task in tasks:
            other = there.sources.get(task, wanted[task]) != wanted[task]
            if other and any((path / task).glob("*.npz")):
                raise DemosError(
                    f"{path} holds demonstrations of {task} by another version of the sources. "
                    f"Give another folder, or delete {path / task}."
                )
        splits = tuple({*there.splits, split})
        folder = cls(path, there.sources | wanted, splits, there.suite)
        folder.write()
        return folder

    def write(self) -> None:
        """Writes `demos.json`."""
        document = {
            "format": FORMAT,
            "suite": self.suite,
            "version": suite.VERSION,
            "tasks": self.tasks,
            "splits": sorted(self.splits),
            "sources": self.sources,
        }
        self.path.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document, indent=1) + "\n"
        _replace(self.path / INDEX, lambda part: part.write_text(text))

    def file(self, spec: EpisodeSpec) -> Path:
        """Where an episode is or will be."""
        return self.path / spec.task / f"{spec.split}-{spec.index:03d}.npz"

    def files(self, task: str, split: Split) -> list[Path]:
        """The files that are there, by index."""
        return sorted((self.path / task).glob(f"{split}-[0-9]*.npz"))

    def left(self, specs: Sequence[EpisodeSpec]) -> list[EpisodeSpec]:
        """The episodes that are not there yet."""
        return [spec for spec in specs if not self.file(spec).is_file()]

    def add(self, spec: EpisodeSpec) -> int:
        """Records an episode; the size of its file in bytes.

        Raises:
            DemosError: the expert was not exact.
        """
        write(record(spec), self.file(spec))
        return self.file(spec).stat().st_size
