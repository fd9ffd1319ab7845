"""The keyframe store: demonstrations as point clouds in flat files that are mapped, not read.

A folder holds `index.json` and `<task>/<split>/<array>.npy`. Every keyframe of every demonstration
is one row, once. Whatever stands under its final name is whole; a store is built again only if
the demonstrations, or how clouds are thinned, have changed.
"""

import hashlib
import json
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from hide_tasks import SUITES
from hide_tasks.contract import Split, Variation
from hide_tasks.demos import Demonstration, DemosError, Folder, read
from hide_tasks.layout import BOUNDS
from hide_tasks.suite import SUITE, VERSION
from seek_model.clouds import Cloud, cloud_of_images, thin, to_cube

FORMAT = 1
INDEX = "index.json"
STEPS = 32767  # of a coordinate between the cube's middle and its side: 0.015 mm each
FEWEST = 0.01  # of the pixels of a keyframe that must lie in bounds (RVT issue 67)
UNIT = 1e-3  # by which a quaternion's length may differ from 1

_COLUMNS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "pose": (np.float64, (7,)),
    "opening": (np.float64, ()),
    "action_pose": (np.float64, (7,)),
    "action_opening": (np.float64, ()),
    "ignore_collisions": (np.bool_, ()),
    "stage": (np.int64, ()),
    "boundary": (np.bool_, ()),
    "stop": (np.bool_, ()),
    "evidence": (np.int64, ()),
    "episode": (np.int64, ()),
    "decision": (np.int64, ()),
    "in_bounds": (np.float64, ()),
}


class StoreError(ValueError):
    """A store, or what it should be built of, cannot be used; the message says which and why."""


class Episode(BaseModel):
    """A demonstration's place in its part of the store."""

    model_config = ConfigDict(frozen=True)

    index: int  # in its split of the suite
    instruction: str
    variation: Variation
    first: int  # its first row
    keyframes: int


class _Index(BaseModel):
    model_config = ConfigDict(frozen=True)

    format: int = FORMAT
    suite: str = SUITE
    version: int = VERSION
    points: int  # the most of one cloud
    voxel: float  # m
    demos: str  # hash of what it was built of
    sources: dict[str, str]  # per task, hash of the code that recorded the demonstrations
    parts: dict[str, dict[Split, tuple[Episode, ...]]] = {}
    data: str = ""  # hash of all arrays

    def same_origin(self, other: "_Index") -> bool:
        """True if one was built as the other would be."""
        return all(
            getattr(self, field) == getattr(other, field)
            for field in type(self).model_fields
            if field not in ("parts", "data")
        )


@dataclass(frozen=True)
class Part:
    """The keyframes of one task and split; rows in the order of episodes, then of decisions.

    Poses are as in the contract: world, metres, quaternions x y z w.
    """

    points: NDArray[np.int16]  # (p, 3) cube, in STEPS
    colors: NDArray[np.uint8]  # (p, 3)
    offsets: NDArray[np.int64]  # (n + 1,) where a keyframe's points begin
    pose: NDArray[np.float64]  # (n, 7) of the tip, before the keyframe
    opening: NDArray[np.float64]  # (n,)
    action_pose: NDArray[np.float64]  # (n, 7)
    action_opening: NDArray[np.float64]  # (n,)
    ignore_collisions: NDArray[np.bool_]  # (n,) as the keyframe itself says (RVT issue 91)
    stage: NDArray[np.int64]  # (n,) how many stages are done before
    boundary: NDArray[np.bool_]  # (n,) a stage ends with it
    stop: NDArray[np.bool_]  # (n,) it is the last
    evidence: NDArray[np.int64]  # (n,) decision that an oracle would look back at; -1: none
    episode: NDArray[np.int64]  # (n,) the episode's index in the split
    decision: NDArray[np.int64]  # (n,) number in the episode, from 0
    in_bounds: NDArray[np.float64]  # (n,) share of the pixels whose point lies in the workspace

    def __len__(self) -> int:
        return len(self.decision)

    def clouds(
        self, rows: slice
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.int64]]:
        """What is seen before consecutive keyframes, in one list: points, colours, counts.

        The points (p, 3) are in the cube.
        """
        offsets = self.offsets[rows.start : rows.stop + 1]
        here = slice(offsets[0], offsets[-1])
        points = self.points[here] * np.float32(1 / STEPS)
        return points, np.array(self.colors[here]), np.diff(offsets)


@dataclass(frozen=True)
class Store:
    """A store that is there."""

    path: Path
    index: _Index
    parts: dict[tuple[str, Split], Part]

    @classmethod
    def open(cls, path: Path) -> "Store":
        """Maps the arrays of a store.

        Raises:
            StoreError: it is none, damaged, or of another version of the suite.
        """
        index = _read_index(path)
        parts = {
            (task, split): _open_part(path / task / split, sum(e.keyframes for e in episodes))
            for task, splits in index.parts.items()
            for split, episodes in splits.items()
        }
        return cls(path, index, parts)

    @property
    def digest(self) -> str:
        """SHA-256 of everything that is stored."""
        return self.index.data

    @property
    def tasks(self) -> tuple[str, ...]:
        """By name."""
        return tuple(sorted(self.index.parts))

    def episodes(self, task: str, split: Split) -> tuple[Episode, ...]:
        """By index; empty if there are none."""
        return self.index.parts.get(task, {}).get(split, ())

    def part(self, task: str, split: Split) -> Part:
        """The keyframes of a task and split that has episodes."""
        return self.parts[task, split]


def _read_index(path: Path) -> _Index:
    try:
        index = _Index.model_validate_json((path / INDEX).read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        raise StoreError(f"{path} is no keyframe store: it has no {INDEX}.") from None
    except ValidationError as error:
        raise StoreError(f"{path / INDEX} is damaged: {error}") from None
    if index.format != FORMAT:
        raise StoreError(f"{path} is of format {index.format}, not {FORMAT}. Build it again.")
    if index.suite not in SUITES or index.version != VERSION:
        known = ", ".join(f"{suite} {VERSION}" for suite in SUITES)
        raise StoreError(
            f"{path} is of suite {index.suite} {index.version}; this build knows {known}. "
            "Record the demonstrations and build the store again."
        )
    return index


def _open_part(path: Path, count: int) -> Part:
    clouds = {name: _load(path, name, mapped=True) for name in ("points", "colors")}
    columns = {name: _load(path, name) for name in ("offsets", *_COLUMNS)}
    total = len(clouds["points"])
    shapes = {"points": (total, 3), "colors": (total, 3), "offsets": (count + 1,)}
    shapes |= {name: (count, *shape) for name, (_, shape) in _COLUMNS.items()}
    part = Part(**clouds, **columns)
    for name, shape in shapes.items():
        if getattr(part, name).shape != shape:
            found = getattr(part, name).shape
            raise StoreError(f"{path / name}.npy is damaged: {found}; expected {shape}.")
    if part.offsets[-1] != total or (np.diff(part.offsets) <= 0).any():
        raise StoreError(f"{path}/offsets.npy is damaged: a cloud is empty or missing.")
    return part


def _load(path: Path, name: str, *, mapped: bool = False) -> NDArray[Any]:
    file = path / f"{name}.npy"
    try:
        return np.asanyarray(np.load(file, mmap_mode="r" if mapped else None, allow_pickle=False))
    except FileNotFoundError:
        raise StoreError(f"{file} is missing. Build the store again.") from None
    except (OSError, EOFError, ValueError) as error:
        raise StoreError(f"{file} is damaged: {error}. Build the store again.") from None


# --- building -----------------------------------------------------------------------------------


def build(
    demos: Path,
    out: Path,
    *,
    points: int,
    voxel: float,
    splits: Sequence[Split] = ("train", "val"),
    executor: Executor | None = None,
) -> Store:
    """The store of a folder of demonstrations: the one that is there, or built in its place.

    Args:
        demos: a folder of `hide demos`.
        out: the store's folder; an older store there is replaced.
        points: the most of one cloud.
        voxel: m; one point of each is kept, all if 0.
        splits: those of them that the demonstrations have.
        executor: spreads the work over processes.

    Raises:
        StoreError: a demonstration is not fit for training; nothing was built. Or `out` holds
            something else.
    """
    folder = _open_folder(demos)
    files = {
        (task, split): found
        for task in folder.tasks
        for split in splits
        if (found := folder.files(task, split))
    }
    if not files:
        raise StoreError(f"{demos} has no demonstrations of {' or '.join(splits)}.")
    origin = {"suite": folder.suite, "demos": _origin(files), "sources": folder.sources}
    plan = _Index(points=points, voxel=voxel, **origin)
    if there := _reusable(out, plan):
        return there
    if out.exists() and not _replaceable(out):
        raise StoreError(
            f"{out} holds something else than a whole keyframe store. "
            "Give another folder, or delete this one."
        )
    _build_aside(out, plan, files, executor)
    return Store.open(out)


def _open_folder(path: Path) -> Folder:
    try:
        return Folder.open(path)
    except DemosError as error:
        raise StoreError(str(error)) from None


def _origin(files: dict[tuple[str, Split], list[Path]]) -> str:
    """Hash of the demonstrations by the checksums that their files carry."""
    digest = hashlib.sha256()
    for (task, _), paths in files.items():
        for path in paths:
            try:
                with zipfile.ZipFile(path) as file:
                    sums = [(one.filename, one.CRC) for one in file.infolist()]
            except (OSError, zipfile.BadZipFile) as error:
                raise StoreError(f"{path} is damaged or no demonstration: {error}") from None
            digest.update(repr((task, path.name, sums)).encode())
    return digest.hexdigest()


def _reusable(out: Path, plan: _Index) -> Store | None:
    try:
        store = Store.open(out)
    except StoreError:  # none, or not whole: it is built again from the demonstrations
        return None
    return store if store.index.same_origin(plan) else None


def _replaceable(out: Path) -> bool:
    """True of an empty folder, and of a store of any version with nothing else in it."""
    if not out.is_dir():
        return False
    if not any(out.iterdir()):
        return True
    try:
        parts = json.loads((out / INDEX).read_text())["parts"]
        known = {INDEX} | {f"{task}/{split}" for task in parts for split in parts[task]}
    except (OSError, ValueError, KeyError, TypeError):
        return False
    files = [file.relative_to(out) for file in out.rglob("*") if not file.is_dir()]
    return all(
        file.as_posix() in known or (file.parent.as_posix() in known and file.suffix == ".npy")
        for file in files
    )


def _build_aside(
    out: Path,
    plan: _Index,
    files: dict[tuple[str, Split], list[Path]],
    executor: Executor | None,
) -> None:
    aside = out.with_name(f".{out.name}.{os.getpid()}.part")
    old = out.with_name(f".{out.name}.{os.getpid()}.old")
    shutil.rmtree(aside, ignore_errors=True)
    try:
        jobs = [
            (paths, aside / task / split, plan.points, plan.voxel)
            for (task, split), paths in files.items()
        ]
        built = (executor.map if executor else map)(_build_part, *zip(*jobs, strict=True))
        parts: dict[str, dict[Split, tuple[Episode, ...]]] = {}
        for (task, split), episodes in zip(files, built, strict=True):
            parts.setdefault(task, {})[split] = episodes
        index = plan.model_copy(update={"parts": parts, "data": _digest(aside)})
        (aside / INDEX).write_text(index.model_dump_json(indent=1) + "\n")
        _swap(aside, out, old)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _swap(aside: Path, out: Path, old: Path) -> None:
    """The new folder in the old one's place; the old one stays where that fails."""
    if out.exists():
        out.rename(old)
    try:
        aside.rename(out)
    except BaseException:
        if old.exists():
            old.rename(out)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _build_part(paths: Sequence[Path], out: Path, points: int, voxel: float) -> tuple[Episode, ...]:
    """Writes the arrays of one task and split; its episodes."""
    out.mkdir(parents=True)
    rows: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
    episodes, offsets = [], [0]
    with (
        _Growing(out / "points.npy", np.int16) as positions,
        _Growing(out / "colors.npy", np.uint8) as colors,
    ):
        for path in paths:
            demonstration = _sound(path)
            shares = []
            for keyframe in range(len(demonstration)):
                cloud, share = _cloud(demonstration, keyframe, path, points, voxel)
                positions.append(np.round(to_cube(cloud.points) * STEPS))
                colors.append(cloud.colors)
                offsets.append(offsets[-1] + len(cloud.points))
                shares.append(share)
            episodes.append(_entry(demonstration, len(rows["stop"])))
            for name, values in _columns(demonstration, shares).items():
                rows[name].extend(values)
    np.save(out / "offsets.npy", np.array(offsets, np.int64))
    for name, (kind, _) in _COLUMNS.items():
        np.save(out / f"{name}.npy", np.array(rows[name], kind))
    return tuple(episodes)


def _entry(demonstration: Demonstration, first: int) -> Episode:
    return Episode(
        index=demonstration.spec.index,
        instruction=demonstration.instruction,
        variation=demonstration.spec.variation,
        first=first,
        keyframes=len(demonstration),
    )


def _columns(demonstration: Demonstration, shares: Sequence[float]) -> dict[str, Iterable[Any]]:
    count = len(demonstration)
    same = ("action_pose", "action_opening", "ignore_collisions", "boundary", "stop", "evidence")
    return {
        **{name: getattr(demonstration, name) for name in same},
        "pose": demonstration.gripper_pose,
        "opening": demonstration.gripper_opening,
        # The model counts boundaries, so that is what it is told.
        "stage": np.cumsum(demonstration.boundary) - demonstration.boundary,
        "episode": [demonstration.spec.index] * count,
        "decision": range(count),
        "in_bounds": shares,
    }


class _Growing:
    """A .npy file of rows of three whose number is known only at the end."""

    def __init__(self, path: Path, kind: type[np.generic]):
        self.path, self.kind, self.rows = path, np.dtype(kind), 0

    def __enter__(self) -> "_Growing":
        self.file = open(self.path, "wb")
        self.header()
        return self

    def append(self, rows: NDArray[Any]) -> None:
        self.file.write(rows.astype(self.kind).tobytes())
        self.rows += len(rows)

    def header(self) -> None:
        # numpy pads a header so that its first axis can grow in place.
        np.lib.format.write_array_header_1_0(
            self.file,
            {"descr": self.kind.str, "fortran_order": False, "shape": (self.rows, 3)},
        )

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.file.seek(0)
        self.header()
        self.file.close()


def _digest(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(folder.glob("*/*/*.npy")):
        digest.update(file.relative_to(folder).as_posix().encode())
        with open(file, "rb") as stream:
            digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()


# --- checking -----------------------------------------------------------------------------------


def _sound(path: Path) -> Demonstration:
    """A demonstration whose numbers are numbers and whose targets can be reached."""
    try:
        demonstration = read(path)
    except DemosError as error:
        raise StoreError(str(error)) from None
    for keyframe, fault in _faults(demonstration):
        raise StoreError(f"{path}, keyframe {keyframe}: {fault}.")
    return demonstration


def _faults(demonstration: Demonstration) -> Iterator[tuple[int, str]]:
    for name in (
        "intrinsics",
        "camera_to_world",
        "gripper_pose",
        "gripper_opening",
        "joint_positions",
        "action_pose",
        "action_opening",
    ):
        values = getattr(demonstration, name).reshape(len(demonstration), -1)
        for keyframe in np.flatnonzero(~np.isfinite(values).all(axis=1)):
            yield int(keyframe), f"{name} is not finite"
    for name in ("gripper_pose", "action_pose"):
        lengths = np.linalg.norm(getattr(demonstration, name)[:, 3:], axis=1)
        for keyframe in np.flatnonzero(np.abs(lengths - 1) > UNIT):
            yield int(keyframe), f"the quaternion of {name} has length {lengths[keyframe]:g}, not 1"
    for keyframe in np.flatnonzero(~_inside(demonstration.action_pose)):
        target = demonstration.action_pose[keyframe, :3].round(3).tolist()
        yield int(keyframe), f"the target {target} m is out of bounds, {BOUNDS}"


def _inside(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    low, high = np.array(BOUNDS).T
    return np.asarray(((poses[:, :3] >= low) & (poses[:, :3] <= high)).all(axis=1))


def _cloud(
    demonstration: Demonstration, keyframe: int, path: Path, points: int, voxel: float
) -> tuple[Cloud, float]:
    """A thinned cloud, and the share of the pixels whose point lies in bounds."""
    pixels = demonstration.depth[keyframe].size
    try:
        cloud = cloud_of_images(
            demonstration.metres(keyframe),
            demonstration.rgb[keyframe],
            demonstration.intrinsics[keyframe],
            demonstration.camera_to_world[keyframe],
            points=pixels,
            voxel=0.0,
        )
    except ValueError as error:
        raise StoreError(f"{path}, keyframe {keyframe}: {error}.") from None
    share = len(cloud.points) / pixels
    if share < FEWEST:
        raise StoreError(
            f"{path}, keyframe {keyframe}: {share:.2%} of the pixels lie in bounds; expected "
            f"{FEWEST:.0%} or more. Check the cameras' poses and the unit of depth."
        )
    return thin(cloud, voxel, points), share


class Report(NamedTuple):
    """What one task's part of a store looks like."""

    episodes: int
    keyframes: tuple[int, float, int]  # an episode: fewest, mean, most
    points: float  # of a keyframe, mean
    points_in_bounds: tuple[float, float]  # share of a keyframe's pixels: least, mean
    targets_in_bounds: float  # share
    boundaries: float  # share of the keyframes with which a stage ends


def check(store: Store) -> dict[tuple[str, Split], Report]:
    """Reads all of a store; a report for every task and split.

    Raises:
        StoreError: a file is not what was built.
    """
    if _digest(store.path) != store.digest:
        raise StoreError(f"{store.path} is not what was built: its hash differs. Build it again.")
    return {
        (task, split): _report(part, [e.keyframes for e in store.episodes(task, split)])
        for (task, split), part in store.parts.items()
    }


def _report(part: Part, keyframes: Sequence[int]) -> Report:
    return Report(
        episodes=len(keyframes),
        keyframes=(min(keyframes), float(np.mean(keyframes)), max(keyframes)),
        points=len(part.points) / len(part),
        points_in_bounds=(float(part.in_bounds.min()), float(part.in_bounds.mean())),
        targets_in_bounds=float(_inside(part.action_pose).mean()),
        boundaries=float(part.boundary.mean()),
    )
