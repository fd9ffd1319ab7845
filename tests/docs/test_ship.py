"""A checkpoint is put among those that come with the code only if it plays, and as it was."""

from pathlib import Path

import pytest
from safetensors.torch import load_file

from docs import ship
from seek_model import checkpoint, trained
from seek_model.checkpoint_header import read_header
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.seek_model.tiny import tiny
from tests.workers import checkpoint_files


@pytest.fixture
def source(tmp_path: Path) -> Path:
    return tiny_checkpoint(tmp_path / "checkpoint.safetensors")


def test_half_the_bytes_and_the_same_configuration_and_provenance(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ship.main([str(source), "seek-small", "--to", str(tmp_path / "out")]) == 0

    found, before = trained.read("seek-small", tmp_path / "out"), read_header(source)
    assert found.header.config == before.config
    assert found.header.provenance == before.provenance
    assert {one.dtype for one in found.header.tensors.values()} == {"F16"}
    assert found.size < 0.6 * source.stat().st_size + 8000  # the header stays
    told = capsys.readouterr().out
    assert found.sha256 in told and f"{found.size} bytes" in told and "moved furthest" in told
    assert list((tmp_path / "out").iterdir()) == [found.path]


def test_the_same_weights_give_the_same_file(source: Path, tmp_path: Path) -> None:
    once, _ = ship.ship(source, "seek-small", tmp_path / "once")
    again, _ = ship.ship(source, "seek-small", tmp_path / "again")
    third, moved = ship.ship(once.path, "seek-small", tmp_path / "third")

    assert once.sha256 == again.sha256 == third.sha256
    assert moved.before == moved.after


def test_the_weight_that_moved_furthest_is_told(source: Path, tmp_path: Path) -> None:
    one, moved = ship.ship(source, "seek-small", tmp_path / "out")

    whole, halved = load_file(source), load_file(one.path)
    furthest = max(float((whole[name] - halved[name].float()).abs().max()) for name in whole)
    assert abs(moved.before - moved.after) == furthest > 0


def test_a_value_that_float16_does_not_have_is_refused(tmp_path: Path, source: Path) -> None:
    tensors, header = load_file(source), read_header(source)
    tensors["language.table.weight"][0, 0] = 70_000.0
    checkpoint.save(source, tensors, header.config, header.provenance)

    with pytest.raises(ship.CannotShip, match=r"'language.table.weight' holds 70000; .* 65504"):
        ship.ship(source, "seek-small", tmp_path / "out")

    assert not list((tmp_path / "out").glob("*"))


def test_too_large_a_file_is_refused_and_the_one_before_stays(
    tmp_path: Path, source: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, _ = ship.ship(source, "seek-small", tmp_path / "out")
    monkeypatch.setattr(ship, "MOST", before.size - 1)

    with pytest.raises(ship.CannotShip, match=f"takes {before.size} bytes in half precision"):
        ship.ship(source, "seek-small", tmp_path / "out")

    assert list((tmp_path / "out").iterdir()) == [before.path]


def test_what_does_not_play_is_refused(tmp_path: Path) -> None:
    odd = checkpoint_files.written(tmp_path / "odd.safetensors")
    looks_ahead = tiny("seek-small/anchor_oracle")

    for path in (odd, tiny_checkpoint(tmp_path / "oracle", looks_ahead), tmp_path / "nowhere"):
        with pytest.raises(ship.CannotShip, match="no checkpoint that plays"):
            ship.ship(path, "seek-small", tmp_path)


def test_what_goes_by_a_name_is_what_the_name_says(tmp_path: Path, source: Path) -> None:
    free = tiny_checkpoint(tmp_path / "free.safetensors", tiny("sam2act-small"))

    for path, name, message in (
        (source, "sam2act-small", "with no memory; .* has one"),
        (free, "seek-small", "with a memory; .* has none"),
        (free, "stage-one", "is from the second"),
        (source, "seek-smal", "Did you mean seek-small"),
    ):
        with pytest.raises(ship.CannotShip, match=message):
            ship.ship(path, name, tmp_path / "out")

    ship.ship(free, "sam2act-small", tmp_path / "out")
