"""Uploads whose client does things in any order, with anything: what is kept is what it sent."""

import base64
import os
import shutil
from pathlib import Path
from tempfile import mkdtemp

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    consumes,
    invariant,
    multiple,
    rule,
    run_state_machine_as_test,
)

from server.uploads import MOST
from tests.server.clients import API, client, hub_of, problem_of
from tests.server.routes.test_uploads import BYTES, TUS, add, ask, checksum

LONGEST = 5000  # bytes
SHA256 = (None, "f" * 64)
pieces = st.binary(max_size=LONGEST)


class Uploads(RuleBasedStateMachine):
    """The server beside what a model of it says has come."""

    paths = Bundle("paths")

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(mkdtemp())
        self.entered = client(self.folder, checkpoint_limit=LONGEST)
        self.here = self.entered.__enter__()
        self.came: dict[str, bytes] = {}
        self.length: dict[str, int] = {}

    def teardown(self) -> None:
        self.entered.__exit__(None, None, None)
        shutil.rmtree(self.folder)

    @rule(
        target=paths, length=st.integers(-2, LONGEST + 2), sha256=st.sampled_from([None, "f" * 64])
    )
    def begins(self, length, sha256):
        answer = ask(self.here, length, **({"sha256": sha256} if sha256 else {}))
        if not 1 <= length <= LONGEST or len(self.came) >= MOST:
            assert 400 <= answer.status_code < 500, answer.text
            return multiple()
        assert answer.status_code == 201, answer.text
        path = answer.headers["location"]
        self.came[path], self.length[path] = b"", length
        return path

    @rule(name=st.text(max_size=300), filename=st.text(max_size=300))
    def begins_with_an_odd_name(self, name, filename):
        answer = ask(self.here, 10, name=name, filename=filename)
        assert answer.status_code < 500, answer.text
        if answer.status_code == 201:
            self.here.delete(answer.headers["location"], headers=TUS)

    @rule(metadata=st.binary(max_size=100))
    def begins_with_odd_metadata(self, metadata):
        text = base64.b85encode(metadata).decode()
        headers = TUS | {"Upload-Length": "10", "Upload-Metadata": text}
        assert 400 <= self.here.post(f"{API}/uploads", headers=headers).status_code < 500

    @rule(path=paths, content=pieces)
    def sends_the_next_piece(self, path, content):
        left = self.length[path] - len(self.came[path])
        answer = add(self.here, path, len(self.came[path]), content)
        if len(content) <= left:
            assert answer.status_code == 204, answer.text
            self.came[path] += content
        else:
            assert answer.status_code == 413, answer.text
            before, now = self.came[path], self.stored(path)  # a part of it may have been kept
            assert (before + content).startswith(now) and len(before) <= len(now)
            assert len(now) <= self.length[path]
            self.came[path] = now

    @rule(path=paths, content=pieces, offset=st.integers(-1, LONGEST))
    def sends_it_elsewhere(self, path, content, offset):
        if offset != len(self.came[path]):
            assert add(self.here, path, offset, content).status_code in (400, 409, 422)

    @rule(path=paths, content=pieces, other=pieces)
    def sends_it_with_another_checksum(self, path, content, other):
        if content == other or len(content) > self.length[path] - len(self.came[path]):
            return
        more = {"Upload-Checksum": checksum(other)}
        answer = add(self.here, path, len(self.came[path]), content, **more)
        assert answer.status_code == 460, answer.text

    @rule(path=paths)
    def wants_the_version(self, path):
        """Nothing that is sent here is a checkpoint."""
        answer = self.here.post(f"{path}/version")
        whole = len(self.came[path]) == self.length[path]
        assert answer.status_code == (422 if whole else 409), answer.text
        assert problem_of(answer)["detail"]

    @rule(path=paths, headers=st.sampled_from([{}, BYTES, TUS | {"Upload-Offset": "0"}]))
    def forgets_headers(self, path, headers):
        assert 400 <= self.here.patch(path, content=b"x", headers=headers).status_code < 500

    @rule(path=consumes(paths))
    def ends(self, path):
        assert self.here.delete(path, headers=TUS).status_code == 204
        assert self.here.head(path, headers=TUS).status_code == 404
        del self.came[path], self.length[path]

    @invariant()
    def what_came_is_kept(self):
        for path, content in self.came.items():
            head = self.here.head(path, headers=TUS)
            assert int(head.headers["upload-offset"]) == len(content)
            assert self.stored(path) == content

    def stored(self, path):
        file = hub_of(self.here).uploads.of(os.path.basename(path)).path
        return file.read_bytes() if file.exists() else b""


def test_an_upload_keeps_what_came_whatever_its_client_does() -> None:
    run_state_machine_as_test(
        Uploads,
        settings=settings(
            max_examples=12,
            stateful_step_count=20,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
