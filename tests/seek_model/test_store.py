"""The keyframe store: what is in it, when it is built, what it refuses."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hide_tasks.demos import Folder, read, write
from seek_model.clouds import cloud_of_images, to_cube
from seek_model.store import Store, StoreError, build, check
from tests.seek_model.stores import changed, demonstration, plate_height, record, store

COUNTS = {("count", "train"): [3, 7], ("count", "val"): [4], ("open", "train"): [5]}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Store:
    return store(tmp_path_factory.mktemp("whole"), COUNTS)


def test_every_keyframe_is_stored_once(whole):
    part = whole.part("count", "train")

    rows = list(zip(part.episode.tolist(), part.decision.tolist(), strict=True))
    assert rows == [(0, t) for t in range(3)] + [(1, t) for t in range(7)]
    assert [(e.first, e.keyframes) for e in whole.episodes("count", "train")] == [(0, 3), (3, 7)]
    assert whole.tasks == ("count", "open")
    assert whole.episodes("open", "val") == ()
    assert [e.instruction for e in whole.episodes("count", "train")] == ["count to 0", "count to 1"]


def test_points_keep_their_place_to_a_tenth_of_a_millimetre(whole):
    demo = read(whole.path.parent / "demos" / "count" / "train-001.npz")
    part = whole.part("count", "train")

    for keyframe in range(7):
        seen = cloud_of_images(
            demo.metres(keyframe),
            demo.rgb[keyframe],
            demo.intrinsics[keyframe],
            demo.camera_to_world[keyframe],
            points=100,
            voxel=0.05,
        )
        points, colors, counts = part.clouds(slice(3 + keyframe, 4 + keyframe))
        assert counts.tolist() == [len(seen.points)]
        np.testing.assert_allclose(points, to_cube(seen.points), atol=2e-5)  # 0.01 mm
        np.testing.assert_array_equal(colors, seen.colors)


def test_labels_are_those_of_the_keyframe_itself(whole):
    demo = read(whole.path.parent / "demos" / "count" / "train-001.npz")
    part = whole.part("count", "train")

    for name in ("action_pose", "ignore_collisions", "boundary", "stop", "evidence"):
        np.testing.assert_array_equal(getattr(part, name)[3:], getattr(demo, name))
    np.testing.assert_array_equal(part.pose[3:], demo.gripper_pose)
    assert part.stage[3:].tolist() == [0, 0, 1, 1, 2, 2, 3]


def test_a_store_is_built_once(tmp_path):
    first = store(tmp_path, {("count", "train"): [3]})
    written = (first.path / "index.json").stat().st_mtime_ns

    again = build(tmp_path / "demos", tmp_path / "store", points=100, voxel=0.05)

    assert again.digest == first.digest
    assert (again.path / "index.json").stat().st_mtime_ns == written


def test_a_store_of_the_same_demonstrations_is_the_same(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()

    first, second = (store(tmp_path / name, {("count", "train"): [3]}) for name in "ab")

    assert first.digest == second.digest


def test_other_points_or_demonstrations_build_it_again(tmp_path):
    first = store(tmp_path, {("count", "train"): [3]})

    fewer = build(tmp_path / "demos", tmp_path / "store", points=50, voxel=0.05)
    made = demonstration(index=1)
    write(made, Folder.open(tmp_path / "demos").file(made.spec))
    more = build(tmp_path / "demos", tmp_path / "store", points=50, voxel=0.05)

    assert len({first.digest, fewer.digest, more.digest}) == 3
    assert len(more.part("count", "train")) == 8
    assert sorted(path.name for path in tmp_path.iterdir()) == ["demos", "store"]


def test_the_report_counts(whole):
    report = check(whole)["count", "train"]

    assert (report.episodes, report.keyframes) == (2, (3, 5.0, 7))
    assert report.points_in_bounds == (1.0, 1.0)
    assert report.targets_in_bounds == 1.0
    assert report.boundaries == pytest.approx((2 + 4) / 10)
    assert 0 < report.points <= 100


NAN, NOWHERE = np.nan, 0
FAULTS = {
    "gripper_pose is not finite": ("gripper_pose", (2, 0), NAN),
    "camera_to_world is not finite": ("camera_to_world", (2, 1, 0, 3), NAN),
    "action_opening is not finite": ("action_opening", 2, np.inf),
    "the quaternion of action_pose has length 0": ("action_pose", (2, slice(3, 7)), 0.0),
    "the target [0.9, 0.0, 1.0] m is out of bounds": ("action_pose", (2, slice(0, 3)), (0.9, 0, 1)),
    "no camera sees a point of the workspace": ("depth", 2, NOWHERE),
    "0.78% of the pixels lie in bounds": ("depth", (2, slice(None), slice(1, None)), NOWHERE),
}


@pytest.mark.parametrize("message", FAULTS)
def test_the_first_bad_keyframe_is_named(tmp_path, message):
    record(tmp_path / "demos", {("count", "train"): [3, 5]})
    name, where, value = FAULTS[message]
    bad = changed(demonstration(index=1), name, where, value)
    write(bad, tmp_path / "demos" / "count" / "train-001.npz")

    with pytest.raises(StoreError, match=r"train-001.npz, keyframe 2: ") as refusal:
        build(tmp_path / "demos", tmp_path / "store", points=100, voxel=0.05)

    assert message in str(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["demos"]


def test_a_bad_demonstration_leaves_the_older_store_alone(tmp_path):
    first = store(tmp_path, {("count", "train"): [3]})
    bad = changed(demonstration(index=1), "gripper_pose", (0, 0), NAN)
    write(bad, tmp_path / "demos" / "count" / "train-001.npz")

    with pytest.raises(StoreError, match="keyframe 0"):
        build(tmp_path / "demos", tmp_path / "store", points=100, voxel=0.05)

    assert check(Store.open(tmp_path / "store")) == check(first)


def test_another_version_of_the_suite_is_refused(tmp_path):
    path = record(tmp_path / "demos", {("count", "train"): [3]})
    made = demonstration(keyframes=3)
    older = replace(made, spec=made.spec.model_copy(update={"version": 0}))
    write(older, path / "count" / "train-000.npz")

    with pytest.raises(
        StoreError, match=r"train-000.npz is of suite hide 0; this build knows hide 1"
    ):
        build(path, tmp_path / "store", points=100, voxel=0.05)


def test_missing_arrays_are_refused(tmp_path):
    path = record(tmp_path / "demos", {("count", "train"): [3]})
    file = path / "count" / "train-000.npz"
    with np.load(file) as held:
        rest = {name: held[name] for name in held.files if name not in ("stop", "rgb")}
    np.savez_compressed(file, **rest)

    with pytest.raises(StoreError, match=r"train-000.npz lacks arrays: rgb, stop"):
        build(path, tmp_path / "store", points=100, voxel=0.05)


@pytest.mark.parametrize("kept", [0, 100, 3000])
def test_a_truncated_demonstration_is_refused(tmp_path, kept):
    path = record(tmp_path / "demos", {("count", "train"): [3]})
    file = path / "count" / "train-000.npz"
    file.write_bytes(file.read_bytes()[:kept])

    with pytest.raises(StoreError, match=r"train-000.npz is damaged or no demonstration"):
        build(path, tmp_path / "store", points=100, voxel=0.05)


def test_a_demonstration_with_a_flipped_bit_is_refused(tmp_path):
    path = record(tmp_path / "demos", {("count", "train"): [3]})
    file = path / "count" / "train-000.npz"
    with zipfile.ZipFile(file) as held:
        info = held.getinfo("rgb.npy")
    content = bytearray(file.read_bytes())
    content[info.header_offset + 60 + info.compress_size // 2] ^= 1
    file.write_bytes(content)

    with pytest.raises(StoreError, match=r"train-000.npz is damaged"):
        build(path, tmp_path / "store", points=100, voxel=0.05)


def test_folders_that_are_something_else_are_refused(tmp_path):
    path = record(tmp_path / "demos", {("count", "train"): [3]})
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").touch()

    with pytest.raises(StoreError, match="thesis is no folder of demonstrations"):
        build(tmp_path / "thesis", tmp_path / "store", points=100, voxel=0.05)
    with pytest.raises(StoreError, match="thesis holds something else"):
        build(path, tmp_path / "thesis", points=100, voxel=0.05)
    with pytest.raises(StoreError, match=r"thesis\.tex holds something else"):
        build(path, tmp_path / "thesis" / "thesis.tex", points=100, voxel=0.05)
    with pytest.raises(StoreError, match="thesis is no keyframe store"):
        Store.open(tmp_path / "thesis")
    with pytest.raises(StoreError, match="has no demonstrations of test"):
        build(path, tmp_path / "store", points=100, voxel=0.05, splits=["test"])


@pytest.mark.parametrize("index", ['{"my": "site"}', "[]", "no JSON", None])
def test_a_folder_with_an_index_or_files_of_its_own_is_left_alone(tmp_path, index):
    path = store(tmp_path, {("count", "train"): [3]}).path
    (path / "count" / "notes.tex").touch()
    if index:
        (path / "index.json").write_text(index)
    before = sorted(path.rglob("*"))

    with pytest.raises(StoreError, match="holds something else"):
        build(tmp_path / "demos", path, points=200, voxel=0.05)

    assert sorted(path.rglob("*")) == before


def test_a_store_that_cannot_be_moved_in_leaves_the_older_one(tmp_path, monkeypatch):
    path = store(tmp_path, {("count", "train"): [3]}).path
    rename = Path.rename

    def fails(self, target):
        if self.name.endswith(".part"):
            raise OSError("no room")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails)
    with pytest.raises(OSError, match="no room"):
        build(tmp_path / "demos", path, points=200, voxel=0.05)
    monkeypatch.undo()

    check(Store.open(path))
    assert sorted(one.name for one in tmp_path.iterdir()) == ["demos", "store"]


def test_a_store_that_was_damaged_is_refused_and_built_again(tmp_path):
    path = store(tmp_path, {("count", "train"): [3]}).path
    points = path / "count" / "train" / "points.npy"
    whole = points.read_bytes()

    points.write_bytes(whole[:-6])
    with pytest.raises(StoreError, match=r"points.npy is damaged"):
        Store.open(path)
    points.unlink()
    with pytest.raises(StoreError, match=r"points.npy is missing"):
        Store.open(path)
    points.write_bytes(whole[:-6] + b"abcdef")
    with pytest.raises(StoreError, match="not what was built"):
        check(Store.open(path))
    points.unlink()
    check(build(tmp_path / "demos", path, points=100, voxel=0.05))


@pytest.mark.parametrize(
    ("field", "message"), [("version", "of suite hide 7"), ("format", "of format 7, not 1")]
)
def test_a_store_of_another_version_is_refused(tmp_path, field, message):
    path = store(tmp_path, {("count", "train"): [3]}).path
    index = json.loads((path / "index.json").read_text())
    (path / "index.json").write_text(json.dumps(index | {field: 7}))

    with pytest.raises(StoreError, match=message):
        Store.open(path)


def test_the_plate_is_where_it_was_seen(whole):
    points, colors, _ = whole.part("open", "train").clouds(slice(3, 4))

    np.testing.assert_allclose(points[:, 2], (plate_height(3) - 1.1) * 2, atol=2e-4)
    assert set(colors.ravel().tolist()) == {30}
