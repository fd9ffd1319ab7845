"""What a worker tells the server of its attempt; the only place that tries again."""

import contextlib
import random
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from types import TracebackType
from typing import Any, BinaryIO, Self

import httpx

from workers.protocol import EPISODE_FINAL, INTERNAL, Committed, EpisodeCommit, Fault, Stored

RETRY_FOR = 60.0  # s, from the first failure of a request on
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0  # s between two tries
POLL_EVERY = 0.1  # s between two looks at a growing file
PIECE = 2**18  # bytes read at once
LIMITS = httpx.Timeout(10.0, read=30.0, write=30.0)  # s; the server may have to wait for its disk
LONGEST_TEXT = 500  # characters of an error that are kept
LONGEST_REASON = 2000  # what a Fault may hold


class LedgerError(Exception):
    """The server did not take what it was told."""


class Stale(LedgerError):
    """Another attempt is the current one now; this one has nothing more to say."""


class AlreadyFinal(LedgerError):
    """This attempt has committed the episode before."""


class Refused(LedgerError):
    """The server answers that the request is wrong; trying again would not help."""


class Unreachable(LedgerError):
    """The server did not answer in time, however often it was asked."""


class Dropped(Exception):
    """Nobody wants the rest of a growing file."""


class GrowingFile:
    """A file that somebody else writes, `path` or until its end `path.*.part`; it only grows."""

    def __init__(self, path: Path):
        self.path = path
        self._over = threading.Event()  # finished or dropped
        self._dropped = threading.Event()

    def finish(self) -> None:
        """Everything is written."""
        self._over.set()

    def drop(self) -> None:
        """Nothing more is read; whoever reads gets Dropped."""
        self._dropped.set()
        self._over.set()

    def pause(self, seconds: float) -> None:
        """Returns after so many seconds.

        Raises:
            Dropped: nobody wants the file any more.
        """
        if self._dropped.wait(seconds):
            raise Dropped

    def pieces(self, answered: Callable[[], bool]) -> Iterator[bytes]:
        """All of it from the start, as it grows, or until whoever gets it answers.

        Raises:
            Dropped: nobody wants the file any more.
            FileNotFoundError: it is finished and is not there.
        """
        with self._opened() as file:
            finished = False
            while not finished:
                finished = self._finished(POLL_EVERY)
                while not answered() and (piece := file.read(PIECE)):
                    yield piece
                finished = finished or answered()

    def _opened(self) -> BinaryIO:
        while True:
            finished = self._finished(0.0)
            for path in [*self.path.parent.glob(f"{self.path.name}.*.part"), self.path]:
                with contextlib.suppress(FileNotFoundError):  # it just got its final name
                    return path.open("rb")
            if finished:
                raise FileNotFoundError(f"The recording {self.path.name} is not there.")
            self._finished(POLL_EVERY)

    def _finished(self, seconds: float) -> bool:
        """True if everything was written within so many seconds; ask before reading."""
        over = self._over.wait(seconds)
        self.pause(0.0)
        return over


class Answering:
    """Whether the server answers or hangs up while a request is still being sent to it."""

    def __init__(self) -> None:
        self._facts: Callable[[str], Any] | None = None  # of the connection

    def trace(self, event: str, facts: dict[str, Any]) -> None:
        """Take an event of httpcore's trace extension."""
        stream = facts.get("return_value")  # connected, then perhaps encrypted
        self._facts = getattr(stream, "get_extra_info", self._facts)

    def begun(self) -> bool:
        """True when there is something to read."""
        return bool(self._facts and self._facts("is_readable"))


class LedgerClient:
    """The server, as one attempt sees it; may be used from several threads.

    Args:
        server: where it is, e.g. http://127.0.0.1:8000.
        attempt: whose reports these are.
        token: of this attempt alone.
        retry_for: seconds, from a request's first failure on, in which it is tried again.

    Its methods raise Stale, Refused or Unreachable.
    """

    def __init__(self, server: str, attempt: str, token: str, *, retry_for: float = RETRY_FOR):
        self.retry_for = retry_for
        self._http = httpx.Client(
            base_url=f"{server.rstrip('/')}{INTERNAL}/attempts/{attempt}/",
            headers={"Authorization": f"Bearer {token}"},
            timeout=LIMITS,
            trust_env=False,  # workers and server are one system; no proxy stands between them
            limits=httpx.Limits(max_keepalive_connections=0),
        )

    def start(self, episode: str) -> None:
        """The episode begins."""
        self._tell("POST", f"episodes/{episode}/start")

    def upload_recording(self, episode: str, recording: GrowingFile) -> Stored:
        """Sends a recording while it is written; what the server keeps of it.

        Raises:
            Dropped, FileNotFoundError: there is no such recording, or nobody wants it.
        """
        answer = self._insist(lambda: self._put(episode, recording), recording.pause)
        return Stored.model_validate_json(answer.content)

    def commit(self, episode: str, commit: EpisodeCommit) -> Committed:
        """The episode is finished."""
        answer = self._tell("PUT", f"episodes/{episode}/result", commit.model_dump_json())
        return Committed.model_validate_json(answer.content)

    def fault(self, episode: str, reason: str) -> None:
        """The episode could not be played, through no fault of a policy."""
        fault = Fault(reason=reason[:LONGEST_REASON])
        self._tell("POST", f"episodes/{episode}/fault", fault.model_dump_json())

    def fetch_checkpoint(self, path: Path) -> None:
        """Writes the policy's checkpoint to a file; its hash is the caller's to check."""
        self._insist(lambda: self._get("checkpoint", path), sleep)

    def close(self) -> None:
        """Ends the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, episode: str, recording: GrowingFile) -> httpx.Response:
        answering = Answering()
        return self._http.put(
            f"episodes/{episode}/recording",
            content=recording.pieces(answering.begun),
            headers={"Content-Type": "application/octet-stream"},
            extensions={"trace": answering.trace},
        )

    def _get(self, what: str, path: Path) -> httpx.Response:
        with self._http.stream("GET", what) as answer, path.open("wb") as file:
            if not answer.is_success:
                answer.read()
                return answer
            for piece in answer.iter_bytes(PIECE):
                file.write(piece)
        return answer

    def _tell(self, method: str, path: str, json: str | None = None) -> httpx.Response:
        headers = {"Content-Type": "application/json"} if json is not None else {}
        return self._insist(
            lambda: self._http.request(method, path, content=json, headers=headers), sleep
        )

    def _insist(
        self, request: Callable[[], httpx.Response], wait: Callable[[float], None]
    ) -> httpx.Response:
        """The answer to a request that is repeated while the server cannot be reached."""
        pause, deadline = FIRST_PAUSE, None
        while True:
            began = monotonic()
            try:
                answer = request()
                if answer.status_code < 500:
                    return _accepted(answer)
                problem = _text(answer)
            except httpx.TransportError as error:
                problem = f"{type(error).__name__}: {error}"
            if deadline is None or monotonic() - began > self.retry_for:  # it went well for long
                pause, deadline = FIRST_PAUSE, monotonic() + self.retry_for
            if monotonic() + pause > deadline:
                raise Unreachable(
                    f"{self._http.base_url.host} did not answer for {self.retry_for:g} s: {problem}"
                )
            wait(pause * random.uniform(0.5, 1.0))
            pause = min(2 * pause, LONGEST_PAUSE)


def _accepted(answer: httpx.Response) -> httpx.Response:
    if answer.is_success:
        return answer
    if answer.status_code == httpx.codes.CONFLICT and _code(answer) == EPISODE_FINAL:
        raise AlreadyFinal(_text(answer))
    if answer.status_code == httpx.codes.CONFLICT:
        raise Stale(_text(answer))
    raise Refused(_text(answer))


def _code(answer: httpx.Response) -> str | None:
    """What a problem is called, if the answer is one."""
    try:
        document = answer.json()
    except ValueError:
        return None
    return document.get("code") if isinstance(document, dict) else None


def _text(answer: httpx.Response) -> str:
    request = answer.request
    said = answer.text.strip()[:LONGEST_TEXT]
    return f"{request.method} {request.url.path} gave {answer.status_code}: {said}"
