"""A typed client of the API, thin over httpx; it needs no server, simulator or torch beside it.

    with Client("https://evaluation.example.org", token="hide_…") as server:
        version = server.upload(Path("checkpoint.safetensors"), "mine")
        evaluation = server.evaluate(version.id, tasks=["search_drawer"])
        print(server.wait(evaluation.id).verdicts)

What may be sent twice is sent again when a connection breaks; what may not is never.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, Self, TypeVar
from urllib.parse import quote
from uuid import uuid4

import httpx
from httpx_sse import EventSource, SSEError
from pydantic import TypeAdapter, ValidationError

from server.schemas.common import Page
from server.schemas.episodes import (
    ChangePublic,
    DecisionPublic,
    EpisodeDetail,
    EpisodePublic,
    FailureGroup,
)
from server.schemas.evaluations import AttemptPublic, Batch, EvaluationPublic
from server.schemas.leaderboard import Leaderboard
from server.schemas.people import Me
from server.schemas.policies import PolicyCreate, PolicyDeclared, PolicyVersionPublic, UploadPublic
from server.schemas.tasks import TaskPublic
from server.states import ENDED
from workers.protocol import NamedPolicy

Answer = TypeVar("Answer")
Told = Callable[[int, int], None]  # of an upload: bytes that have come, of how many
LOCAL = "http://127.0.0.1:8000"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
API = "/api/v1"
TRIES = 5  # in a row, without anything coming of it: 4 s
PATIENT_TRIES = 12  # of who watches, perhaps while a server is updated: two minutes
LONGEST_WAIT = 30.0  # s between two tries
SILENCE = 60.0  # s without a byte of the events, which come every 15 s at least
PASSING = (502, 503, 504)  # statuses of a server that will do it later
REPEATABLE = ("GET", "HEAD", "PUT", "DELETE")


class ServerProblem(Exception):
    """The server said no (RFC 9457).

    Attributes:
        status: as HTTP.
        code: stable, for programs: `not_found`, `invalid`, `quota`, …
        detail: one sentence for people.
        errors: `{field, message}` of each field that is wrong.
    """

    def __init__(
        self, status: int, code: str, detail: str, errors: Sequence[Mapping[str, str]] = ()
    ):
        super().__init__(detail)
        self.status, self.code, self.detail, self.errors = status, code, detail, list(errors)


class Unreachable(ServerProblem):
    """There is no server, or its answers do not come through."""

    def __init__(self, detail: str):
        super().__init__(0, "unreachable", detail)


class Happening(NamedTuple):
    """Something that happened to an evaluation; `progress` has no number and is not kept."""

    kind: str
    number: int | None
    data: dict[str, Any]


class Client:
    """A server, as a program uses it.

    Args:
        server: its address.
        token: `hide_…`; a server of one's own machine asks for none.
        timeout: s without an answer.
        transport: for httpx, in place of the network.

    Raises:
        ValueError: the address is none, or the token cannot be one.
    """

    def __init__(
        self,
        server: str = LOCAL,
        token: str | None = None,
        *,
        timeout: float = 60.0,
        transport: httpx.BaseTransport | None = None,
    ):
        if token and not (token.isascii() and token.isprintable()):
            raise ValueError("the token is none of a server; they are like hide_3f9…_…")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        address = _address(server)
        self.http = httpx.Client(
            base_url=address,
            headers=headers,
            timeout=timeout,
            transport=transport,
            trust_env=address.host not in LOOPBACK,  # no proxy leads back here
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Lets go of the connections."""
        self.http.close()

    # --- who and what ---

    def me(self) -> Me:
        """Who asks, and how much of their quotas is used."""
        return self._get(Me, "/me")

    def tasks(self) -> list[TaskPublic]:
        """The suite's tasks."""
        return self._get(list[TaskPublic], "/tasks")

    def leaderboard(self, **wanted: Any) -> Leaderboard:
        """The leaderboard; `suite`, `split` and `verdict` may be given."""
        return self._get(Leaderboard, "/leaderboard", wanted)

    # --- policies ---

    def policies(self) -> list[PolicyVersionPublic]:
        """Every version of every policy."""
        return list(self._pages(Page[PolicyVersionPublic], "/policies", {}))

    def policy(self, name: str) -> PolicyVersionPublic:
        """One version, by id, name (the newest) or name@version."""
        return self._get(PolicyVersionPublic, f"/policies/{_part(name)}")

    def register(
        self,
        name: str,
        spec: NamedPolicy,
        description: str = "",
        *,
        declared: PolicyDeclared | None = None,
    ) -> PolicyVersionPublic:
        """A policy's next version: a built-in one, a class, a replay or a remote one."""
        wanted = PolicyCreate(name=name, description=description, spec=spec, declared=declared)
        document = wanted.model_dump(mode="json")
        return self._post(PolicyVersionPublic, "/policies", document, timeout=300.0)

    def upload(
        self,
        file: Path,
        name: str,
        description: str = "",
        *,
        told: Told = lambda *_: None,
    ) -> PolicyVersionPublic:
        """A checkpoint as a policy's next version; an upload that broke off before goes on.

        Raises:
            ServerProblem: it is refused; what came of it stays for a day.
            OSError: the file cannot be read.
        """
        from server.client_uploads import upload

        return upload(self, file, name, description, told)

    def uploads(self) -> list[UploadPublic]:
        """One's own uploads that are not done."""
        return self._get(list[UploadPublic], "/uploads")

    # --- evaluations ---

    def evaluate(self, policy: str, *, key: str | None = None, **wanted: Any) -> EvaluationPublic:
        """A queued evaluation. `wanted` is as in `server.schemas.EvaluationCreate`.

        Args:
            policy: name, name@version, or id.
            key: the same key and request again give the same evaluation; default: a new one.
        """
        headers = {"Idempotency-Key": key or uuid4().hex}
        document = {"policy": policy} | _given(wanted)
        return self._post(EvaluationPublic, "/evaluations", document, headers=headers, again=True)

    def evaluate_many(self, items: Sequence[Mapping[str, Any]]) -> Batch:
        """What became of up to 200 evaluations; one that cannot be does not hinder the others."""
        return self._post(Batch, "/batches", {"items": [dict(one) for one in items]})

    def evaluation(self, id: str) -> EvaluationPublic:
        """An evaluation as it stands."""
        return self._get(EvaluationPublic, f"/evaluations/{_part(id)}")

    def evaluations(self, **wanted: Any) -> Iterator[EvaluationPublic]:
        """Evaluations, the newest first; `state` and `policy` may be given."""
        return self._pages(Page[EvaluationPublic], "/evaluations", wanted)

    def attempts(self, evaluation: str) -> list[AttemptPublic]:
        """Every try at one of its shards, the newest first."""
        path = f"/evaluations/{_part(evaluation)}/attempts"
        return list(self._pages(Page[AttemptPublic], path, {}))

    def failures(self, evaluation: str) -> list[FailureGroup]:
        """How many of its episodes failed in which way."""
        return self._get(list[FailureGroup], f"/evaluations/{_part(evaluation)}/failures")

    def cancel(self, evaluation: str) -> EvaluationPublic:
        """Stops it; what is final stays. Asking twice is fine."""
        path = f"/evaluations/{_part(evaluation)}/cancellation"
        return self._post(EvaluationPublic, path, None, again=True)

    def resume(self, evaluation: str) -> EvaluationPublic:
        """Plays what an incomplete evaluation lacks."""
        return self._post(EvaluationPublic, f"/evaluations/{_part(evaluation)}/resumption", None)

    def events(self, evaluation: str, after: int = 0) -> Iterator[Happening]:
        """What happens to it from a number on, until it has ended; broken connections go on.

        Raises:
            ServerProblem: there is no such evaluation, or the server stays away.
        """
        self.evaluation(evaluation)  # what is wrong from the start is said at once
        tries = 0
        while True:
            why: object = "the events broke off"
            try:
                for one in self._stream(evaluation, after):
                    after, tries = one.number or after, 0
                    yield one
                stands = self.evaluation(evaluation)
                if stands.state in ENDED and stands.last_event <= after:
                    return
            except (httpx.TransportError, SSEError, Unreachable) as error:
                why = error
            tries = self.next_try(tries, why, most=PATIENT_TRIES)

    def _stream(self, evaluation: str, after: int) -> Iterator[Happening]:
        headers = {
            "Accept": "text/event-stream",
            "Cache-Control": "no-store",
            "Last-Event-ID": str(after),
        }
        path = f"{API}/evaluations/{_part(evaluation)}/events"
        with self.http.stream("GET", path, headers=headers, timeout=SILENCE) as answer:
            if answer.status_code in PASSING:
                raise httpx.ReadError(f"the server answered {answer.status_code}")
            if answer.is_error:
                answer.read()
                refuse(answer)
            for one in EventSource(answer).iter_sse():
                if one.data:
                    # An event without an id has that of the one before it.
                    number = None if one.event == "progress" else int(one.id)
                    yield Happening(one.event, number, one.json())

    def wait(
        self, evaluation: str, told: Callable[[Happening], None] = lambda _: None
    ) -> EvaluationPublic:
        """The evaluation once it has ended: completed, incomplete or cancelled."""
        for one in self.events(evaluation):
            told(one)
        return self.evaluation(evaluation)

    # --- episodes ---

    def episodes(self, evaluation: str | None = None, **wanted: Any) -> Iterator[EpisodePublic]:
        """Episodes of one evaluation, or of all; filtered as the API filters them."""
        path = f"/evaluations/{_part(evaluation)}/episodes" if evaluation else "/episodes"
        return self._pages(Page[EpisodePublic], path, wanted)

    def episode(self, id: str) -> EpisodeDetail:
        """One episode: verdicts, hashes, timing."""
        return self._get(EpisodeDetail, f"/episodes/{_part(id)}")

    def decisions(self, episode: str) -> list[DecisionPublic]:
        """Every decision with the hidden state after it."""
        return self._get(list[DecisionPublic], f"/episodes/{_part(episode)}/decisions")

    def changes(self, episode: str) -> list[ChangePublic]:
        """The hidden state at the start and after each of its changes."""
        return self._get(list[ChangePublic], f"/episodes/{_part(episode)}/changes")

    def save(self, path: str, file: Path, **query: Any) -> int:
        """Writes what is at a path of the server to a file, whole or not at all; its bytes.

        Args:
            path: such as an episode's `recording`.
        """
        part = file.with_name(f"{file.name}.part")
        try:
            with part.open("wb") as writing:
                for piece in self.pieces(path, **query):
                    writing.write(piece)
            part.replace(file)
        finally:
            part.unlink(missing_ok=True)
        return file.stat().st_size

    def pieces(self, path: str, **query: Any) -> Iterator[bytes]:
        """What is at a path of the server, as it comes.

        Raises:
            ServerProblem: it said no, or broke off.
        """
        try:
            with self.http.stream("GET", path, params=_given(query)) as answer:
                if answer.is_error:
                    answer.read()
                    refuse(answer)
                yield from answer.iter_bytes()
        except httpx.TransportError as error:
            raise Unreachable(f"{self.http.base_url} broke off: {error or type(error)}") from None

    # --- how it is asked ---

    def _get(self, kind: type[Answer], path: str, query: Mapping[str, Any] | None = None) -> Answer:
        return _read(kind, self.ask("GET", path, params=_given(query or {})))

    def _post(self, kind: type[Answer], path: str, document: Any, **how: Any) -> Answer:
        return _read(kind, self.ask("POST", path, json=document, **how))

    def _pages(
        self, kind: type[Page[Answer]], path: str, wanted: Mapping[str, Any]
    ) -> Iterator[Answer]:
        cursor = None
        while True:
            query = {"limit": 200, **wanted, "cursor": cursor}
            page = self._get(kind, path, query)
            yield from page.items
            if (cursor := page.next) is None:
                return

    def ask(
        self, method: str, path: str, *, again: bool | None = None, **how: Any
    ) -> httpx.Response:
        """The answer of a route of the API.

        Args:
            again: may it be asked twice? By default as the method says.

        Raises:
            ServerProblem: it said no.
            Unreachable: it did not answer.
        """
        repeat = method in REPEATABLE if again is None else again
        tries = 0
        while True:
            try:
                answer = self.http.request(method, API + path, **how)
            except httpx.TransportError as error:
                if not repeat and not isinstance(error, httpx.ConnectError):
                    raise Unreachable(f"{self.http.base_url}: {error or type(error)}") from None
                tries = self.next_try(tries, error)
                continue
            wait = _passes(answer, repeat)
            if wait is not None:
                tries = self.next_try(tries, answer, wait)
            elif answer.is_error:
                refuse(answer)
            else:
                return answer

    def next_try(
        self, tries: int, why: object, wait: float | None = None, most: int | None = None
    ) -> int:
        """Waits before one more try; how many there were.

        Raises:
            ServerProblem: it was the last one.
        """
        if tries + 1 >= (most or TRIES):
            if isinstance(why, httpx.Response):
                refuse(why)
            raise Unreachable(f"{self.http.base_url} cannot be reached: {why or type(why)}")
        time.sleep(wait or min(2.0**tries / 4, LONGEST_WAIT))
        return tries + 1


def _passes(answer: httpx.Response, repeat: bool) -> float | None:
    """Seconds after which it is worth to ask again; 0 if the server names none, None if never."""
    if answer.status_code not in (PASSING if repeat else ()) + (429,):
        return None
    told = answer.headers.get("retry-after", "")
    if not told.isdecimal():
        return None if answer.status_code == 429 else 0.0
    return float(told) if float(told) <= LONGEST_WAIT else None


def _address(server: str) -> httpx.URL:
    try:
        address = httpx.URL(server)
    except httpx.InvalidURL:
        address = httpx.URL()
    if address.scheme not in ("http", "https") or not address.host:
        raise ValueError(f"{server} is no address such as {LOCAL}.")
    return address


def _part(id: str) -> str:
    return quote(id, safe="@")


def _given(wanted: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in wanted.items() if value is not None}


def _read(kind: type[Answer], answer: httpx.Response) -> Answer:
    try:
        return TypeAdapter(kind).validate_json(answer.content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ServerProblem(
            answer.status_code,
            "not_understood",
            f"The server answers what this version does not understand ({where}: {first['msg']}); "
            "its address may be wrong, or hide-seek is to be updated.",
        ) from None


def refuse(answer: httpx.Response) -> NoReturn:
    """Raises what an answer says.

    Raises:
        ServerProblem: in any case.
    """
    try:
        told = answer.json()
        code, detail, errors = told["code"], told["detail"], told.get("errors", [])
    except (ValueError, KeyError, TypeError):
        code, detail, errors = "refused", f"{answer.url}: {answer.reason_phrase}.", []
    raise ServerProblem(answer.status_code, code, detail, errors)
