"""Files as answers; a range that they do not have is refused like everything else."""

from collections.abc import MutableMapping
from typing import Any

from starlette.responses import FileResponse
from starlette.types import Receive, Scope, Send

from server.problems import Problem


class File(FileResponse):
    """A file, whole or a range of it."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends it.

        Raises:
            Problem: 400, the range is not one; 416, the file does not have it. Nothing was sent.
        """

        async def tell(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start" and message["status"] >= 400:
                headers = {name.decode(): value.decode() for name, value in message["headers"]}
                raise _refused(message["status"], headers.get("content-range", ""))
            await send(message)

        await super().__call__(scope, receive, tell)


def _refused(status: int, has: str) -> Problem:
    if status != 416:
        return Problem(400, "malformed_range", "Range: is not of the form 'bytes=0-99'.")
    size = has.rpartition("/")[2]
    detail = f"The file has {size} bytes, and none of that range."
    return Problem(416, "no_such_range", detail, headers={"Content-Range": has})
