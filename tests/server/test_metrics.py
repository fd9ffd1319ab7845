"""What Prometheus scrapes, read by its own parser."""

from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families as parse

from server import metrics
from tests.server import ledgers
from tests.server.clients import API, TestClient, Worker, create, hub_of, problem_of
from tests.server.people import peopled, token_of, visitor

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def scraped(client: TestClient) -> Samples:
    answer = client.get("/metrics")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].startswith("text/plain")
    return {
        (sample.name, frozenset(sample.labels.items())): sample.value
        for family in parse(answer.text)
        for sample in family.samples
    }


def value(samples: Samples, name: str, **labels: str) -> float:
    return samples[name, frozenset(labels.items())]


def test_the_queue_and_what_came_of_it(here: TestClient) -> None:
    create(here, episodes=7)  # two shards
    before = scraped(here)
    worker = Worker(hub_of(here), here)
    worker.start(worker.episodes[0])
    worker.finish(worker.episodes[0])
    worker.finish(worker.episodes[0])  # again: it is one
    after = scraped(here)

    assert value(before, "hide_shards", state="pending") == 2
    assert value(before, "hide_evaluations", state="queued") == 1
    assert value(before, "hide_open_episodes", state="pending") == 7
    assert value(after, "hide_shards", state="pending") == 1
    assert value(after, "hide_shards", state="leased") == 1
    assert value(after, "hide_attempts", state="open") == 1
    assert value(after, "hide_open_episodes", state="final") == 1
    done = {"task": "search_drawer", "success": "true"}
    assert value(after, "hide_episodes_committed_total", **done) == 1
    assert value(after, "hide_queue_age_seconds") == 0


def test_how_long_requests_take_is_told_by_route_not_by_path(here: TestClient) -> None:
    for number in range(3):
        here.get(f"{API}/evaluations/ev_{number}")
    here.get("/nowhere")

    found = scraped(here)

    asked = {"method": "GET", "route": "get_evaluation", "status": "404"}
    assert value(found, "hide_request_seconds_count", **asked) == 3
    assert not any("ev_1" in str(labels) for _, labels in found)
    unknown = {"method": "GET", "route": "none", "status": "404"}
    assert value(found, "hide_request_seconds_count", **unknown) == 1


def test_workers_disk_and_process(here: TestClient) -> None:
    found = scraped(here)

    assert value(found, "hide_worker_slots") == 0
    assert 0 < value(found, "hide_disk_free_bytes") < value(found, "hide_disk_size_bytes")
    assert value(found, "hide_ledger_bytes") > 4096
    assert value(found, "hide_reconciler_fault") == 0
    assert value(found, "process_resident_memory_bytes") > 10**7


def test_an_alarm_is_counted(here: TestClient) -> None:
    create(here)
    worker = Worker(hub_of(here), here)
    [episode, *_] = worker.episodes
    worker.start(episode)
    worker.finish(episode)
    other = ledgers.result_of(worker.specs[episode], ledgers.Failure.OVERCOUNT)

    assert worker.finish(episode, other).status_code == 409
    assert value(scraped(here), "hide_divergences") == 1


def test_openmetrics_if_the_scraper_likes_it_better(here: TestClient) -> None:
    accept = "application/openmetrics-text;version=1.0.0;q=0.5,text/plain;version=0.0.4;q=0.3"
    answer = here.get("/metrics", headers={"Accept": accept})

    assert answer.headers["content-type"].startswith("application/openmetrics-text")
    assert answer.text.endswith("# EOF\n")


def test_a_scraper_shows_a_token(tmp_path: Path) -> None:
    with peopled(tmp_path) as app:
        answer = visitor(app).get("/metrics")
        assert answer.status_code == 401
        assert problem_of(answer)["code"] == "not_signed_in"
        assert visitor(app, token_of(app, "viewer")).get("/metrics").status_code == 200


@pytest.mark.parametrize("table", ["evaluations", "shards", "attempts", "episodes"])
def test_no_table_is_read_from_end_to_end(here: TestClient, table: str) -> None:
    """A million episodes must not slow a scrape; SQLite tells how it would look for them."""
    seen: list[str] = []
    hub = hub_of(here)
    with hub.database.reading() as session:
        connection = session.connection().connection.driver_connection
        connection.set_trace_callback(seen.append)
        list(metrics._ledger(session))
        connection.set_trace_callback(None)
        plans = [
            str(row[3])
            for query in seen
            if query.startswith("SELECT")
            for row in connection.execute(f"EXPLAIN QUERY PLAN {query}").fetchall()
        ]

    scans = [plan for plan in plans if plan.startswith(f"SCAN {table}")]
    assert all("COVERING INDEX" in plan for plan in scans), scans
    assert table != "episodes" or not scans
