"""Resumable uploads: what cuts, wrong offsets, wrong checksums and killed servers leave behind."""

import base64
import hashlib
import socket
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from server import uploads
from server.models import Upload, now
from tests.processes import wait_for
from tests.server import ledgers
from tests.server.clients import API, client, hub_of, problem_of, served
from tests.server.people import peopled, token_of, visitor
from tests.server.running import RunningServer

TUS = {"Tus-Resumable": "1.0.0"}
BYTES = TUS | {"Content-Type": "application/offset+octet-stream"}


def told(**what: str) -> str:
    """The header that says what is uploaded."""
    return ",".join(
        f"{name} {base64.b64encode(one.encode()).decode()}" for name, one in what.items()
    )


def begin(here: httpx.Client, length: int, **what: str) -> str:
    """The path of a new upload."""
    answer = ask(here, length, **what)
    assert answer.status_code == 201, answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    return answer.headers["location"]


def ask(here: httpx.Client, length: int, **what: str) -> httpx.Response:
    metadata = told(**({"name": "mine"} | what))
    headers = TUS | {"Upload-Length": str(length), "Upload-Metadata": metadata}
    return here.post(f"{API}/uploads", headers=headers)


def add(here: httpx.Client, path: str, offset: int, content: object, **more: str) -> httpx.Response:
    headers = BYTES | {"Upload-Offset": str(offset)} | more
    return here.patch(path, content=content, headers=headers)  # type: ignore[arg-type]


def offset(here: httpx.Client, path: str) -> int:
    """Where the upload goes on."""
    answer = here.head(path, headers=TUS)
    assert answer.status_code == 200 and answer.headers["cache-control"] == "no-store"
    return int(answer.headers["upload-offset"])


def checksum(content: bytes) -> str:
    return "sha256 " + base64.b64encode(hashlib.sha256(content).digest()).decode()


@pytest.fixture
def here(tmp_path: Path) -> Iterator[httpx.Client]:
    with client(tmp_path) as found:
        yield found


def test_what_is_spoken_is_told(here: httpx.Client) -> None:
    headers = here.options(f"{API}/uploads").headers

    assert headers["tus-version"] == "1.0.0"
    assert headers["tus-extension"] == "creation,expiration,checksum,termination"
    assert int(headers["tus-max-size"]) == hub_of(here).settings.checkpoint_limit


@pytest.mark.slow
def test_a_checkpoint_in_pieces_becomes_a_version(here: httpx.Client, tmp_path: Path) -> None:
    from tests.seek_model.checkpoints import tiny_checkpoint  # brings torch along

    file = tmp_path / "tiny.safetensors"
    tiny_checkpoint(file)
    content = file.read_bytes()
    sha256 = hashlib.sha256(content).hexdigest()
    path = begin(here, len(content), description="in pieces", sha256=sha256)
    early = here.post(f"{path}/version")
    for start in range(0, len(content), 50_000):
        piece = content[start : start + 50_000]
        answer = add(here, path, start, piece, **{"Upload-Checksum": checksum(piece)})
        assert answer.status_code == 204
        assert int(answer.headers["upload-offset"]) == start + len(piece)

    made = here.post(f"{path}/version")
    again = begin(here, len(content), sha256=sha256)

    assert (early.status_code, problem_of(early)["code"]) == (409, "not_whole")
    assert made.status_code == 201, made.text
    assert made.json()["spec"]["sha256"] == sha256
    assert made.json()["description"] == "in pieces"
    assert here.head(path, headers=TUS).status_code == 404
    assert hub_of(here).blobs.path(sha256).read_bytes() == content
    assert offset(here, again) == len(content)  # one's own file has come already
    assert here.post(f"{again}/version").json() == made.json()


def test_what_is_no_checkpoint_stays_an_upload(here: httpx.Client) -> None:
    path = begin(here, 7)
    add(here, path, 0, b"weights")

    answer = here.post(f"{path}/version")

    assert answer.status_code == 422 and "is no checkpoint" in problem_of(answer)["detail"]
    assert offset(here, path) == 7


def test_another_file_than_was_announced_is_refused(here: httpx.Client) -> None:
    path = begin(here, 7, sha256="0" * 64)
    add(here, path, 0, b"weights")

    answer = here.post(f"{path}/version")

    assert problem_of(answer)["errors"][0]["field"] == "sha256"


@pytest.mark.parametrize("wrong", [0, 2, 4, 7])
def test_a_wrong_offset_is_told_the_right_one(here: httpx.Client, wrong: int) -> None:
    path = begin(here, 7)
    add(here, path, 0, b"wei")

    answer = add(here, path, wrong, b"ghts")

    assert answer.status_code == 409 and "is at 3" in problem_of(answer)["detail"]
    assert add(here, path, 3, b"ghts").status_code == 204
    assert hub_of(here).uploads.of(path.rpartition("/")[2]).received().size == 7


def test_pieces_with_a_wrong_checksum_are_not_kept(here: httpx.Client) -> None:
    path = begin(here, 7)
    add(here, path, 0, b"wei")

    wrong = add(here, path, 3, b"gXts", **{"Upload-Checksum": checksum(b"ghts")})
    at = offset(here, path)
    right = add(here, path, 3, b"ghts", **{"Upload-Checksum": checksum(b"ghts")})

    received = hub_of(here).uploads.of(path.rpartition("/")[2]).received()
    assert (wrong.status_code, at, right.status_code) == (460, 3, 204)
    assert received.sha256 == hashlib.sha256(b"weights").hexdigest()


def test_more_than_was_announced_is_refused(here: httpx.Client) -> None:
    path = begin(here, 7)

    answer = add(here, path, 0, b"weights and more")

    assert answer.status_code == 413
    assert offset(here, path) <= 7


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 412),
        ({"Tus-Resumable": "0.2.2"}, 412),
        (TUS | {"Upload-Metadata": told(name="mine")}, 422),
        (TUS | {"Upload-Length": "7"}, 422),
        (TUS | {"Upload-Length": "0", "Upload-Metadata": told(name="mine")}, 422),
        (TUS | {"Upload-Length": "7", "Upload-Metadata": "name ***"}, 422),
        (TUS | {"Upload-Length": "7", "Upload-Metadata": told(name="expert")}, 422),
        (TUS | {"Upload-Length": "7", "Upload-Metadata": told(name="a/b")}, 422),
        (TUS | {"Upload-Length": "7", "Upload-Metadata": told(name="x", sha256="no")}, 422),
        (TUS | {"Upload-Length": str(2**50), "Upload-Metadata": told(name="mine")}, 413),
    ],
)
def test_a_wrong_beginning_begins_nothing(
    here: httpx.Client, headers: dict[str, str], status: int
) -> None:
    answer = here.post(f"{API}/uploads", headers=headers)

    assert answer.status_code == status and problem_of(answer)
    with hub_of(here).database.reading() as session:
        assert session.query(Upload).count() == 0


def test_ended_and_expired_uploads_leave_nothing(here: httpx.Client) -> None:
    hub = hub_of(here)
    ended, expired = begin(here, 7), begin(here, 7)
    for path in (ended, expired):
        add(here, path, 0, b"wei")
    with hub.database.writing() as session:
        session.get_one(Upload, expired.rpartition("/")[2]).expires = now() - timedelta(seconds=1)

    assert here.delete(ended, headers=TUS).status_code == 204
    assert here.head(ended, headers=TUS).status_code == 404
    assert here.head(expired, headers=TUS).status_code == 410
    assert len(list(hub.folder.uploads.iterdir())) == 1
    with hub.database.writing() as session:
        hub.uploads.sweep(session)
    assert list(hub.folder.uploads.iterdir()) == []


def test_too_many_at_once_are_refused(here: httpx.Client) -> None:
    for _ in range(uploads.MOST):
        begin(here, 7)

    assert problem_of(ask(here, 7))["code"] == "too_many_uploads"


def test_a_cut_connection_keeps_what_came_and_the_upload_goes_on(tmp_path: Path) -> None:
    content = bytes(range(256)) * 4000
    with served(tmp_path) as (hub, here):
        path = begin(here, len(content))
        id = path.rpartition("/")[2]
        address = urlsplit(str(here.base_url))
        with socket.create_connection((address.hostname, address.port)) as connection:
            head = f"PATCH {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nUpload-Offset: 0\r\n"
            head += "".join(f"{name}: {value}\r\n" for name, value in BYTES.items())
            head += f"Content-Length: {len(content)}\r\n\r\n"
            connection.sendall(head.encode() + content[:100_000])
            wait_for(lambda: hub.uploads.of(id).size == 100_000, "the first part")
            second = add(here, path, 100_000, b"x")  # while the other one is there

        wait_for(lambda: not hub.uploads.of(id).busy.locked(), "its end")
        at = offset(here, path)
        rest = add(here, path, at, content[at:])
        received = hub.uploads.of(id).received()

    assert second.status_code == 423
    assert at == 100_000 and rest.status_code == 204
    assert received.sha256 == hashlib.sha256(content).hexdigest()


def test_two_uploads_at_once_do_not_mix(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        paths = {begin(here, 400_000): letter for letter in (b"a", b"b")}

        def send(path: str, letter: bytes) -> None:
            with httpx.Client(base_url=here.base_url, trust_env=False) as own:
                for start in range(0, 400_000, 40_000):
                    assert add(own, path, start, letter * 40_000).status_code == 204

        threads = [threading.Thread(target=send, args=one) for one in paths.items()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(30)

        for path, letter in paths.items():
            received = hub.uploads.of(path.rpartition("/")[2]).received()
            assert received.sha256 == hashlib.sha256(letter * 400_000).hexdigest()


@pytest.mark.slow
def test_a_killed_server_goes_on_at_the_offset(tmp_path: Path) -> None:
    server = RunningServer(tmp_path / "data", "--no-references", workers=0)
    with server:
        path = begin(server.client, 7)
        assert add(server.client, path, 0, b"wei").status_code == 204
        server.kill()
        server.start()

        at = offset(server.client, path)
        rest = add(server.client, path, at, b"ghts")

    [file] = (tmp_path / "data" / "uploads").iterdir()
    assert (at, rest.status_code) == (3, 204)
    assert file.read_bytes() == b"weights"


def test_an_upload_is_its_owners_and_a_known_file_tells_nobody_else(tmp_path: Path) -> None:
    with peopled(tmp_path) as app:
        hub = app.state.hub
        mine, other = (visitor(app, token_of(app, name)) for name in ("submitter", "maintainer"))
        ledgers.uploaded(hub.database, hub.blobs, "seek", b"weights")
        sha256 = hashlib.sha256(b"weights").hexdigest()

        path = begin(mine, 7, sha256=sha256)

        assert offset(mine, path) == 0  # the server has the file, but not from this user
        for method in ("HEAD", "DELETE"):
            assert other.request(method, path, headers=TUS).status_code == 404
        assert add(other, path, 0, b"x").status_code == 404
        assert add(mine, path, 0, b"weights").status_code == 204


def test_what_is_announced_counts_towards_the_quota(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_storage=10) as app:
        asking = visitor(app, token_of(app, "submitter"))
        begin(asking, 7)

        answer = ask(asking, 4)

        assert (answer.status_code, problem_of(answer)["code"]) == (413, "quota_storage")
        assert ask(asking, 3).status_code == 201


def test_a_disk_without_room_takes_no_upload(here: httpx.Client, monkeypatch) -> None:
    monkeypatch.setattr("server.hub.RESERVE", 2**62)

    assert problem_of(ask(here, 7))["code"] == "no_room"
