"""Which files a policy sees, judged by the list that both sandboxes are given."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from workers.policies import Hosted, Surroundings
from workers.preflight import preflight
from workers.sandbox import view
from workers.sandbox.bubblewrap import program
from workers.sandbox.view import SCRATCH, View, code, of_checkpoint, of_class


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a researcher's, in which the commands are given."""
    files = (
        "mine.py weights.npz lib/part.py .env .git/config data/ledger.sqlite3 runs/a/results.json "
        "old/results.json old/decisions.jsonl deep/kept.txt deep/data/secret.txt"
    )
    for name in files.split():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def shown(seen: View, folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in seen.shown(folder)]


def test_a_class_sees_its_folder_without_what_tells_of_episodes(project: Path) -> None:
    seen = of_class("mine.py:Mine", [project / "deep" / "data"])

    assert project in seen.parts
    assert shown(seen, project) == ["deep/kept.txt", "lib", "mine.py", "weights.npz"]
    covered = {str(path.relative_to(project)) for path in seen.covered(project)}
    assert covered == {".env", ".git", "data", "runs", "old", "deep/data"}


def test_what_is_covered_lies_in_nothing_that_is(project: Path) -> None:
    """A mount on `runs/a` would be buried by the one on `runs`."""
    seen = of_class("mine.py:Mine", [project / "runs" / "a", project / "data"])

    covered = sorted(str(path.relative_to(project)) for path in seen.covered(project))
    assert covered == [".env", ".git", "data", "old", "runs"]


def test_a_checkpoint_sees_nothing_but_itself_and_code(project: Path) -> None:
    seen = of_checkpoint(project / "seek.safetensors")

    assert project not in seen.parts
    assert seen.whole[-1] == project / "seek.safetensors"
    own = set(code().values())
    assert {path.name for path in own} >= {"hide_tasks", "seek_model", "workers"}
    assert own <= set(seen.whole)
    assert not any(path in one.parents for one in own for path in seen.parts)


def test_a_home_is_never_shown_but_a_class_in_it_is(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(project))

    seen = of_class("mine.py:Mine")

    assert project not in seen.parts
    assert project / "mine.py" in seen.whole


def test_a_folder_below_what_is_hidden_is_not_shown(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(view.HIDDEN, str(project))

    assert not any(project == part or project in part.parents for part in of_class("m:M").parts)


def test_what_is_on_the_search_path_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])

    assert tmp_path in of_checkpoint(tmp_path / "x").parts
    assert tmp_path in of_checkpoint(tmp_path / "x").search


def test_the_machines_scratch_is_never_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SCRATCH)

    assert SCRATCH not in of_class("some_policy:Some").parts


@pytest.mark.skipif(not program(), reason="no bubblewrap")
def test_a_class_that_starts_in_the_machines_scratch_may_write_to_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with TemporaryDirectory(dir=SCRATCH) as folder:
        file = Path(folder) / "writes.py"
        file.write_text(
            "import tempfile\n\n\nclass Writes:\n    def reset(self, *_):\n"
            "        tempfile.TemporaryFile().close()\n\n    def act(self, _):\n"
            '        return {"kind": "stop"}\n'
        )
        monkeypatch.chdir(SCRATCH)

        checks = preflight(Hosted(f"{file}:Writes", Surroundings(sandbox="bubblewrap")).make(), 60)

    assert {one.outcome for one in checks} <= {"passed", "noted"}
