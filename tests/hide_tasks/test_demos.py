"""Demonstrations: what is kept of the expert's episode, and how files and folders are kept."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from hide_tasks import suite
from hide_tasks.demos import Demonstration, DemosError, Folder, evidence_of, read, record, write
from hide_tasks.episode import play
from hide_tasks.policies import Replay
from hide_tasks.script import points

SPEC = next(s for s in suite.episodes("push_button_times", "train") if s.variation["count"] == 2)


@pytest.fixture(scope="module")
def twice() -> Demonstration:
    return record(SPEC)


def same(first: Demonstration, second: Demonstration) -> bool:
    return all(
        np.array_equal(getattr(first, field.name), getattr(second, field.name))
        for field in fields(Demonstration)
    )


def test_a_demonstration_of_two_presses(twice):
    assert twice.stages == ("reach", "press", "press", "press", "press", "withdraw")[: len(twice)]
    assert twice.instruction.endswith("2 times")
    assert twice.result.exact
    assert twice.stop.tolist() == [False] * (len(twice) - 1) + [True]
    assert twice.boundary[-1]
    assert [state["presses_done"] for state in twice.hidden] == sorted(
        state["presses_done"] for state in twice.hidden
    )


def test_stages_end_where_the_next_keyframe_has_another_number(twice):
    following = [*twice.stage[1:].tolist(), None]

    ends = [a != b for a, b in zip(twice.stage.tolist(), following, strict=True)]
    assert twice.boundary.tolist() == ends
    assert twice.stage.tolist() == sorted(twice.stage.tolist())


def test_what_is_kept_is_what_was_seen_before_each_keyframe(twice):
    seen = points(SPEC)

    assert len(seen) == len(twice)
    for t, point in enumerate(seen):
        for camera, view in enumerate(point.observation.views.values()):
            np.testing.assert_array_equal(twice.rgb[t, camera], view.rgb)
            np.testing.assert_allclose(twice.metres(t)[camera], view.depth, atol=5.1e-5)
            np.testing.assert_array_equal(twice.camera_to_world[t, camera], view.camera_to_world)
            np.testing.assert_array_equal(twice.intrinsics[t, camera], view.intrinsics)
        np.testing.assert_array_equal(twice.gripper_pose[t], point.observation.gripper_pose)
        assert twice.gripper_opening[t] == point.observation.gripper_opening
        np.testing.assert_array_equal(twice.joint_positions[t], point.observation.joint_positions)
        assert (twice.stages[t], twice.hidden[t]) == (point.stage, point.hidden)
        np.testing.assert_array_equal(twice.action_pose[t], point.next.pose)
        assert twice.ignore_collisions[t] == point.next.ignore_collisions
        assert twice.action_opening[t] == point.next.opening


def test_replaying_a_demonstration_is_exact(twice):
    keyframes = [point.next for point in points(SPEC)]

    result, _ = play(SPEC, Replay(keyframes))

    assert result.exact
    assert result.final_state_hash == twice.result.final_state_hash


def test_a_demonstration_is_the_same_again(twice):
    assert same(record(SPEC), twice)


@pytest.mark.parametrize(
    ("totals", "evidence"),
    [
        ([0], [-1]),
        ([0, 0, 0], [-1, -1, -1]),
        ([0, 1, 1, 2, 2, 2], [-1, 0, 0, 2, 2, 2]),
        ([0, 0, 1, 0], [-1, -1, 1, 2]),
    ],
)
def test_evidence_is_the_last_keyframe_that_changed_the_hidden_state(totals, evidence):
    assert evidence_of([{"done": total} for total in totals]).tolist() == evidence


def test_an_expert_that_is_not_exact_is_refused(monkeypatch):
    monkeypatch.setattr("hide_tasks.script.steps", lambda _: iter(()))

    with pytest.raises(DemosError, match=f"{SPEC.name}: the expert was not exact"):
        record(SPEC)


def test_a_file_comes_back_whole(twice, tmp_path):
    write(twice, tmp_path / "a" / "one.npz")

    assert same(read(tmp_path / "a" / "one.npz"), twice)
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["one.npz"]
    assert (tmp_path / "a" / "one.npz").stat().st_size < 100_000 * len(twice)


def test_a_depth_that_is_too_far_or_missing_is_none(twice):
    depth = twice.depth.copy()
    depth[0, 0, 0] = 0

    metres = replace(twice, depth=depth).metres(0)

    assert np.isnan(metres[0, 0]).all()
    assert np.isfinite(metres[0, 1:]).all()


def test_files_that_are_not_whole_are_refused(twice, tmp_path):
    file = tmp_path / "one.npz"
    write(twice, file)
    content = file.read_bytes()

    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(DemosError, match=r"one.npz is damaged or no demonstration"):
        read(file)
    with open(file, "wb") as stream:
        np.save(stream, twice.stage)
    with pytest.raises(DemosError, match=r"one.npz is damaged or no demonstration"):
        read(file)
    write(replace(twice, depth=twice.depth[:-1]), file)
    with pytest.raises(DemosError, match=r"one.npz: depth is uint16 .* a row for every keyframe"):
        read(file)
    write(twice, file)
    with np.load(file) as held:
        rest = {name: held[name] for name in held.files if name != "stage"}
    np.savez(file, **rest)
    with pytest.raises(DemosError, match=r"one.npz lacks arrays: stage"):
        read(file)


def test_nothing_is_unpickled(twice, tmp_path):
    write(twice, tmp_path / "one.npz")
    with np.load(tmp_path / "one.npz") as file:
        held = dict(file)
    np.savez(tmp_path / "one.npz", **(held | {"stage": np.array([{}] * len(twice), object)}))

    with pytest.raises(DemosError, match="damaged"):
        read(tmp_path / "one.npz")


def test_a_folder_says_what_it_lacks(twice, tmp_path):
    specs = suite.episodes("push_button_times", "train", 5)
    folder = Folder.prepare(tmp_path / "demos", ["push_button_times"], "train")

    write(twice, folder.file(SPEC))

    again = Folder.open(tmp_path / "demos")
    assert again == folder
    assert again.tasks == ("push_button_times",)
    assert again.left([*specs, SPEC]) == [spec for spec in specs if spec != SPEC]
    assert again.files("push_button_times", "train") == [folder.file(SPEC)]
    assert again.files("push_button_times", "val") == []


def test_a_folder_grows_by_tasks_and_splits(tmp_path):
    Folder.prepare(tmp_path, ["push_button_times"], "train")

    Folder.prepare(tmp_path, ["search_drawer"], "val")

    folder = Folder.open(tmp_path)
    assert folder.tasks == ("push_button_times", "search_drawer")
    assert set(folder.splits) == {"train", "val"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 0}, "is of suite hide 0; this build knows hide 1"),
        ({"format": 9}, "is of format 9, not 1"),
        ({"sources": {"push_button_times": "0"}}, "delete .*push_button_times"),
        ({"sources": None}, "damaged"),
    ],
)
def test_the_folder_of_something_older_is_refused(tmp_path, change, message):
    folder = Folder.prepare(tmp_path, ["push_button_times"], "train")
    folder.file(SPEC).parent.mkdir()
    folder.file(SPEC).touch()
    index = tmp_path / "demos.json"
    index.write_text(json.dumps(json.loads(index.read_text()) | change))
    before = index.read_text()

    with pytest.raises(DemosError, match=message):
        Folder.prepare(tmp_path, ["push_button_times"], "train")

    assert index.read_text() == before


def test_deleted_demonstrations_of_older_sources_are_recorded_again(tmp_path):
    Folder.prepare(tmp_path, ["push_button_times"], "train")
    index = tmp_path / "demos.json"
    now = json.loads(index.read_text())
    index.write_text(json.dumps(now | {"sources": {"push_button_times": "0"}}))

    Folder.prepare(tmp_path, ["push_button_times"], "train")

    assert json.loads(index.read_text()) == now


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()

    with pytest.raises(DemosError, match=r"is no folder of demonstrations: no demos.json"):
        Folder.prepare(tmp_path, ["push_button_times"], "train")

    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("content", [b"\xff\xfe", b"null", b"[]", b'{"format": 3}'])
def test_a_folder_whose_index_is_damaged_is_refused(tmp_path, content):
    (tmp_path / "demos.json").write_bytes(content)

    with pytest.raises(DemosError, match=r"demos.json is damaged|of format 3"):
        Folder.open(tmp_path)


def test_a_file_in_place_of_a_folder_is_refused(tmp_path):
    file = tmp_path / "thesis.tex"
    file.touch()

    for refused in (lambda: Folder.open(file), lambda: Folder.prepare(file, [], "train")):
        with pytest.raises(DemosError, match=r"thesis.tex is no folder"):
            refused()


@pytest.mark.parametrize("document", ["null", '"demonstration"', "3", '{"format": 3}'])
def test_a_file_with_another_document_is_refused(twice, tmp_path, document):
    path = tmp_path / "demo.npz"
    write(twice, path)
    with np.load(path) as file:
        held = {name: file[name] for name in file.files}
    np.savez(path, **{**held, "document": np.array(document)})

    with pytest.raises(DemosError, match=r"demo.npz is (damaged|of another format)"):
        read(path)
