"""The other side of the workers' protocol: a real HTTP server that keeps what it is told."""

import hashlib
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import uvicorn
from fastapi import FastAPI, HTTPException, Request, Response
from fastapi.responses import JSONResponse

from workers.protocol import EPISODE_FINAL, INTERNAL, Committed, EpisodeCommit, Fault, Stored

TOKEN = "of-this-attempt"
EPISODE = f"{INTERNAL}/attempts/{{attempt}}/episodes/{{episode}}"


@dataclass
class Kept:
    """What was told, in order, and what is to be answered otherwise than well."""

    told: list[tuple[str, str]] = field(default_factory=list)  # (what, episode)
    commits: dict[str, EpisodeCommit] = field(default_factory=dict)
    recordings: dict[str, bytes] = field(default_factory=dict)
    pieces: list[int] = field(default_factory=list)  # bytes of each, as they arrived
    arrived: list[float] = field(default_factory=list)  # when, s
    faults: dict[str, str] = field(default_factory=dict)
    answers: dict[str, list[int]] = field(default_factory=dict)  # status codes to give first
    final: set[str] = field(default_factory=set)  # episodes that are committed already
    checkpoint: bytes = b""  # of every attempt's policy


@dataclass
class Peer:
    """A running server."""

    url: str
    kept: Kept


def app(kept: Kept) -> FastAPI:
    application = FastAPI()

    def hear(what: str, episode: str, request: Request) -> None:
        kept.told.append((what, episode))
        if request.headers.get("authorization") != f"Bearer {TOKEN}":
            raise HTTPException(401, "This token is of no current attempt.")
        if kept.answers.get(what):
            code = kept.answers[what].pop(0)
            raise HTTPException(code, f"as the test wants it: {what} {code}")

    @application.post(EPISODE + "/start")
    def start(episode: str, request: Request) -> Response:
        hear("start", episode, request)
        if episode in kept.final:
            return JSONResponse({"code": EPISODE_FINAL, "status": 409}, 409)
        return Response(status_code=204)

    @application.put(EPISODE + "/recording")
    async def recording(episode: str, request: Request) -> Stored:
        data = b""
        async for piece in request.stream():
            kept.pieces.append(len(piece))
            kept.arrived.append(time.monotonic())
            data += piece
            if piece and kept.answers.get("recording"):
                break
        hear("recording", episode, request)
        kept.recordings[episode] = data
        return Stored(sha256=hashlib.sha256(data).hexdigest(), size=len(data))

    @application.put(EPISODE + "/result")
    def result(episode: str, commit: EpisodeCommit, request: Request) -> Committed:
        hear("result", episode, request)
        already = episode in kept.commits
        kept.commits[episode] = commit
        return Committed(already=already)

    @application.post(EPISODE + "/fault")
    def fault(episode: str, said: Fault, request: Request) -> None:
        hear("fault", episode, request)
        kept.faults[episode] = said.reason

    @application.get(f"{INTERNAL}/attempts/{{attempt}}/checkpoint")
    def checkpoint(attempt: str, request: Request) -> Response:
        hear("checkpoint", attempt, request)
        return Response(kept.checkpoint)

    return application


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serving(kept: Kept | None = None, port: int | None = None) -> Iterator[Peer]:
    """A server; leaving the block breaks its connections, as a killed one does."""
    kept, port = kept or Kept(), port or free_port()
    config = uvicorn.Config(app(kept), port=port, log_level="critical", lifespan="off", ws="none")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.005)
    try:
        yield Peer(f"http://127.0.0.1:{port}", kept)
    finally:
        server.should_exit = server.force_exit = True
        thread.join()
