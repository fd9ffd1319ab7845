"""Evaluations with real simulators, policies and signals."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hide_tasks.contract import EpisodeSpec
from seek_model import trained
from tests.processes import gone, wait_for
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.workers import checkpoint_files
from workers.evaluation import Evaluation, Watcher, evaluate, missing
from workers.policies import hash_of_file
from workers.run_folder import DECISIONS, RESULTS, FolderError, RunFolder
from workers.sandbox.choice import best
from workers.simulator_process import descendants

ROOT = Path(__file__).parents[2]
TASKS = ("push_button_times", "reopen_drawer")
POLICIES = "python:tests.workers.some_policies"
VOLATILE = ("created", "machine", "timing", "recording_hashes")  # two runs need not share these


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "server.cli", "eval", *map(str, arguments)]


def comparable(folder: Path) -> dict[str, Any]:
    """results.json without what tells of the time and the machine."""

    def stable(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: stable(part) for key, part in value.items() if key not in VOLATILE}
        return [stable(part) for part in value] if isinstance(value, list) else value

    return stable(json.loads((folder / RESULTS).read_text()))


def episodes_in(folder: Path) -> int:
    try:
        return len(json.loads((folder / RESULTS).read_text())["episodes"])
    except FileNotFoundError:
        return 0


@pytest.fixture(scope="module")
def expert_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two tasks, two episodes each, two workers, recorded."""
    folder = tmp_path_factory.mktemp("expert") / "run"
    evaluate(Evaluation("expert", TASKS, episodes=2), folder, workers=2)
    return folder


def test_an_evaluation_fills_its_folder(expert_run: Path) -> None:
    results = json.loads((expert_run / RESULTS).read_text())
    decisions = [json.loads(line) for line in (expert_run / DECISIONS).read_text().splitlines()]

    played = [(episode["task"], episode["index"]) for episode in results["episodes"]]
    assert played == [(task, index) for task in TASKS for index in range(2)]
    for episode in results["episodes"]:
        mine = [
            d for d in decisions if (d["task"], d["index"]) == (episode["task"], episode["index"])
        ]
        assert [d["decision"] for d in mine] == list(range(episode["decisions"]))
        assert (expert_run / episode["recording"]).stat().st_size > 10_000
        assert episode["success"] and episode["exact"] and episode["failure"] is None
    assert not list(expert_run.rglob("*.part"))


def test_a_replay_ends_in_the_same_states(expert_run: Path, tmp_path: Path) -> None:
    """Also: neither the number of workers nor a recording changes an episode."""
    replay = Evaluation(f"replay:{expert_run}", TASKS, episodes=2, recordings=False)

    results = evaluate(replay, tmp_path / "run", workers=1)

    expert = comparable(expert_run)["episodes"]
    assert [one.final_state_hash for one in results.episodes] == [
        one["final_state_hash"] for one in expert
    ]
    assert all(one.exact and one.recording is None for one in results.episodes)


def test_a_finished_run_is_not_played_again(expert_run: Path) -> None:
    before = (expert_run / RESULTS).read_bytes()

    class Counts(Watcher):
        def begun(self, _folder: RunFolder, left: int) -> None:
            self.left = left

    watcher = Counts()
    evaluate(Evaluation("expert", TASKS, episodes=2), expert_run, watcher=watcher)

    assert watcher.left == 0
    assert (expert_run / RESULTS).read_bytes() == before


def test_a_smaller_request_is_content_with_its_episodes(expert_run: Path) -> None:
    smaller = Evaluation("expert", TASKS[:1], episodes=1)

    assert missing(smaller, evaluate(smaller, expert_run)) == []


def test_a_named_episode_is_played_alone_and_ends_as_among_others(
    expert_run: Path, tmp_path: Path
) -> None:
    alone = Evaluation("expert", TASKS[:1], indices=(1,), recordings=False)

    results = evaluate(alone, tmp_path / "run")

    assert [(one.task, one.index) for one in results.episodes] == [(TASKS[0], 1)]
    assert missing(alone, results) == [] and results.complete
    [among] = [one for one in comparable(expert_run)["episodes"] if one["index"] == 1][:1]
    assert results.episodes[0].final_state_hash == among["final_state_hash"]
    with pytest.raises(FolderError, match="episodes 1 of each task, not episodes 0 of each task"):
        evaluate(replace(alone, indices=(0,)), tmp_path / "run")


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_a_killed_run_resumes_to_the_same_results(expert_run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    arguments = ("expert", "--tasks", ",".join(TASKS), "--episodes", 2, "--out", folder)
    first = subprocess.Popen(command(*arguments, "--workers", 1), cwd=ROOT)
    wait_for(lambda: episodes_in(folder) >= 1, "the first episode")
    processes = descendants(first.pid)

    first.kill()
    first.wait()

    wait_for(lambda: gone(processes), "the end of all workers", 10)
    assert 1 <= episodes_in(folder) < 4
    subprocess.run(command(*arguments), cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    assert comparable(folder) == comparable(expert_run)
    assert (folder / DECISIONS).read_text() == (expert_run / DECISIONS).read_text()
    assert not list(folder.rglob("*.part"))


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_ctrl_c_stops_everything_and_tells_how_to_go_on(tmp_path: Path) -> None:
    arguments = command(f"{POLICIES}:Hangs", "--out", tmp_path / "run")
    running = subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    log = tmp_path / "run" / "policy.log"
    wait_for(lambda: log.exists() and "told" in log.read_text(), "an episode under way")
    processes = descendants(running.pid)

    os.killpg(running.pid, signal.SIGINT)  # as a terminal does it
    output, errors = running.communicate(timeout=60)

    assert (running.returncode, output) == (130, "")
    assert errors.splitlines()[-1].endswith(f"--out {tmp_path / 'run'} resumes.")
    assert "Traceback" not in errors
    wait_for(lambda: gone(processes), "the end of all workers", 10)


def test_an_episode_that_cannot_be_played_is_missing_not_scored(tmp_path: Path) -> None:
    folder, lost = tmp_path / "run", []

    class Notes(Watcher):
        def begun(self, folder: RunFolder, _left: int) -> None:
            (folder.recordings / f"{TASKS[0]}-test-000.rrd").mkdir()  # where a file must go

        def lost(self, episode: EpisodeSpec, reason: str, final: bool) -> None:
            lost.append((episode.index, final, "IsADirectoryError" in reason))

    evaluation = Evaluation(f"{POLICIES}:Stops", TASKS[:1], episodes=2)
    results = evaluate(evaluation, folder, workers=1, watcher=Notes())

    assert [episode.index for episode in results.episodes] == [1]
    assert missing(evaluation, results) == [f"{TASKS[0]}-test-000"]
    assert lost == [(0, False, True), (0, False, True), (0, True, True)]


def test_the_command_prints_what_the_folder_holds(expert_run: Path) -> None:
    arguments = ("expert", "--tasks", ",".join(TASKS), "--episodes", "2", "--out", expert_run)
    finished = subprocess.run(
        command(*arguments, "--json"), cwd=ROOT, check=True, capture_output=True, text=True
    )

    assert json.loads(finished.stdout) == json.loads((expert_run / RESULTS).read_text())
    assert finished.stderr == f"{expert_run}: 0 episodes to play, 4 there\n"


def test_a_policy_that_fails_is_no_failure_of_the_command(tmp_path: Path) -> None:
    arguments = ("noop", "--tasks", TASKS[0], "--episodes", 1, "--no-recordings")
    finished = subprocess.run(
        command(*arguments, "--out", tmp_path / "run"), cwd=ROOT, capture_output=True, text=True
    )

    assert finished.returncode == 0
    assert "undercount 1" in finished.stdout
    assert "0 % [0, 80]" in " ".join(finished.stdout.split())


def test_parity_has_its_own_budget() -> None:
    evaluation = Evaluation("noop", ("search_drawer",))

    assert evaluation.results.budgets == {"search_drawer": 35}
    assert replace(evaluation, rules="parity").results.budgets == {"search_drawer": 25}


def test_a_checkpoint_is_evaluated_and_a_bad_one_is_refused(tmp_path: Path) -> None:
    checkpoint = tmp_path / "seek.safetensors"
    tiny_checkpoint(checkpoint)
    asked = ("--tasks", TASKS[0], "--episodes", 1, "--no-recordings", "--out", tmp_path / "run")
    arguments = command(checkpoint, *asked)

    finished = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True)
    checkpoint_files.written(checkpoint)
    again = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True)

    assert finished.returncode == 0, finished.stderr
    [episode] = json.loads((tmp_path / "run" / RESULTS).read_text())["episodes"]
    assert episode["failure"] != "policy_error", episode["detail"]
    assert json.loads((tmp_path / "run" / RESULTS).read_text())["sandboxes"] == [best()]
    assert ("The policy plays in a sandbox" in finished.stderr) == (best() != "none")
    assert (again.returncode, again.stderr.count("\n")) == (2, 1)
    assert again.stderr.startswith("hide: seek.safetensors cannot be loaded: tensor ")


def test_a_trained_checkpoint_is_evaluated_by_its_name_in_the_sandbox(tmp_path: Path) -> None:
    (folder := tmp_path / "trained").mkdir()
    file = tiny_checkpoint(trained.path_of("seek-small", folder))
    wanted = Evaluation("seek-small", TASKS[:1], episodes=1, recordings=False, trained=folder)

    results = evaluate(wanted, tmp_path / "run", workers=1)

    [episode] = results.episodes
    assert episode.failure != "policy_error", episode.detail
    assert (results.policy, results.sandboxes) == ("seek-small", [best()])
    assert results.checkpoint == hash_of_file(file)
