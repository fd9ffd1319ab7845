import json
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hide_tasks.contract import DecisionRecord, EpisodeResult, MotionOutcome, Stop
from workers.results import Results
from workers.run_folder import (
    DECISIONS,
    RESULTS,
    FolderError,
    RunFolder,
    read,
    read_actions,
)

TASKS = ["push_button_times", "search_drawer"]


def wanted(**changes: object) -> Results:
    fields = {
        "policy": "expert",
        "suite": "hide",
        "version": 1,
        "split": "test",
        "rules": "hide",
        "tasks": TASKS,
        "budgets": {"push_button_times": 25, "search_drawer": 35},
        "planned": dict.fromkeys(TASKS, 3),
    }
    return Results(**{**fields, **changes})


def result(task: str, index: int) -> EpisodeResult:
    return EpisodeResult(
        task=task,
        split="test",
        index=index,
        variation={},
        instruction="wait",
        success=True,
        exact=True,
        failure=None,
        decisions=2,
        stage="done",
        scene_hash="a",
        final_state_hash="b",
    )


def decisions(count: int = 2) -> list[DecisionRecord]:
    return [
        DecisionRecord(
            decision=number,
            time=1.0,
            action=Stop(),
            outcome=MotionOutcome.NONE,
            stage="wait",
            hidden={},
            checks={},
            success=True,
        )
        for number in range(count)
    ]


def contents(path: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()
    }


def play(path: Path, *episodes: tuple[str, int], **changes: object) -> Results:
    with RunFolder.opened(path, wanted(**changes)) as folder:
        for task, index in episodes:
            folder.commit(result(task, index), decisions())
        return folder.results


def test_a_new_folder_says_what_was_asked_for(tmp_path: Path) -> None:
    play(tmp_path / "runs" / "a")

    written = json.loads((tmp_path / "runs" / "a" / RESULTS).read_text())
    assert (written["policy"], written["tasks"], written["episodes"]) == ("expert", TASKS, [])
    assert written["machine"]["numpy"]
    assert written["created"].endswith("+00:00")


@settings(max_examples=20)
@given(st.permutations([(task, index) for task in TASKS for index in range(3)]))
def test_the_order_of_finishing_leaves_no_trace(
    tmp_path_factory, order: list[tuple[str, int]]
) -> None:
    path = tmp_path_factory.mktemp("run")
    with RunFolder.opened(path, wanted()) as folder:
        for task, index in order:
            folder.commit(result(task, index), decisions())
        folder.tidy()

    keys = [(episode.task, episode.index) for episode in read(path).episodes]
    lines = [json.loads(line) for line in (path / DECISIONS).read_text().splitlines()]
    assert keys == sorted(order)
    assert [(line["task"], line["index"], line["decision"]) for line in lines] == [
        (*key, decision) for key in keys for decision in range(2)
    ]


def test_a_folder_is_resumed_with_its_episodes(tmp_path: Path) -> None:
    first = play(tmp_path, (TASKS[0], 0))

    second = play(tmp_path, (TASKS[1], 2))

    assert [(one.task, one.index) for one in second.episodes] == [(TASKS[0], 0), (TASKS[1], 2)]
    assert second.created == first.created


def test_what_an_unfinished_episode_left_is_cleared(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0))
    whole = (tmp_path / DECISIONS).read_text()
    unfinished = whole.splitlines()[0].replace('"index": 0', '"index": 1')
    (tmp_path / DECISIONS).write_text(f"{whole}{unfinished}\n{unfinished[:40]}")
    (tmp_path / "recordings" / "x.rrd.1234.part").touch()
    (tmp_path / "recordings" / "y.rrd").touch()

    play(tmp_path)

    assert (tmp_path / DECISIONS).read_text() == whole
    assert [file.name for file in (tmp_path / "recordings").iterdir()] == ["y.rrd"]


def test_decisions_are_on_disk_before_the_result_is(tmp_path: Path) -> None:
    """The disk is full when results.json is replaced."""
    with RunFolder.opened(tmp_path, wanted()) as folder:
        (tmp_path / f".{RESULTS}.part").mkdir()  # opening it for writing fails

        with pytest.raises(OSError):
            folder.commit(result(TASKS[0], 0), decisions())

    assert len((tmp_path / DECISIONS).read_text().splitlines()) == 2
    assert read(tmp_path).episodes == []


def test_tasks_and_episodes_may_grow(tmp_path: Path) -> None:
    few = {"tasks": [TASKS[1]], "planned": {TASKS[1]: 5}, "budgets": {TASKS[1]: 35}}
    play(tmp_path, (TASKS[1], 4), **few)

    grown = play(tmp_path)

    assert grown.tasks == TASKS
    assert grown.planned == {TASKS[0]: 3, TASKS[1]: 5}
    assert list(grown.budgets) == TASKS


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": "noop"}, "policy expert, not noop"),
        ({"split": "val"}, "split test, not val"),
        ({"rules": "parity"}, "rules hide, not parity"),
        ({"version": 2}, "version 1, not 2"),
        ({"suite": "rlbench"}, "suite hide, not rlbench"),
        ({"budgets": {TASKS[0]: 25, TASKS[1]: 99}}, "a budget of 35 for search_drawer, not 99"),
        ({"indices": [3, 7]}, "the first episodes of each task, not episodes 3, 7 of each task"),
        ({"sources": {TASKS[0]: "newer"}}, "another version of push_button_times's sources"),
    ],
)
def test_another_run_is_refused_and_nothing_touched(
    tmp_path: Path, changes: dict, message: str
) -> None:
    play(tmp_path, (TASKS[0], 0), sources={TASKS[0]: "older"})
    (tmp_path / "recordings" / "x.rrd.part").touch()
    before = contents(tmp_path)

    with pytest.raises(FolderError, match=message):
        play(tmp_path, **changes)

    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("thesis.tex", "", "holds something else"),
        (DECISIONS, "", "holds something else"),
        (RESULTS, "{}", "is not a run's: policy Field required"),
        (RESULTS, "not json", "is not a run's"),
    ],
)
def test_something_else_is_refused_and_nothing_touched(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)

    with pytest.raises(FolderError, match=message):
        play(tmp_path)

    assert contents(tmp_path) == {name: content.encode()}


def test_recordings_that_are_not_ours_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "interview.part").write_text("hello")

    with pytest.raises(FolderError, match="holds something else"):
        play(tmp_path)

    assert contents(tmp_path) == {"recordings/interview.part": b"hello"}


def test_a_run_that_was_killed_while_it_began_begins_again(tmp_path: Path) -> None:
    play(tmp_path)
    (tmp_path / RESULTS).unlink()
    (tmp_path / DECISIONS).unlink()
    (tmp_path / f".{RESULTS}.part").touch()

    assert play(tmp_path, (TASKS[0], 0)).finished == {(TASKS[0], 0)}


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()

    with pytest.raises(FolderError, match="is a file"):
        play(tmp_path / "file")
    with pytest.raises(FolderError, match="cannot be written: Not a directory"):
        play(tmp_path / "file" / "run")


def test_a_damaged_line_is_not_passed_over(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0))
    (tmp_path / DECISIONS).write_text("{]\n")

    with pytest.raises(FolderError, match="damaged"):
        play(tmp_path)


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    program = "import sys; from tests.workers.test_run_folder import *; play(Path(sys.argv[1]))"
    command = [sys.executable, "-c", program, tmp_path]

    with RunFolder.opened(tmp_path, wanted()):
        second = subprocess.run(command, capture_output=True, text=True)

    assert "is in use by another run" in second.stderr
    assert subprocess.run(command).returncode == 0


def test_the_actions_of_finished_episodes_can_be_read(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0), (TASKS[1], 1))
    lines = (tmp_path / DECISIONS).read_text()
    (tmp_path / DECISIONS).write_text(
        lines + lines.splitlines()[0].replace('"index": 0', '"index": 2') + "\n{"
    )

    assert read_actions(tmp_path) == {(TASKS[0], 0): [Stop()] * 2, (TASKS[1], 1): [Stop()] * 2}


def test_another_file_under_the_same_name_is_another_run(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0), policy="seek.safetensors", checkpoint="a" * 64)

    with pytest.raises(FolderError, match=f"a run with checkpoint {'a' * 64}, not {'b' * 64}"):
        play(tmp_path, policy="seek.safetensors", checkpoint="b" * 64)


def test_the_same_file_under_another_name_goes_on(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0), policy="seek.safetensors", checkpoint="a" * 64)

    play(tmp_path, (TASKS[0], 1), policy="moved/seek.safetensors", checkpoint="a" * 64)

    assert len(read(tmp_path).episodes) == 2


def test_a_checkpoint_is_no_other_policy(tmp_path: Path) -> None:
    play(tmp_path, (TASKS[0], 0))

    with pytest.raises(FolderError, match=r"policy expert, not seek\.safetensors"):
        play(tmp_path, policy="seek.safetensors", checkpoint="a" * 64)
