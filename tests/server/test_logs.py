"""What a server says: lines for people, or JSON lines for programs."""

import io
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from datetime import datetime, timedelta
from typing import Any

from server import logs
from tests.server.clients import API, TestClient, create


@contextmanager
def listening() -> Iterator[io.StringIO]:
    """What is said on standard error; afterwards everything speaks as before."""
    root, stream = logging.getLogger(), io.StringIO()
    before = root.handlers[:], root.level
    root.handlers[:] = []  # pytest's own
    try:
        with redirect_stderr(stream):
            yield stream
    finally:
        root.handlers[:] = before[0]
        root.setLevel(before[1])
        for name in logs.OURS:
            logging.getLogger(name).setLevel(logging.NOTSET)


def lines(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def test_every_line_is_a_document() -> None:
    with listening() as said:
        logs.configure("json", None)
        logging.getLogger("server.x").info("Two\nlines", extra={"attempt": "at_1", "left": 3})
        try:
            raise OSError("disk")
        except OSError:
            logging.getLogger("workers.y").exception("It failed")

    first, second = lines(said)
    assert first | {"time": ""} == {
        "time": "", "level": "INFO", "logger": "server.x", "message": "Two\nlines",
        "attempt": "at_1", "left": 3,
    }  # fmt: skip
    assert datetime.fromisoformat(first["time"]).utcoffset() == timedelta(0)
    assert second["level"] == "ERROR" and "OSError: disk" in second["exc_info"]


def test_people_read_a_sentence_and_its_facts() -> None:
    with listening() as said:
        announce = logs.configure("text", None)
        logging.getLogger("server.x").info("Nobody reads this")
        logging.getLogger("server.x").warning("Attempt lost", extra={"attempt": "at_1"})
        announce("http://127.0.0.1:8000")

    first, second = said.getvalue().splitlines()
    assert first.endswith("WARNING Attempt lost attempt=at_1")
    assert second == "HIDE-SEEK: http://127.0.0.1:8000 (Ctrl-C stops)"


def test_other_libraries_only_warn() -> None:
    with listening() as said:
        logs.configure("json", "DEBUG")
        logging.getLogger("alembic").info("Context impl")
        logging.getLogger("server").debug("This is wanted")

    assert [line["message"] for line in lines(said)] == ["This is wanted"]


def test_the_address_is_a_line_as_well() -> None:
    with listening() as said:
        logs.configure("json", None)("http://127.0.0.1:8000")

    assert lines(said)[0]["url"] == "http://127.0.0.1:8000"


def test_requests_and_the_life_of_an_evaluation_are_told(here: TestClient) -> None:
    with listening() as said:
        logs.configure("json", None)
        id = create(here)["id"]
        here.get(f"{API}/nowhere")

    told = lines(said)
    [begun] = [line for line in told if line.get("evaluation") == id]
    answered = {line["path"]: line for line in told if "status" in line}
    assert (begun["event"], begun["facts"]["state"]) == ("evaluation", "queued")
    assert answered[f"{API}/evaluations"]["status"] == 202
    assert answered[f"{API}/nowhere"]["status"] == 404
    assert answered[f"{API}/evaluations"]["seconds"] >= 0
