"""`make reproduce`: what it says it will do, and the whole chain, killed on its way."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from docs import make_results, own_processes, study_player
from docs.own_processes import Failed
from docs.reproduce import main, plan
from docs.study_chain import Step
from seek_model.study import FULL, TINY
from server import evaluations
from server.client import Happening
from tests.docs import studies
from tests.processes import wait_for
from tests.server import ledgers

ROOT = Path(__file__).parents[2]
Started = subprocess.Popen[bytes]


def said(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: object
) -> tuple[int, str, str]:
    """Exit status, output and errors of the command."""
    monkeypatch.setattr(sys, "argv", ["reproduce", *map(str, arguments)])
    status = main()
    return status, *capfd.readouterr()


def test_before_it_begins_it_says_what_it_will_do(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    status, output, _ = said(capfd, monkeypatch, "--plan", "--out", tmp_path)

    assert status == 0
    assert " 1 × first (first):" in output
    assert f"{len(FULL.measured)} × evaluation (seek-s0, seek-s1" in output
    assert not list(tmp_path.iterdir())


def test_what_is_there_is_not_planned_again(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    studies.trained(TINY, tmp_path)
    studies.measured(TINY, tmp_path / "data", without=("twin-s0",))

    status, output, _ = said(capfd, monkeypatch, "--tiny", "--plan", "--out", tmp_path)

    assert status == 0
    assert "second" not in output
    assert " 1 × evaluation (twin-s0):" in output
    assert " 1 × reference (amnesiac):" in output


def test_other_weights_than_those_that_were_played_are_played(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    studies.trained(TINY, tmp_path)
    studies.measured(TINY, tmp_path / "data")
    there = TINY.run("seek-s1")
    header = studies.header(there).replace(b'\\"seconds\\":1800.0', b'\\"seconds\\":1801.0')
    (tmp_path / "runs" / "seek-s1" / "checkpoint.safetensors").write_bytes(header)

    _, output, _ = said(capfd, monkeypatch, "--tiny", "--plan", "--out", tmp_path)

    assert " 1 × evaluation (seek-s1):" in output


def test_some_of_it_is_asked_for_by_name(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    studies.trained(FULL._replace(runs=FULL.runs[:1]), tmp_path)

    arguments = ("--plan", "--out", tmp_path, "--only", "seek-s2,twin-s2", "--train-only")
    _, output, _ = said(capfd, monkeypatch, *arguments)

    assert " 2 × second (seek-s2, twin-s2):" in output
    assert "evaluation" not in output

    _, output, _ = said(capfd, monkeypatch, "--plan", "--out", tmp_path, "--only", "amnesiac")

    assert output.splitlines()[1].startswith("   1 × reference (amnesiac):")
    assert len(output.splitlines()) == 3


@pytest.mark.parametrize(
    ("only", "message"),
    [
        ("seek-s9", "no run 'seek-s9'; there are first, seek-s0"),
        ("seek-s0", "seek-s0 goes on from first, which is not there: train it as well"),
    ],
)
def test_what_cannot_be_done_is_one_clear_line(
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    only: str,
    message: str,
) -> None:
    status, _, errors = said(capfd, monkeypatch, "--plan", "--out", tmp_path, "--only", only)

    assert status == 1
    assert errors.startswith("reproduce: ")
    assert message in errors
    assert errors.count("\n") == 1


def test_weights_of_another_run_are_refused(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    studies.trained(TINY, tmp_path)
    other = studies.header(TINY.run("seek-s1"))
    (tmp_path / "runs" / "seek-s0" / "checkpoint.safetensors").write_bytes(other)

    status, _, errors = said(capfd, monkeypatch, "--tiny", "--plan", "--out", tmp_path)

    assert status == 1
    assert "is of seek-small with seed 1; seek-s0 is seek-small with seed 0" in errors


def test_a_run_from_another_first_phase_is_refused(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """So is what was trained before the first phase was trained anew."""
    studies.trained(TINY, tmp_path)
    first = TINY.run("first")
    anew = studies.header(first).replace(b'\\"seconds\\":1800.0', b'\\"seconds\\":1801.0')
    (tmp_path / "runs" / "first" / "checkpoint-first.safetensors").write_bytes(anew)

    status, _, errors = said(capfd, monkeypatch, "--tiny", "--plan", "--out", tmp_path)

    assert status == 1
    assert f"{tmp_path / 'runs' / 'seek-s0'} to train it again" in errors


def test_two_of_them_do_not_work_in_one_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(own_processes, "PATIENCE", 0.1)
    own_processes.Folder(tmp_path)

    with pytest.raises(Failed, match="is in use; one program at a time works in it"):
        own_processes.Folder(tmp_path)


def test_what_runs_side_by_side_ends_when_it_is_told_to(tmp_path: Path) -> None:
    folder = own_processes.Folder(tmp_path / "study")
    arguments = ("serve", "--port", "0", "--no-references", "--data")
    with ThreadPoolExecutor(2) as pool:
        begun = [pool.submit(folder.hide, *arguments, tmp_path / name) for name in "ab"]
        wait_for(lambda: len(folder.running) == 2, "two servers", 60)
        folder.stop()
        late = pool.submit(folder.hide, *arguments, tmp_path / "late")

        for one in (*begun, late):
            assert isinstance(one.exception(timeout=60), Failed | type(None))
    assert not folder.running


@pytest.mark.parametrize("number", ["0", "-1", "some"])
def test_a_number_at_once_that_cannot_be_is_refused(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, number: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["reproduce", "--plan", "--at-once", number])

    with pytest.raises(SystemExit) as ended:
        main()

    assert ended.value.code == 2
    assert "--at-once" in capfd.readouterr().err


def test_the_expected_time_is_what_was_measured() -> None:
    def nothing() -> None: ...

    steps = [Step("second", f"seek-s{seed}", nothing) for seed in range(3)]

    lines = plan(steps, {"second": 1800.0}, Path("build"))

    assert lines[1] == "   3 × second (seek-s0, seek-s1, seek-s2): 1:30:00 expected"
    assert lines[-1] == "  together 1:30:00 expected"
    assert plan(steps, {}, Path("build"))[-1] == "  together 0:00:00 expected and what is unknown"


def test_of_an_evaluation_it_says_now_and_then_how_far_it_is(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of what the server tells its followers."""
    database = ledgers.opened(tmp_path, "sqlite")
    with database.writing() as session:
        id = ledgers.created(session, "expert", tasks=["search_drawer"], episodes=2).id
    with database.reading() as session:
        told = evaluations.get(session, id).model_dump(mode="json", include={"progress"})
    monkeypatch.setattr(study_player, "EVERY", 0.0)

    study_player.telling("seek-s0")(Happening("progress", None, told))

    assert "seek-s0: 0 of 2 episodes" in capfd.readouterr().out


# --- the whole chain ---


def begun(out: Path) -> Started:
    command = [sys.executable, "-m", "docs.reproduce", "--tiny", "--out", out]
    with out.with_suffix(".log").open("ab") as log:
        return subprocess.Popen(list(map(str, command)), cwd=ROOT, stdout=log, stderr=log)


def killed_when(out: Path, what: str) -> None:
    """Begins, and is killed as soon as it says something."""
    process, log = begun(out), out.with_suffix(".log")
    there = log.read_text().count(what)

    def comes() -> bool:
        assert process.poll() is None, log.read_text()
        return log.read_text().count(what) > there

    wait_for(comes, what, 600)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere what it started outlives it")
def test_the_whole_chain_goes_on_wherever_it_is_killed(tmp_path: Path) -> None:
    out = tmp_path / "study"
    killed_when(out, "second: seek-s0")
    first = out / "runs" / "first" / "checkpoint-first.safetensors"
    trained = first.stat().st_mtime_ns
    killed_when(out, "evaluation: twin-s0")

    status = begun(out).wait()

    log = out.with_suffix(".log").read_text()
    assert status == 0, log
    assert first.stat().st_mtime_ns == trained
    assert log.count("reference: expert\n") == 1  # played before the second death
    found = json.loads((out / "tables" / "results.json").read_text())
    assert list(found["runs"]) == [run.name for run in TINY.measured]
    assert list(found["references"]) == ["expert", "amnesiac"]
    assert found["success"]["rates"]["seek"]["overall"]["episodes"] == 3
    assert found["success"]["clocked"]["differences"].keys() == {"twin-clock"}
    page = (out / "tables" / "results.md").read_text()
    assert "Missing" not in page
    assert {path.stem for path in (out / "tables" / "curves").glob("*")} == {
        run.name for run in TINY.runs
    }
    assert (out / "exports" / "leaderboard.csv").stat().st_size > 0
    assert "SEEK: success" in log
    assert make_results.spent(out).keys() >= {"first", "second", "evaluation", "reference"}


def test_first_weights_from_elsewhere_are_gone_on_from(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere.safetensors"
    arguments = ("--plan", "--out", tmp_path / "study", "--first", elsewhere)
    status, _, errors = said(capfd, monkeypatch, *arguments)
    assert status == 1
    assert f"--first {elsewhere}: no such file" in errors

    elsewhere.write_bytes(studies.header(FULL.run("first")))
    status, output, _ = said(capfd, monkeypatch, *arguments)

    assert status == 0
    assert "first (first)" not in output
    assert f"{len(FULL.measured)} × second" in output
