"""The checkpoints that come with the code: those that are here are in order, and any may lack."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest

from hide_tasks import SUITES
from seek_model import policy, trained
from seek_model.checkpoint_header import BadCheckpoint
from tests.seek_model.checkpoints import tiny_checkpoint

ROOT = Path(__file__).parents[2]
HERE = [name for name in trained.NAMES if trained.path_of(name).exists()]


def test_only_what_is_there_is_named(tmp_path: Path) -> None:
    assert trained.there(tmp_path / "nowhere") == trained.there(tmp_path) == []
    tiny_checkpoint(trained.path_of("stage-one", tmp_path))
    tiny_checkpoint(trained.path_of("sam2act-small", tmp_path))
    assert trained.there(tmp_path) == ["sam2act-small"]
    tiny_checkpoint(trained.path_of("seek-small", tmp_path))
    assert trained.there(tmp_path) == list(trained.POLICIES)


def test_a_checkpoint_is_known_by_its_content_and_header(tmp_path: Path) -> None:
    path = tiny_checkpoint(trained.path_of("seek-small", tmp_path))

    found = trained.read("seek-small", tmp_path)

    assert (found.name, found.path, found.size) == ("seek-small", path, path.stat().st_size)
    assert found.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.header.provenance.tasks == ("push_button_times",)


def test_a_damaged_file_is_told(tmp_path: Path) -> None:
    trained.path_of("seek-small", tmp_path).write_bytes(b"version https://git-lfs")

    with pytest.raises(BadCheckpoint):
        trained.read("seek-small", tmp_path)
    with pytest.raises(FileNotFoundError):
        trained.read("sam2act-small", tmp_path)


def test_they_are_listed_without_torch() -> None:
    program = (
        "import sys; from seek_model import trained; trained.there()\n"
        "assert not {'torch', 'numpy', 'safetensors'} & set(sys.modules)\n"
    )

    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


def test_nothing_else_lies_among_them() -> None:
    files = {path.name for path in trained.FOLDER.iterdir() if path.is_file()}

    assert files <= {"__init__.py", *(trained.path_of(name).name for name in trained.NAMES)}


@pytest.mark.parametrize("name", HERE)
def test_what_comes_along_is_small_in_half_precision_and_loads(name: str) -> None:
    found = trained.read(name)

    assert found.size <= trained.MOST
    kinds = {tensor.dtype for tensor in found.header.tensors.values()}
    assert "F32" not in kinds and "F16" in kinds
    policy.load(found.path)


@pytest.mark.parametrize("name", HERE)
def test_what_comes_along_learnt_every_task_of_the_suite(name: str) -> None:
    origin = trained.read(name).header.provenance

    assert origin.suite == "hide"
    assert set(origin.tasks) == set(SUITES["hide"])


@pytest.mark.parametrize("name", [name for name in HERE if name in trained.POLICIES])
def test_both_policies_went_on_from_the_first_phase_that_comes_along(name: str) -> None:
    assert trained.read(name).header.provenance.start == trained.read(trained.STAGE_ONE).sha256
