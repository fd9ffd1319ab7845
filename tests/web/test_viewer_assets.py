"""The viewer's files: made once, kept, repaired, served to every kind of client."""

import gzip
import json
import os
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.web import sites
from tests.web.sites import Site
from web.routes_viewer import _takes_gzip
from web.viewer_assets import (
    LAYOUT,
    LAYOUTS,
    MANIFEST,
    PACKED,
    SCRIPT,
    WASM,
    ViewerAssets,
    ViewerMissing,
    layout_for,
    prepare,
    wheel_folder,
)
from web.wasm import without_names


def section(kind: int, content: bytes) -> bytes:
    assert len(content) < 128
    return bytes([kind, len(content)]) + content


HEADER = b"\0asm" + struct.pack("<I", 1)
NAMES = section(0, b"\4name" + b"f" * 20)
OTHER = section(0, b"\5names" + b"g" * 9)
TYPES = section(1, b"\0" * 5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The viewer's files, made."""
    made = tmp_path_factory.mktemp("viewer")
    prepare(made)
    return made


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def copied(folder: Path, to: Path) -> None:
    """The same files elsewhere: spares seconds of compressing."""
    to.mkdir(parents=True)
    for file in folder.iterdir():
        os.link(file, to / file.name)


# --- the debug names ---


def test_only_the_section_of_names_is_left_out() -> None:
    assert without_names(HEADER + TYPES + NAMES + OTHER) == HEADER + TYPES + OTHER


def test_what_is_no_webassembly_is_refused() -> None:
    with pytest.raises(ValueError, match="not WebAssembly"):
        without_names(b"<html>")


# --- making and keeping ---


def test_the_files_are_the_wheels_own_but_for_names_and_an_export(folder: Path) -> None:
    script, wasm = (wheel_folder() / "widget.js").read_bytes(), (wheel_folder() / WASM).read_bytes()

    packed = gzip.decompress((folder / PACKED).read_bytes())

    assert (folder / SCRIPT).read_bytes() == script + b"\nexport { WebViewer };\n"
    assert packed == without_names(wasm)
    assert len(packed) < 0.8 * len(wasm)
    assert len(LAYOUTS) == 2  # of four cameras, and of one
    assert all((folder / name).read_bytes().startswith(b"RRF2") for name in LAYOUTS)
    assert b"wrist" not in (folder / layout_for(("front",))).read_bytes()
    assert set(contents(folder)) == {SCRIPT, PACKED, *LAYOUTS, MANIFEST}


def test_whole_files_are_kept(folder: Path) -> None:
    before = {file: file.stat().st_mtime_ns for file in folder.iterdir()}

    prepare(folder)

    assert {file: file.stat().st_mtime_ns for file in folder.iterdir()} == before


@pytest.mark.parametrize("damage", ["cut", "gone", "manifest", "source"])
def test_damaged_files_are_made_anew(folder: Path, damage: str) -> None:
    whole = contents(folder)
    if damage == "cut":
        (folder / SCRIPT).write_bytes(whole[SCRIPT][:1000])
    elif damage == "gone":
        (folder / LAYOUT).unlink()
    elif damage == "manifest":
        (folder / MANIFEST).write_text('{"web-viewer.js": 3')
    else:
        told = json.loads(whole[MANIFEST])
        told[SCRIPT]["source"] = "another wheel's"
        (folder / MANIFEST).write_text(json.dumps(told))

    prepare(folder)

    assert {name: contents(folder)[name] for name in (SCRIPT, PACKED)} == {
        name: whole[name] for name in (SCRIPT, PACKED)
    }
    assert set(contents(folder)) == set(whole)


def test_two_servers_may_make_them_at_once(folder: Path) -> None:
    whole = contents(folder)[SCRIPT]
    (folder / SCRIPT).unlink()

    with ThreadPoolExecutor(2) as threads:
        list(threads.map(prepare, [folder, folder]))

    assert contents(folder)[SCRIPT] == whole
    assert set(contents(folder)) == {SCRIPT, PACKED, *LAYOUTS, MANIFEST}


def test_a_folder_that_cannot_be_written_is_told_and_tried_again(tmp_path: Path) -> None:
    (tmp_path / "viewer").write_text("in the way")
    assets = ViewerAssets(tmp_path)

    first = assets.begin()
    with pytest.raises(ViewerMissing, match="could not be made"):
        first.result(timeout=60)

    assert assets.begin() is not first


# --- serving ---


@pytest.fixture
def served(client: TestClient, site: Site, folder: Path) -> tuple[TestClient, str]:
    """A client, and where the files are."""
    assets: ViewerAssets = site.app.state.viewer
    if not assets.folder.exists():
        copied(folder, assets.folder)
    return client, f"/viewer/{assets.version}"


def test_webassembly_is_sent_packed_to_who_unpacks_it(
    served: tuple[TestClient, str], folder: Path
) -> None:
    client, address = served
    wasm = gzip.decompress((folder / PACKED).read_bytes())

    for accepted, encoding in {"gzip, br": "gzip", "identity": None, "gzip;q=0": None}.items():
        response = client.get(f"{address}/{WASM}", headers={"Accept-Encoding": accepted})

        assert response.headers["content-type"] == "application/wasm"
        assert response.headers.get("content-encoding") == encoding
        assert response.headers["vary"] == "Accept-Encoding"
        assert "immutable" in response.headers["cache-control"]
        assert response.content == wasm


def test_the_script_and_the_layout_are_served(served: tuple[TestClient, str]) -> None:
    client, address = served

    script, layout = client.get(f"{address}/{SCRIPT}"), client.get(f"{address}/{LAYOUT}?v=1")

    assert script.headers["content-type"].startswith("text/javascript")
    assert layout.content.startswith(b"RRF2")


def test_another_version_or_file_is_not_there(served: tuple[TestClient, str]) -> None:
    client, address = served

    for path in ("/viewer/0.1.0/web-viewer.js", f"{address}/{MANIFEST}", f"{address}/../x"):
        assert client.get(path).status_code == 404


def test_routes_say_that_the_viewer_is_missing(tmp_path: Path) -> None:
    (tmp_path / "viewer").write_text("in the way")
    app = sites.empty(tmp_path)
    client = TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)

    response = client.get(f"/viewer/{app.state.viewer.version}/{SCRIPT}")

    app.state.hub.stop()
    assert response.status_code == 503
    assert response.json()["code"] == "viewer_missing"


def test_they_are_made_in_the_background_when_the_server_starts(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)
    (app.state.viewer.folder / LAYOUT).unlink()

    with TestClient(app, base_url="http://127.0.0.1") as client:
        began = time.monotonic()
        assert client.get("/tasks").status_code == 200  # does not wait for them
        waited = time.monotonic() - began
        files = app.state.viewer.begin().result(timeout=60)

    assert waited < 2
    assert files.wasm.exists() and files.layouts[LAYOUT].exists()


@pytest.mark.parametrize(
    ("accepted", "taken"),
    [("gzip", True), ("br, *;q=0.1", True), ("GZIP;q=1.0", True), ("", False), ("br", False)],
)
def test_who_takes_gzip(accepted: str, taken: bool) -> None:
    assert _takes_gzip(accepted) is taken
