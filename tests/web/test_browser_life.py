"""A policy's way through a real browser: connected, costed, started, watched, run again."""

import re
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser

from server import lifecycle
from server.commit import commit
from server.models import Attempt
from server.settings import Settings
from tests import viewer_files
from tests.chromium import CHROMIUM
from tests.server import ledgers
from tests.web.browsing import WIDTHS, opened, serving
from tests.workers.remote.peers import answering
from web.app import create_app
from workers.remote.maps import Declaration, everything

OURS = Declaration(model="recalls", observation=everything(), max_sessions=3).message()
ACTION = {"kind": "keyframe", "position": [0.3, 0.0, 0.9], "quaternion": [0, 1, 0, 0]}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]


@pytest.fixture
def app(tmp_path: Path) -> FastAPI:
    ledgers.laid(tmp_path)
    quiet = {"workers": 0, "references": False, "smoke": False, "trained": tmp_path / "none"}
    viewer_files.lay(tmp_path)
    return create_app(Settings(data=tmp_path, allow_remote=("127.0.0.1",), **quiet))


@pytest.fixture
def address(app: FastAPI) -> Iterator[str]:
    with serving(app) as found:
        yield found


def answer(message: dict[Any, Any]) -> dict[str, Any]:
    if message["endpoint"] == "reset":
        return {"ok": True}
    return {"request_id": message["request_id"], "action": ACTION}


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_a_policy_server_is_tested_registered_and_started_by_the_keyboard(
    address: str, browser: Browser, width: int
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        closed = listening.getsockname()[1]
    with answering(answer, OURS) as url, opened(browser, address, width) as page:
        page.goto(f"{address}/evaluations/new?source=server")
        page.focus("#server-url")
        page.keyboard.type(f"ws://127.0.0.1:{closed}")
        page.focus("[data-try]")
        page.keyboard.press("Enter")
        refused = page.wait_for_selector("[data-answer] li.failed", timeout=60_000)
        assert refused and "Nothing listens there" in refused.inner_text()
        assert page.is_disabled("#connect [type=submit]")
        assert page.inner_text("#start") == "Register it first"
        assert "of the policy that you connect" in page.inner_text("[data-cost=episodes]")

        page.route("**/policies/connection", lambda _: None, times=1)
        page.click("[data-try]")
        page.wait_for_selector("[data-answer]", state="hidden")
        page.goto(f"{address}/evaluations/new?source=server")

        page.fill("#server-url", url)
        page.fill("#server-name", "far")
        page.focus("[data-try]")
        page.keyboard.press("Enter")
        page.wait_for_selector("[data-answer] li:nth-child(3).passed", timeout=60_000)
        told = page.inner_text("[data-answer]")
        assert "recalls" in told and "a keyframe at (0.30, 0.00, 0.90) m" in told
        page.focus("#connect [type=submit]")
        page.keyboard.press("Enter")
        page.wait_for_selector("#kept:has-text('far@1 is kept')", timeout=60_000)
        assert page.input_value("#policy") == "far@1"
        assert page.evaluate("document.activeElement.id") == "policy"

        page.check("[name=category][value=smoke]")
        page.wait_for_selector("#start:has-text('Start 3 episodes')")
        assert "of far@1" in page.inner_text("[data-cost=episodes]")
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        page.focus("#start")
        page.keyboard.press("Enter")
        page.wait_for_url("**/evaluations/ev*")
        assert page.locator(".cell.pending:is(a)").count() == 3


def test_the_cost_follows_what_is_chosen_and_what_waits(
    app: FastAPI, address: str, browser: Browser
) -> None:
    database = app.state.hub.database
    with database.writing() as session:
        ledgers.created(session, "expert", tasks=["search_drawer"], episodes=10)
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new?policy=noop")
        page.wait_for_selector("#start:has-text('Start 375 episodes, 1 evaluation before it')")
        assert "enters it" in page.inner_text("[data-cost=ranked]")

        page.check("[name=category][value=RC]")
        page.fill("#episodes", "2")
        page.wait_for_selector("#start:has-text('Start 10 episodes')")
        assert "stays out of it" in page.inner_text("[data-cost=ranked]")
        assert "2 shards" in page.inner_text("[data-cost=before]")
        page.check("[name=category][value=some]")
        page.wait_for_selector("#start:has-text('Choose at least one task')")
        assert page.is_disabled("#start")
        assert "Choose at least one task" in page.inner_text("[data-cost=episodes]")
        page.check("[name=tasks][value=search_drawer]")
        page.wait_for_selector("#start:has-text('Start 2 episodes')")
        assert page.is_enabled("#start")
        with database.reading() as session:
            assert session.query(lifecycle.Evaluation).count() == 1


def test_a_file_is_dropped_on_the_page(address: str, browser: Browser) -> None:
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new")
        dropped = page.evaluate_handle(
            """() => {
                const data = new DataTransfer();
                data.items.add(new File(["x".repeat(2e6)], "my best.safetensors"));
                return data;
            }"""
        )
        page.dispatch_event("main", "dragover", {"dataTransfer": dropped})
        assert page.is_checked("[name=source][value=upload]")
        assert page.locator(".drop.over").count() == 1
        page.dispatch_event("main", "drop", {"dataTransfer": dropped})

        assert page.evaluate("document.querySelector('#file').files[0].name") == (
            "my best.safetensors"
        )
        assert page.input_value("#name") == "my best"
        assert "my best.safetensors, 2.0 MB" in page.inner_text(".drop")
        assert page.evaluate("document.activeElement.id") == "file"


def test_a_name_follows_the_file_until_somebody_gives_one(address: str, browser: Browser) -> None:
    def choose(name: str) -> None:
        page.set_input_files("#file", {"name": name, "mimeType": "", "buffer": b"x"})

    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new?source=upload")
        choose("first.safetensors")
        choose("second.pt")
        followed = page.input_value("#name")
        page.fill("#name", "mine")
        choose("third.pt")

        assert followed == "second"
        assert page.input_value("#name") == "mine"


def test_an_evaluation_is_watched_as_it_goes_and_run_again(
    app: FastAPI, address: str, browser: Browser
) -> None:
    hub = app.state.hub
    with hub.database.writing() as session:
        wanted = {"tasks": ["push_button_times", "search_drawer"], "episodes": 2, "priority": -3}
        id = ledgers.created(session, "noop", **wanted).id
    with opened(browser, address, WIDTHS["phone"]) as page:
        page.goto(f"{address}/evaluations/{id}")
        assert "1st in the queue" in page.inner_text("#live-now")
        assert page.is_hidden("#reason") and page.inner_text("#live-started") == "–"
        assert "without workers" in page.inner_text("#live-now")

        with hub.database.writing() as session:
            leased = ledgers.leased(session)
            assert leased
            attempt, shard = leased[0].id, leased[1]
            first, _ = lifecycle.open_episodes(shard)
            playing = first.id
            lifecycle.begin(session, leased[0], first)
        watch = page.wait_for_selector(f'#live-now a[href="/episodes/{playing}"]', timeout=20_000)
        assert watch and watch.inner_text().startswith("Watch")
        assert page.title().startswith("noop@1, running ·")
        assert page.locator("#live-started time").count() == 1
        assert "1 shard waits" in page.inner_text("#live-now")
        assert "1 shard is with a worker" in page.inner_text("#live-now")
        assert page.locator(f'.work a[href="/episodes/{playing}"] .running').count() == 1
        watch.focus()

        with hub.database.writing() as session:
            one = session.get_one(Attempt, attempt)
            episode = lifecycle.open_episodes(one.shard)[0]
            commit(session, hub.blobs, one, episode, ledgers.result_of(lifecycle.spec_of(episode)))
            lifecycle.begin(session, one, lifecycle.open_episodes(one.shard)[0])
        page.wait_for_selector(f'.work a[href="/episodes/{playing}"] .exact', timeout=20_000)
        assert re.search(r"_times 0: exact", page.inner_text("[data-log]"))
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0

        page.click("text=Rerun")
        page.wait_for_selector("#start:has-text('Start 4 episodes')")
        assert "As noop@1" in page.inner_text(".notice >> nth=0")
        assert page.input_value("#policy") == "noop@1"
        assert page.input_value("#priority") == "-3"
        assert page.locator("[name=tasks]:checked").count() == 2
        page.click("#start")
        page.wait_for_url(re.compile(rf"/evaluations/ev_(?!{id.removeprefix('ev_')})"))


def test_a_whole_evaluation_is_published(app: FastAPI, address: str, browser: Browser) -> None:
    hub = app.state.hub
    id = ledgers.evaluated(hub.database, hub.blobs, "expert")
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/{id}")
        page.on("dialog", lambda dialog: dialog.accept())
        page.click("text=Publish")
        page.wait_for_url("**/snapshots/1")
        page.go_back()
        page.reload()

        assert page.locator('.published a[href="/snapshots/1"]').count() == 1
        assert page.locator("button:has-text('Publish')").count() == 0


def test_the_demo_is_begun_by_one_click_and_leads_on(
    app: FastAPI, address: str, browser: Browser
) -> None:
    hub = app.state.hub
    with opened(browser, address) as page:
        page.goto(f"{address}/")
        page.click("text=Run the demo")
        page.wait_for_url("**/demo")
        assert page.locator(".demo tbody th").all_inner_texts() == ["expert", "amnesiac"]

        with hub.database.writing() as session:
            while ledgers.play_shard(session, hub.blobs):
                pass
        page.wait_for_selector("[data-done=yes]", timeout=20_000)
        page.click("text=Compare them")
        page.wait_for_url("**/comparisons?a=ev*")
        assert "expert" in page.inner_text("main")
