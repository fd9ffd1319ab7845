"""The folder of a run of `hide eval`, honest and not."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from server.verification.findings import Findings
from server.verification.runs import verify_run
from tests.server import played
from workers.evaluation import Evaluation
from workers.run_folder import FolderError, RunFolder
from workers.simulator import recording_name

NAME = f"{played.TASK}-test-000"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run with one episode that the expert played."""
    told, recording = played._played("expert", 0)
    wanted = Evaluation("expert@1", (played.TASK,), episodes=1).results
    name = recording_name(played.spec())
    with RunFolder.opened(tmp_path / "run", wanted) as folder:
        (folder.recordings / name).write_bytes(recording.read_bytes())
        result = told.result.model_copy(update={"recording": f"recordings/{name}"})
        folder.commit(result, told.decisions)
    return tmp_path / "run"


def edit(run: Path, change: Callable[[dict[str, Any]], None]) -> None:
    document = json.loads((run / "results.json").read_text())
    change(document)
    (run / "results.json").write_text(json.dumps(document))


def told(found: Findings) -> set[str]:
    return {one.what for one in found.mismatches}


def test_an_honest_run_agrees(run: Path) -> None:
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}

    found = verify_run(run)

    assert found.mismatches == []
    assert (found.episodes, found.files, found.simulated, found.bitwise) == (1, 1, 1, 1)
    assert [score.success for score in found.scores.values()] == [1]
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before


def test_a_forged_verdict(run: Path) -> None:
    def fail(document: dict[str, Any]) -> None:
        document["episodes"][0] |= {"success": False, "exact": False, "failure": "undercount"}

    edit(run, fail)

    found = verify_run(run, sample=0)

    recorded = {"success in the recording", "exact in the recording", "failure in the recording"}
    assert told(found) == {"success", "exact", "failure", "digest", *recorded}
    assert {one.subject for one in found.mismatches} == {NAME}


def test_an_edited_action_log(run: Path) -> None:
    log = run / "decisions.jsonl"
    first, *others = log.read_text().splitlines(keepends=True)
    document = json.loads(first)
    document["action"]["position"][0] += 0.01
    log.write_text(json.dumps(document) + "\n" + "".join(others))

    assert told(verify_run(run, sample=0)) == {"digest"}


def test_an_action_log_that_was_cut_or_is_no_log(run: Path) -> None:
    log = run / "decisions.jsonl"
    lines = log.read_text().splitlines(keepends=True)

    log.write_text("".join(lines[:-1]))
    cut = told(verify_run(run, sample=0))
    log.write_text("".join([*lines, "nonsense\n"]))
    more = told(verify_run(run, sample=0))

    assert {"decisions", "digest"} <= cut
    assert more == {"a decision"}


def test_an_edited_recording_and_one_that_is_gone(run: Path) -> None:
    [recording] = (run / "recordings").glob("*.rrd")
    content = recording.read_bytes()

    recording.write_bytes(content[:-1] + b"?")
    edited = told(verify_run(run, sample=0))
    recording.unlink()
    gone = told(verify_run(run, sample=0))

    assert (edited, gone) == ({"sha256"}, {"recording"})


def test_a_recording_elsewhere_is_not_looked_at(run: Path) -> None:
    def point(document: dict[str, Any]) -> None:
        document["episodes"][0]["recording"] = "../../etc/passwd"

    edit(run, point)

    assert "recording" in told(verify_run(run, sample=0))


def test_an_episode_twice(run: Path) -> None:
    edit(run, lambda document: document["episodes"].append(document["episodes"][0]))

    assert "episodes" in told(verify_run(run, sample=0))


def test_a_run_of_an_older_version_has_no_digests(run: Path) -> None:
    def forget(document: dict[str, Any]) -> None:
        del document["digests"], document["recording_hashes"]

    edit(run, forget)

    assert verify_run(run, sample=0).mismatches == []


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    with pytest.raises(FolderError, match="no run's folder"):
        verify_run(tmp_path)
