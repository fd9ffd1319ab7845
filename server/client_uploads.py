"""How a client uploads a checkpoint: by tus 1.0 (https://tus.io), so that it goes on when cut off.

Which uploads are begun is asked of the server, so another process, or another machine with the
same file, goes on as well.
"""

import base64
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from server.client import Client, ServerProblem, Unreachable
from server.schemas.policies import PolicyVersionPublic, UploadPublic

PIECE = 8 * 2**20  # bytes of one request
LOADING = 900.0  # s that the server may take to load what came
TUS = {"Tus-Resumable": "1.0.0"}
BYTES = {**TUS, "Content-Type": "application/offset+octet-stream"}
PASSING = (408, 409, 423)  # too slow, another offset, the broken connection is not noticed yet


class Source:
    """A file that is uploaded.

    Raises:
        OSError: it cannot be read.
    """

    def __init__(self, file: Path, name: str, description: str):
        self.name, self.description = name, description
        self.size = file.stat().st_size
        with file.open("rb") as content:
            self.sha256 = hashlib.file_digest(content, "sha256").hexdigest()

    @property
    def metadata(self) -> str:
        """What is said of it when the upload begins."""
        said = {"name": self.name, "description": self.description, "sha256": self.sha256}
        pairs = ((name, base64.b64encode(one.encode()).decode()) for name, one in said.items())
        return ",".join(f"{name} {value}" for name, value in pairs)

    def is_begun_by(self, upload: UploadPublic) -> bool:
        """True if this file is what the upload is to become."""
        mine = (self.name, self.sha256, self.size)
        return (upload.name, upload.sha256, upload.length) == mine


def upload(
    client: Client, file: Path, name: str, description: str, told: Callable[[int, int], None]
) -> PolicyVersionPublic:
    """The version that the file becomes; see `Client.upload`."""
    source = Source(file, name, description)
    path = _begun(client, source) or _begin(client, source)
    with file.open("rb") as content:
        _send(client, path, content, source.size, told)
    return _made(client, path, source)


def _begun(client: Client, source: Source) -> str | None:
    found = [f"/uploads/{one.id}" for one in client.uploads() if source.is_begun_by(one)]
    return found[0] if found else None


def _begin(client: Client, source: Source) -> str:
    headers = TUS | {"Upload-Length": str(source.size), "Upload-Metadata": source.metadata}
    answer = client.ask("POST", "/uploads", headers=headers)
    return str(answer.headers["location"]).removeprefix("/api/v1")


def _offset(client: Client, path: str) -> int:
    return int(client.ask("HEAD", path, headers=TUS).headers["upload-offset"])


def _send(
    client: Client, path: str, content: BinaryIO, size: int, told: Callable[[int, int], None]
) -> None:
    offset, tries = _offset(client, path), 0
    told(offset, size)
    while offset < size:
        content.seek(offset)
        headers = BYTES | {"Upload-Offset": str(offset)}
        before = offset
        try:
            answer = client.ask("PATCH", path, headers=headers, content=content.read(PIECE))
            offset = int(answer.headers["upload-offset"])
        except ServerProblem as error:
            if not isinstance(error, Unreachable) and error.status not in PASSING:
                raise
            tries = client.next_try(tries, error)
            offset = _offset(client, path)
        tries = 0 if offset > before else tries
        told(offset, size)


def _made(client: Client, path: str, source: Source) -> PolicyVersionPublic:
    tries = 0
    while True:
        try:
            answer = client.ask("POST", f"{path}/version", timeout=LOADING)
            return PolicyVersionPublic.model_validate_json(answer.content)
        except ServerProblem as error:
            # Perhaps it was made, and only the answer was lost.
            if error.status == 404 and (there := _known(client, source)):
                return there
            if not isinstance(error, Unreachable) and error.status != 423:
                raise
            tries = client.next_try(tries, error)


def _known(client: Client, source: Source) -> PolicyVersionPublic | None:
    for one in client.policies():
        if one.policy == source.name and getattr(one.spec, "sha256", None) == source.sha256:
            return one
    return None
