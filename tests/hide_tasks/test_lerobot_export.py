"""The export for LeRobot: a folder of the format's facts, whole or not there, that replays."""

import json
import shutil

import av
import numpy as np
import pyarrow.parquet as pq
import pytest

from hide_tasks import lerobot_format as form
from hide_tasks import suite
from hide_tasks.contract import JointPosition
from hide_tasks.demos import DemosError, Folder
from hide_tasks.dense import CHUNK, motion
from hide_tasks.episode import play
from hide_tasks.lerobot_export import Export
from hide_tasks.policies import Replay

TASK = "push_button_times"
ASKED = ([TASK], "val", 2)
SPECS = suite.episodes(TASK, "val", 2)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Export:
    export = Export.prepare(tmp_path_factory.mktemp("exports") / "set", *ASKED)
    for spec in export.left(SPECS):
        export.add(spec)
    export.finish(SPECS)
    return export


def frames(export):
    return pq.read_table(export.path / form.DATA.format(**form.place(0)))


def episodes(export):
    return pq.read_table(export.path / form.EPISODES.format(**form.place(0))).to_pylist()


def document(export, name):
    return json.loads((export.path / name).read_text())


def column(table, name):
    return np.array(table.column(name).to_pylist())


def test_a_finished_folder_holds_the_set_and_nothing_else(whole):
    assert {path.name for path in whole.path.iterdir()} == {"hide.json", "data", "meta", "videos"}
    assert whole.finished
    assert whole.left(SPECS) == whole.refused(SPECS) == []


def test_the_description_agrees_with_the_frames(whole):
    info, table = document(whole, form.INFO), frames(whole)

    assert (info["codebase_version"], info["fps"]) == ("v3.0", 20)
    assert info["total_episodes"] == len(SPECS) == len(episodes(whole))
    assert info["total_frames"] == table.num_rows
    columns = {k: v for k, v in info["features"].items() if v["dtype"] != "video"}
    assert set(columns) == set(table.column_names)
    for name, feature in columns.items():
        kind = table.schema.field(name).type
        if feature["shape"] != [1]:
            assert kind.list_size == feature["shape"][0] == len(feature["names"])
            kind = kind.value_type
        assert str(kind).replace("float", "float32") == feature["dtype"]


def test_episodes_follow_each_other_without_gaps(whole):
    table, end, ended = frames(whole), 0, 0.0

    for number, (episode, spec) in enumerate(zip(episodes(whole), SPECS, strict=True)):
        assert (episode["episode_index"], episode["name"]) == (number, spec.name)
        assert episode["dataset_from_index"] == end
        end += episode["length"]
        assert episode["dataset_to_index"] == end
        for key in form.VIDEOS.values():
            assert episode[f"videos/{key}/from_timestamp"] == ended
            assert episode[f"videos/{key}/to_timestamp"] == end / 20
        ended = end / 20
        rows = table.slice(episode["dataset_from_index"], episode["length"])
        assert set(column(rows, "episode_index")) == {number}
        assert column(rows, "frame_index").tolist() == list(range(episode["length"]))
        times = np.arange(episode["length"]) / 20
        np.testing.assert_allclose(column(rows, "timestamp"), times, atol=1e-6)
        assert episode["success"] and episode["exact"]
    assert column(table, "index").tolist() == list(range(end))


def test_frames_name_their_instruction_by_number(whole):
    tasks = pq.read_table(whole.path / form.TASKS)
    named = dict(zip(*(tasks.column(i).to_pylist() for i in (0, 1)), strict=True))

    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["__index_level_0__"]
    for episode in episodes(whole):
        row = frames(whole).slice(episode["dataset_from_index"], 1)
        assert episode["tasks"] == [named[int(column(row, "task_index")[0])]]


def test_the_statistics_are_those_of_all_frames(whole):
    stats, table = document(whole, form.STATS), frames(whole)

    assert set(stats) == {*form.VIDEOS.values(), *form.numeric()}
    for name in form.numeric():
        values = column(table, name).reshape(table.num_rows, -1).astype(float)
        for key, found in (
            ("min", values.min(0)),
            ("mean", values.mean(0)),
            ("std", values.std(0)),
        ):
            np.testing.assert_allclose(stats[name][key], found, atol=1e-6)
        np.testing.assert_allclose(stats[name]["q90"], np.quantile(values, 0.9, axis=0), atol=1e-6)
        assert stats[name]["count"] == [table.num_rows]


def test_what_the_videos_show_is_what_was_seen(whole):
    seen = []
    motion(SPECS[1], lambda world, _: seen.append(world.observe()))
    first = episodes(whole)[1]["dataset_from_index"]

    for camera, key in form.VIDEOS.items():
        with av.open(str(whole.path / form.VIDEO.format(video_key=key, **form.place(0)))) as file:
            shown = list(file.decode(video=0))
        assert len(shown) == frames(whole).num_rows
        assert [round(frame.time * 20, 6) for frame in shown] == list(range(len(shown)))
        images = np.array([frame.to_ndarray(format="rgb24") for frame in shown[first:]], float)
        drawn = np.array([observation.views[camera].rgb for observation in seen])
        assert np.abs(images - drawn).mean() < 3
        stats = document(whole, form.STATS)[key]
        mean = np.array([frame.to_ndarray(format="rgb24") for frame in shown]).mean((0, 1, 2)) / 255
        np.testing.assert_allclose(np.array(stats["mean"]).ravel(), mean, atol=0.01)


def test_each_action_leads_from_its_frame_to_the_next(whole):
    """An exported episode's actions, played again, pass through the exported states."""
    rows = frames(whole).slice(0, episodes(whole)[0]["length"])
    actions, states = column(rows, "action"), column(rows, "observation.state")
    passed = []

    class Follower(Replay):
        def act(self, observation):
            passed.append([*observation.joint_positions, observation.gripper_opening])
            return super().act(observation)

    one_by_one = [JointPosition(chunk=(tuple(row),)) for row in actions.tolist()]
    play(SPECS[0], Follower(one_by_one))

    np.testing.assert_array_equal(np.float32(passed), np.float32(states[: len(passed)]))


def test_the_exported_actions_reach_the_exported_verdict(whole):
    for spec, episode in zip(SPECS, episodes(whole), strict=True):
        rows = frames(whole).slice(episode["dataset_from_index"], episode["length"])
        actions = [tuple(row) for row in column(rows, "action").tolist()]
        chunks = [
            JointPosition(chunk=tuple(actions[i : i + CHUNK]))
            for i in range(0, len(actions), CHUNK)
        ]

        result, _ = play(spec, Replay(chunks))

        assert (result.success, result.exact) == (episode["success"], episode["exact"])
        assert result.final_state_hash == episode["final_state_hash"]
        assert result.scene_hash == episode["scene_hash"]


def test_the_hidden_state_and_the_stage_stand_beside_every_frame(whole):
    rows = frames(whole).slice(0, episodes(whole)[0]["length"])
    counts = [json.loads(text)["presses_done"] for text in rows.column("hidden_state").to_pylist()]

    assert counts[0] == 0
    assert counts == sorted(counts)
    assert counts[-1] == SPECS[0].variation["count"]
    stages = column(rows, "stage").tolist()
    assert stages == sorted(stages)
    assert rows.column("stage_name").to_pylist()[0] == "reach"


def test_a_policy_is_shown_nothing_hidden():
    for name in ("stage", "stage_name", "hidden_state", "ee_delta"):
        assert not name.startswith(("observation", "action"))


def test_an_interrupted_export_goes_on(whole, tmp_path):
    export = Export.prepare(tmp_path / "set", *ASKED)
    export.add(SPECS[0])
    half = tmp_path / "set" / ".parts" / f".{SPECS[1].name}"
    half.mkdir()
    (half / "frames.parquet").write_bytes(b"PAR1")
    export.finish(SPECS)  # does nothing yet

    again = Export.prepare(tmp_path / "set", *ASKED)

    assert not again.finished
    assert again.left(SPECS) == [SPECS[1]]
    again.add(SPECS[1])
    (tmp_path / "set" / ".whole").mkdir()  # as if it had been killed while it was put together
    again.finish(SPECS)
    assert frames(again).equals(frames(whole))
    assert document(again, form.STATS) == document(whole, form.STATS)
    assert names(again.path) == {"hide.json", "data", "meta", "videos"}


def test_an_export_killed_while_its_folders_were_moved_goes_on(whole, tmp_path):
    shutil.copytree(whole.path, tmp_path / "set")
    ready = tmp_path / "set" / ".ready"
    ready.mkdir()
    for name in ("videos", "meta"):
        (tmp_path / "set" / name).rename(ready / name)
    (tmp_path / "set" / ".parts").mkdir()
    for spec in SPECS:
        (tmp_path / "set" / ".parts" / spec.name).mkdir()

    again = Export.prepare(tmp_path / "set", *ASKED)
    again.finish(SPECS)

    assert again.finished
    assert names(again.path) == {"hide.json", "data", "meta", "videos"}


@pytest.mark.parametrize("name", ["data", "videos", "meta"])
def test_what_others_put_where_the_set_goes_is_left_alone(tmp_path, name):
    export = Export.prepare(tmp_path / "set", *ASKED)
    theirs = tmp_path / "set" / name / "thesis.tex"
    theirs.parent.mkdir()
    theirs.touch()

    with pytest.raises(DemosError, match=f"{name} is not of this export"):
        Export.prepare(tmp_path / "set", *ASKED)
    for spec in SPECS:
        export.add(spec)
    with pytest.raises(DemosError, match=f"{name} is not of this export"):
        export.finish(SPECS)
    assert theirs.is_file()

    theirs.parent.rename(tmp_path / "elsewhere")
    export.finish(SPECS)
    assert export.finished


def test_two_exports_do_not_write_into_one_folder_at_once(whole, tmp_path):
    with (
        Export.opened(tmp_path / "set", *ASKED),
        pytest.raises(DemosError, match="Another export is at work in"),
        Export.opened(tmp_path / "set", *ASKED),
    ):
        pass
    with Export.opened(tmp_path / "set", *ASKED) as export:
        assert not export.finished
    with Export.opened(whole.path, *ASKED), Export.opened(whole.path, *ASKED) as export:
        assert export.finished
    assert names(whole.path) == {"hide.json", "data", "meta", "videos"}


def test_an_export_killed_in_its_first_moment_begins_anew(tmp_path):
    (tmp_path / ".hide.json.part").write_text("{")

    Export.prepare(tmp_path, *ASKED)

    assert names(tmp_path) == {"hide.json"}


def test_what_a_kill_left_beside_a_finished_set_is_removed(whole, tmp_path):
    shutil.copytree(whole.path, tmp_path / "set")
    for name in (".ready", ".parts"):
        (tmp_path / "set" / name).mkdir()

    Export.prepare(tmp_path / "set", *ASKED).finish(SPECS)

    assert names(tmp_path / "set") == {"hide.json", "data", "meta", "videos"}


def test_a_finished_set_that_lacks_a_file_is_told(whole, tmp_path):
    shutil.copytree(whole.path, tmp_path / "set")
    video = next((tmp_path / "set" / "videos").rglob("*.mp4"))
    video.unlink()

    with pytest.raises(DemosError, match=rf"{video.name} is not the [0-9]+ bytes"):
        Export.prepare(tmp_path / "set", *ASKED)


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_an_episode_that_is_not_exact_is_named_and_left_out(tmp_path, monkeypatch):
    export = Export.prepare(tmp_path / "set", *ASKED)
    export.add(SPECS[0])
    monkeypatch.setattr("hide_tasks.bullet.planner.solutions", lambda _: [])

    with pytest.raises(DemosError, match=f"{SPECS[1].name}: .*no path"):
        export.add(SPECS[1])

    export.finish(SPECS)
    assert export.refused(SPECS) == [SPECS[1].name]
    assert [episode["name"] for episode in episodes(export)] == [SPECS[0].name]
    with pytest.raises(DemosError, match="no episode was exact"):
        only = Export.prepare(tmp_path / "none", [TASK], "val", 1)
        with pytest.raises(DemosError):
            only.add(SPECS[0])
        only.finish(SPECS[:1])


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (([TASK, "search_drawer"], "val", 2), f"an export with tasks {TASK}"),
        (([TASK], "train", 2), "an export with split val"),
        (([TASK], "val", None), "an export with episodes 2"),
    ],
)
def test_a_folder_of_another_request_is_refused(whole, asked, message):
    before = (whole.path / "hide.json").read_bytes()

    with pytest.raises(DemosError, match=message):
        Export.prepare(whole.path, *asked)

    assert (whole.path / "hide.json").read_bytes() == before


def test_a_folder_of_something_else_is_left_alone(whole, tmp_path):
    thesis = tmp_path / "thesis.tex"
    thesis.touch()
    Folder.prepare(tmp_path / "ours", [TASK], "val")

    with pytest.raises(DemosError, match="holds something else"):
        Export.prepare(tmp_path, *ASKED)
    with pytest.raises(DemosError, match="is no folder"):
        Export.prepare(thesis, *ASKED)
    with pytest.raises(DemosError, match="of our own format"):
        Export.prepare(tmp_path / "ours", *ASKED)
    with pytest.raises(DemosError, match=r"is no folder of demonstrations: no demos.json"):
        Folder.prepare(whole.path, [TASK], "val")
    assert {path.name for path in tmp_path.iterdir()} == {"thesis.tex", "ours"}


def test_a_missing_package_is_named_with_what_installs_it(tmp_path, monkeypatch):
    monkeypatch.setattr("hide_tasks.lerobot_export.PACKAGES", ("av", "no_such_package"))

    with pytest.raises(DemosError, match=r"needs no_such_package.*hide-seek\[lerobot\]"):
        Export.prepare(tmp_path / "set", *ASKED)

    assert not (tmp_path / "set").exists()


def test_files_that_have_grown_are_followed_by_others(tmp_path, monkeypatch):
    monkeypatch.setattr(form, "DATA_MB", 0)
    monkeypatch.setattr(form, "VIDEO_MB", 0)
    export = Export.prepare(tmp_path / "set", *ASKED)
    for spec in SPECS:
        export.add(spec)
    export.finish(SPECS)

    for number, episode in enumerate(episodes(export)):
        assert episode["data/file_index"] == number
        table = pq.read_table(export.path / form.DATA.format(**form.place(number)))
        assert table.num_rows == episode["length"]
        for key in form.VIDEOS.values():
            assert episode[f"videos/{key}/file_index"] == number
            assert episode[f"videos/{key}/from_timestamp"] == 0
