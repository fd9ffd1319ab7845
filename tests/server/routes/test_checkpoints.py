"""Checkpoints over HTTP: uploaded, loaded once, registered, refused, given to workers."""

import hashlib
import socket
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
import torch

from seek_model.checkpoint_header import read_header
from server import blobs, jobs, lifecycle
from server.hub import Hub
from server.models import Blob
from server.suites import smoke_tasks
from tests.processes import wait_for
from tests.seek_model.checkpoints import parts_of, tiny_checkpoint
from tests.seek_model.tiny import tiny as tiny_config
from tests.server import ledgers
from tests.server.clients import (
    API,
    TestClient,
    Worker,
    client,
    create,
    ended,
    hub_of,
    problem_of,
    served,
)
from tests.workers import checkpoint_files
from workers.policy_process import LOAD_LIMIT
from workers.protocol import INTERNAL

UPLOAD = f"{API}/policies/checkpoints"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A checkpoint that can be played."""
    path = tmp_path_factory.mktemp("tiny") / "tiny.safetensors"
    tiny_checkpoint(path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A server for uploads that leave nothing behind."""
    with client(tmp_path_factory.mktemp("shared")) as found:
        yield found


def upload(here: httpx.Client, content: object, **query: str) -> httpx.Response:
    query.setdefault("name", "mine")
    return here.post(UPLOAD, params=query, content=content)  # type: ignore[arg-type]


def files(hub: Hub) -> list[Path]:
    return [path for path in hub.folder.blobs.rglob("*") if path.is_file()]


def test_a_checkpoint_becomes_a_version(here: TestClient, tiny: bytes) -> None:
    sha256 = hashlib.sha256(tiny).hexdigest()

    first = upload(here, iter([tiny[:1000], tiny[1000:]]), description="the first")
    again = upload(here, tiny, description="the same")

    assert [answer.status_code for answer in (first, again)] == [201, 200]
    version = first.json()
    assert again.json() == version == here.get(first.headers["location"]).json()
    assert (version["policy"], version["version"]) == ("mine", 1)
    assert version["description"] == "the first"
    assert version["spec"] == {
        "kind": "checkpoint",
        "sha256": sha256,
        "size": len(tiny),
        "model": tiny_config().name,
        "suite": "hide",
        "timeout": 60.0,
    }
    names = [(check["name"], check["outcome"]) for check in version["checks"]]
    assert names == [(name, "passed") for name in ("header", "load", "decision", "repetition")]
    assert version["checks"][0]["detail"].startswith(f"{tiny_config().name}, ")
    hub = hub_of(here)
    assert files(hub) == [hub.blobs.path(sha256)]
    assert hub.blobs.path(sha256).read_bytes() == tiny
    with hub.database.reading() as session:
        assert session.get_one(Blob, sha256).media_type == blobs.CHECKPOINT
    hub.blobs.clear_parts()
    assert hub.blobs.holds(sha256)


def test_a_version_is_first_tried_on_the_suite_that_it_was_trained_on(tmp_path: Path) -> None:
    content = tiny_checkpoint(tmp_path / "tiny.safetensors", suite="real4").read_bytes()

    with client(tmp_path / "data", smoke=True) as here:
        version = upload(here, content).json()
        first = here.get(f"{API}/evaluations/{version['smoke']}").json()
        refused = here.post(f"{API}/evaluations", json={"policy": "mine", "suite": "smoke"})

    assert version["spec"]["suite"] == "real4"
    tasks = list(smoke_tasks("real4"))
    assert (first["tasks"], first["split"], first["episodes"]) == (tasks, "val", 1)
    assert refused.status_code == 422
    assert "trained on suite real4" in refused.json()["errors"][0]["message"]


def test_a_file_of_torch_save_is_converted_and_known_again(
    here: TestClient, tiny: bytes, tmp_path: Path
) -> None:
    (tmp_path / "tiny.safetensors").write_bytes(tiny)
    torch.save(parts_of(tmp_path / "tiny.safetensors"), tmp_path / "tiny.pt")
    saved = (tmp_path / "tiny.pt").read_bytes()

    first, again = upload(here, saved), upload(here, saved)

    assert [answer.status_code for answer in (first, again)] == [201, 200]
    version = first.json()
    assert again.json() == version
    assert version["checks"][0]["name"] == "conversion"
    assert hashlib.sha256(saved).hexdigest() in version["checks"][0]["detail"]
    hub = hub_of(here)
    assert files(hub) == [hub.blobs.path(version["spec"]["sha256"])]
    assert read_header(files(hub)[0]).config == tiny_config()


def test_a_worker_gets_the_file_of_its_attempt(here: TestClient) -> None:
    hub, content = hub_of(here), checkpoint_files.content()
    ledgers.uploaded(hub.database, hub.blobs, "mine", content)
    create(here, policy="mine")
    worker = Worker(hub, here)
    path = f"{INTERNAL}/attempts/{worker.attempt}/checkpoint"

    given = here.get(path, headers=worker.headers)
    part = here.get(path, headers=worker.headers | {"Range": "bytes=8-15"})

    assert given.content == content
    assert (part.status_code, part.content) == (206, content[8:16])
    assert here.get(path).status_code == 401
    assert here.get(path, headers={"Authorization": "Bearer wrong"}).status_code == 401
    ended(hub, worker, "it hung")
    assert here.get(path, headers=worker.headers).status_code == 409


def test_what_cannot_be_loaded_here_is_not_handed_out(
    here: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub, content = hub_of(here), checkpoint_files.content()
    ledgers.uploaded(hub.database, hub.blobs, "mine", content)
    create(here, policy="mine")
    limits = {"server": "http://127.0.0.1:9", "episode_limit": 60.0, "allow_python": False}
    with hub.database.reading() as session:
        shard = lifecycle.next_shard(session)
        assert shard
        draft = partial(jobs.draft, session, shard, store=hub.blobs, **limits)

        assert draft().policy.kind == "checkpoint"
        assert draft().episode_limit > 60 + LOAD_LIMIT
        with monkeypatch.context() as patch:
            patch.setattr("server.jobs.has_torch", lambda: False)
            with pytest.raises(jobs.CannotPlay, match=r"hide-seek\[seek\]'; resume then"):
                draft()
        hub.blobs.path(hashlib.sha256(content).hexdigest()).unlink()
        with pytest.raises(jobs.CannotPlay, match="is gone; upload it again"):
            draft()


def test_an_attempt_at_another_policy_has_no_checkpoint(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)

    path = f"{INTERNAL}/attempts/{worker.attempt}/checkpoint"
    answer = here.get(path, headers=worker.headers)

    assert answer.status_code == 404 and problem_of(answer)["code"] == "not_found"


def refused(here: TestClient, answer: httpx.Response, status: int) -> str:
    """What the problem says; nothing was registered or kept."""
    assert answer.status_code == status, answer.text
    assert here.get(f"{API}/policies/mine").status_code == 404
    assert files(hub_of(here)) == []
    return str(problem_of(answer)["detail"])


@pytest.mark.parametrize("wrong", checkpoint_files.WRONG)
def test_what_is_no_checkpoint_is_refused(shared: TestClient, wrong: str) -> None:
    content, message = checkpoint_files.WRONG[wrong]

    answer = upload(shared, content)
    detail = refused(shared, answer, 422)

    assert detail.startswith("body: is no checkpoint: ")
    assert message in detail
    [failed] = problem_of(answer)["checks"]
    assert (failed["name"], failed["outcome"]) == ("header", "failed")
    assert failed["detail"] in detail


def test_weights_that_fit_no_network_are_named(shared: TestClient) -> None:
    answer = upload(shared, checkpoint_files.content())
    detail = refused(shared, answer, 422)

    assert detail.startswith("body: cannot be loaded: tensor ")
    assert "BadCheckpoint" not in detail
    names = [(check["name"], check["outcome"]) for check in answer.json()["checks"]]
    assert names == [("header", "passed"), ("load", "failed")]


def test_nan_is_named(shared: TestClient, tiny: bytes) -> None:
    start = 8 + int.from_bytes(tiny[:8], "little")
    spoiled = tiny[:start] + b"\xff" * (len(tiny) - start)

    detail = refused(shared, upload(shared, spoiled), 422)

    assert "NaN" in detail


def test_an_empty_body_is_refused(shared: TestClient) -> None:
    assert "is empty" in refused(shared, upload(shared, b""), 422)


@pytest.mark.parametrize("name", ["", "expert", "<b>", "x" * 81])
def test_a_name_that_cannot_be_is_refused(shared: TestClient, name: str) -> None:
    answer = upload(shared, checkpoint_files.content(), name=name)

    assert refused(shared, answer, 422).startswith("name: ")


def test_a_form_is_refused(shared: TestClient) -> None:
    answer = shared.post(UPLOAD, params={"name": "mine"}, files={"file": b"x"})

    assert "the file itself" in refused(shared, answer, 415)


def test_another_sites_page_uploads_nothing(shared: TestClient) -> None:
    answer = shared.post(
        UPLOAD,
        params={"name": "mine"},
        content=checkpoint_files.content(),
        headers={"Origin": "http://evil.example"},
    )

    refused(shared, answer, 403)


@pytest.mark.parametrize("in_pieces", [False, True])
def test_too_large_a_checkpoint_is_refused(tmp_path: Path, in_pieces: bool) -> None:
    content = checkpoint_files.content()
    with client(tmp_path, checkpoint_limit=len(content) - 1) as here:
        answer = upload(here, iter([content[:9], content[9:]]) if in_pieces else content)

        detail = refused(here, answer, 413)

    assert f"at most {len(content) - 1} bytes" in detail
    assert "HIDE_SERVER_CHECKPOINT_LIMIT" in detail


def test_a_checkpoint_may_be_larger_than_any_other_body(
    shared: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.guard.MOST", 10)

    assert "is no checkpoint" in refused(shared, upload(shared, b"more than ten bytes"), 422)


def test_without_torch_it_is_told_what_to_install(
    shared: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.checkpoints.has_torch", lambda: False)

    detail = refused(shared, upload(shared, checkpoint_files.content()), 503)

    assert "pip install 'hide-seek[seek]'" in detail


def test_a_checkpoint_is_not_named_but_uploaded(shared: TestClient) -> None:
    spec = {"kind": "checkpoint", "sha256": "0" * 64, "size": 1}

    answer = shared.post(f"{API}/policies", json={"name": "mine", "spec": spec})

    assert refused(shared, answer, 422).startswith("spec: ")


def test_an_upload_that_breaks_off_leaves_nothing(tmp_path: Path) -> None:
    content = checkpoint_files.content()
    with served(tmp_path) as (hub, here):
        address = urlsplit(str(here.base_url))
        with socket.create_connection((address.hostname, address.port)) as connection:
            head = f"POST {UPLOAD}?name=mine HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            head += f"Content-Length: {len(content)}\r\n\r\n"
            connection.sendall(head.encode() + content[:100])
            wait_for(lambda: files(hub), "the upload")

        wait_for(lambda: not files(hub), "its end")
        assert here.get(f"{API}/policies/mine").status_code == 404


def test_what_takes_too_long_to_load_is_refused(
    shared: TestClient, tiny: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.checkpoints.CHECK_LIMIT", 0.01)

    detail = refused(shared, upload(shared, tiny), 422)

    assert "took longer than 0.01 s" in detail
