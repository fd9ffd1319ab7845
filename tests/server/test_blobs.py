from pathlib import Path

from server.blobs import Blobs


def test_only_half_written_files_are_cleared(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "blobs")
    whole = blobs.put(b"whole")
    (blobs.folder / ".half.0123.part").write_bytes(b"ha")

    blobs.clear_parts()

    assert [file for file in blobs.folder.rglob("*") if file.is_file()] == [blobs.path(whole)]
