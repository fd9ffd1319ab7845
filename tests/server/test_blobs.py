from pathlib import Path

from server.blobs import Blobs


def test_what_no_ledger_knows_is_swept(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "blobs")
    known, orphan = blobs.put(b"known"), blobs.put(b"orphan")
    (blobs.folder / ".half.part").write_bytes(b"ha")

    blobs.sweep({known})

    assert blobs.holds(known) and not blobs.holds(orphan)
    assert [file for file in blobs.folder.rglob("*") if file.is_file()] == [blobs.path(known)]
