"""Server-sent events: what happens to an evaluation, from any number on, until it has ended."""

import json
import threading
import time
from pathlib import Path
from typing import Any

import httpx

from tests.server import ledgers
from tests.server.clients import (
    API,
    TestClient,
    Worker,
    create,
    ended,
    hub_of,
    served,
)


def events(answer: httpx.Response) -> list[tuple[str, str | None, dict[str, Any]]]:
    """Kind, number and payload of each server-sent event."""
    found = []
    for block in answer.text.replace("\r\n", "\n").strip().split("\n\n"):
        lines = [line.partition(": ")[::2] for line in block.split("\n") if line[0] != ":"]
        if fields := dict(lines):
            found.append((fields["event"], fields.get("id"), json.loads(fields["data"])))
    return found


def test_events_of_an_ended_evaluation_end(here: TestClient) -> None:
    hub = hub_of(here)
    id = ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=1)
    path = f"{API}/evaluations/{id}/events"

    answer = here.get(path)

    assert answer.headers["content-type"].startswith("text/event-stream")
    told = events(answer)
    numbered = [int(number) for _, number, _ in told if number]
    assert numbered == sorted(set(numbered))
    assert [kind for kind, number, _ in told if number] == [
        "evaluation", "evaluation", "episode", "episode", "attempt", "evaluation",
    ]  # fmt: skip
    assert told[-1][0] == "progress" and told[-1][2]["progress"]["final"] == 1
    last = here.get(f"{API}/evaluations/{id}").json()["last_event"]
    assert numbered[-1] == last

    after = [number for _, number, _ in events(here.get(path, params={"after": numbered[2]}))]
    resumed = events(here.get(path, headers={"Last-Event-ID": str(numbered[2])}))
    assert [int(one) for one in after if one] == numbered[3:]
    assert [int(number) for _, number, _ in resumed if number] == numbered[3:]


def test_a_follower_is_told_what_happens(tmp_path: Path) -> None:
    with served(tmp_path) as (hub, here):
        id = create(here, episodes=1)["id"]
        lines: list[str] = []
        began = threading.Event()

        def follow() -> None:
            with here.stream("GET", f"{API}/evaluations/{id}/events") as answer:
                for line in answer.iter_lines():
                    lines.append(line)
                    began.set()

        thread = threading.Thread(target=follow)
        thread.start()
        assert began.wait(10)
        worker = Worker(hub, here)
        worker.start(worker.episodes[0])
        worker.finish(worker.episodes[0])
        ended(hub, worker, None)
        thread.join(timeout=10)

        assert not thread.is_alive(), "the stream did not end"
    told = [json.loads(line[6:]) for line in lines if line.startswith("data: ")]
    assert [one["state"] for one in told if "reason" in one and "fence" not in one] == [
        "queued", "running", "completed",
    ]  # fmt: skip


def test_followers_take_nothing_from_other_requests(tmp_path: Path) -> None:
    """More followers than the ledger has connections."""
    with served(tmp_path) as (_, here):
        id = create(here)["id"]
        limits = httpx.Limits(max_connections=50)
        with httpx.Client(base_url=here.base_url, limits=limits, trust_env=False) as many:
            open_ones = []
            for _ in range(20):
                request = many.build_request("GET", f"{API}/evaluations/{id}/events")
                open_ones.append(many.send(request, stream=True))
            began = time.monotonic()
            answers = [here.get(f"{API}/evaluations/{id}").status_code for _ in range(3)]
            cancelled = here.post(f"{API}/evaluations/{id}/cancellation")
            for one in open_ones:
                one.read()

    assert answers == [200] * 3 and cancelled.status_code == 202
    assert time.monotonic() - began < 10
    assert all("cancelled" in one.text for one in open_ones)
