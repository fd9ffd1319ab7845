"""The pages in a real browser: whole at every width, quiet, and the replay in step."""

import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page

from server import lifecycle
from server.commit import commit
from server.models import Attempt, Episode
from server.states import EpisodeState
from tests.chromium import CHROMIUM
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.server import ledgers
from tests.web.browsing import WIDTHS, opened, until
from tests.web.pages import paths
from tests.web.sites import Site
from workers.protocol import INTERNAL

STATE = """async () => {
    const state = await document.querySelector("#viewer").viewer?.get_state();
    const plain = (_, value) => typeof value === "bigint" ? Number(value) : value;
    return state && JSON.parse(JSON.stringify(state, plain));
}"""
VALUE = "Number(document.querySelector('#timeline').getAttribute('aria-valuenow'))"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_every_page_fits_and_is_quiet(
    served: tuple[Site, str], browser: Browser, width: int, scheme: str
) -> None:
    site, address = served
    with opened(browser, address, width, color_scheme=scheme) as page:
        for path in paths(site):
            page.goto(address + path)
            page.wait_for_timeout(50)

            overflow = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            assert overflow <= 0, path
            assert page.evaluate("document.styleSheets.length") >= 2


def test_a_form_that_is_wrong_says_so_beside_the_field(
    served: tuple[Site, str], browser: Browser
) -> None:
    _, address = served
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{address}/evaluations/new")
    page.fill("#episodes", "1000")

    page.click("text=Start")
    page.wait_for_selector("[role=alert]:visible")

    assert page.inner_text("#episodes-error")
    assert page.get_attribute("#episodes", "aria-invalid") == "true"
    context.close()


def upload(page: Page, address: str, name: str, content: bytes) -> None:
    """Fills in the form and sends it, by the keyboard."""
    page.goto(f"{address}/evaluations/new")
    page.focus("[name=source]:checked")
    page.keyboard.press("ArrowRight")
    page.fill("#name", name)
    page.set_input_files("#file", {"name": "a.safetensors", "mimeType": "", "buffer": content})
    page.focus("#upload [type=submit]")
    page.keyboard.press("Enter")


def test_a_checkpoint_is_uploaded_and_chosen(
    served: tuple[Site, str], browser: Browser, tmp_path: Path
) -> None:
    _, address = served
    content = tiny_checkpoint(tmp_path / "a.safetensors").read_bytes()
    with opened(browser, address, WIDTHS["phone"]) as page:
        upload(page, address, "uploaded", content)
        page.wait_for_selector("#kept:has-text('uploaded@1 is kept')", timeout=120_000)

        assert page.input_value("#policy") == "uploaded@1"
        assert page.evaluate("document.activeElement.id") == "policy"
        assert "uploaded@1" in page.inner_text("#policies")
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        page.fill("#episodes", "1")
        page.click("text=Start")
        page.wait_for_url("**/evaluations/ev*")


def test_a_file_that_is_no_checkpoint_says_so_beside_it(
    served: tuple[Site, str], browser: Browser
) -> None:
    _, address = served
    context = browser.new_context()
    page = context.new_page()

    upload(page, address, "wrong", b"not a checkpoint at all")
    page.wait_for_selector("#upload [role=alert]:visible")

    assert "no safetensors file" in page.inner_text("#file-error")
    assert page.get_attribute("#file", "aria-invalid") == "true"
    assert page.is_enabled("#upload [type=submit]")
    assert page.is_hidden("#upload progress")
    context.close()


def test_a_built_in_policys_name_is_not_sent(served: tuple[Site, str], browser: Browser) -> None:
    _, address = served
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new?upload=true")
        page.fill("#name", "expert")

        assert page.evaluate("document.querySelector('#name').validity.patternMismatch")
        page.fill("#name", "experts")
        assert page.evaluate("document.querySelector('#name').validity.valid")


def test_an_evaluation_is_started_and_cancelled(served: tuple[Site, str], browser: Browser) -> None:
    _, address = served
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new?policy=noop")
        page.check("input[value=some]")
        page.check("input[name=tasks][value=reopen_drawer]")
        page.fill("#episodes", "3")
        page.click("text=Start")
        page.wait_for_url("**/evaluations/ev*")
        assert page.locator(".cell.pending:is(a)").count() == 3

        page.on("dialog", lambda dialog: dialog.accept())
        page.click("text=Cancel")
        page.wait_for_selector(".state.cancelled")


def test_cells_change_while_episodes_finish(served: tuple[Site, str], browser: Browser) -> None:
    site, address = served
    [running] = site.episodes(site.running, state=EpisodeState.RUNNING)
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/{site.running}")
        page.wait_for_selector(f"#cell-{running}.running")
        before = page.inner_text('[data-progress="final"]')
        page.wait_for_timeout(500)

        with site.hub.database.writing() as session:
            episode = session.get_one(Episode, running)
            attempt = (
                session.query(Attempt).filter_by(shard_id=episode.shard_id, state="open").one()
            )
            what = ledgers.result_of(lifecycle.spec_of(episode))
            commit(session, site.hub.blobs, attempt, episode, what)

        page.wait_for_selector(f"#cell-{running}.exact", timeout=10_000)
        until(page, f"document.querySelector('[data-progress=final]').textContent !== '{before}'")


# --- the replay ---


def replay(site: Site, address: str) -> str:
    [id] = site.episodes(site.recorded)
    return f"{address}/episodes/{id}"


def test_the_replay_is_in_step_with_the_timeline(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, 900) as page:
        page.goto(replay(site, address))
        until(page, f"({STATE})().then(state => state?.recordings[0]?.current_time)")

        page.focus("#timeline")
        for _ in range(3):
            page.keyboard.press("ArrowRight")
        third = page.evaluate(VALUE)
        shown = until(
            page,
            f"({STATE})().then(state => Math.abs(state.recordings[0].current_time.time / 1e9"
            f" - {third}) < 1e-3 && state)",
        )
        page.wait_for_timeout(3000)
        reports = [view["reports"] for view in page.evaluate(STATE)["views"]]

        row = page.get_attribute("[data-decision='3'] .seek", "data-seek")
        assert third == pytest.approx(float(row or 0), abs=1e-3)
        assert "decision 3" in (page.get_attribute("#timeline", "aria-valuetext") or "")
        assert "presses done" in (page.get_attribute("#timeline", "aria-valuetext") or "")
        assert page.locator("tr.now").get_attribute("data-decision") == "3"
        assert shown["recordings"][0]["play_state"] == "paused"
        assert {"Scene", "front", "wrist"} <= {view["name"] for view in shown["views"]}
        assert [report for one in reports for report in one] == []

        to = '{timeline: "time", duration_nanos: 1e9, play_state: "paused"}'
        page.evaluate(f"document.querySelector('#viewer').viewer.set_time({to})")
        until(page, f"Math.abs({VALUE} - 1) < 1e-3")


class SlowWorker(threading.Thread):
    """Plays an episode: sends half of its recording, and the rest when it may."""

    def __init__(self, site: Site, address: str):
        super().__init__(daemon=True)
        self.may_end = threading.Event()
        [recorded] = site.episodes(site.recorded)
        with site.hub.database.writing() as session:
            sha256 = session.get_one(Episode, recorded).recording
            wanted = {"tasks": ["push_button_times"], "episodes": 1, "split": "val"}
            ledgers.created(session, "noop", priority=100, **wanted)
            shard = lifecycle.next_shard(session)
            assert sha256 and shard
            attempt, token = lifecycle.lease(session, shard, engine="local")
            self.attempt, self.episode = attempt.id, lifecycle.open_episodes(shard)[0].id
        self.content = site.hub.blobs.path(sha256).read_bytes()
        url = f"{address}{INTERNAL}/attempts/{self.attempt}/episodes/{self.episode}"
        self.client = httpx.Client(headers={"Authorization": f"Bearer {token}"}, trust_env=False)
        self.client.post(f"{url}/start").raise_for_status()
        self.recording = f"{url}/recording"
        self.start()

    def run(self) -> None:
        self.client.put(self.recording, content=self.pieces(), timeout=120).raise_for_status()

    def pieces(self) -> Iterator[bytes]:
        half = len(self.content) // 2
        yield self.content[:half]
        self.may_end.wait(100)
        yield self.content[half:]


def test_a_running_episode_is_shown_while_it_is_played(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    worker = SlowWorker(site, address)
    try:
        with opened(browser, address, 640) as page:
            page.goto(f"{address}/episodes/{worker.episode}")
            begun = "state?.recordings[0]?.current_time && state"
            seen = until(page, f"({STATE})().then(state => {begun})")
            assert worker.is_alive()  # half of it is here
            assert seen["recordings"][0]["play_state"] in ("following", "playing")

            worker.may_end.set()
            worker.join(20)
            with site.hub.database.writing() as session:
                episode = session.get_one(Episode, worker.episode)
                attempt = session.get_one(Attempt, worker.attempt)
                what = ledgers.result_of(lifecycle.spec_of(episode))
                commit(session, site.hub.blobs, attempt, episode, what)
            page.wait_for_selector("#over:visible", timeout=20_000)
    finally:
        worker.may_end.set()
        worker.join(20)
        worker.client.close()


def test_a_browser_without_webassembly_is_offered_the_recording(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    context = browser.new_context()
    page = context.new_page()
    page.add_init_script("delete window.WebAssembly")

    page.goto(replay(site, address))
    page.wait_for_selector("#no-viewer:visible", timeout=20_000)

    with page.expect_download() as download:
        page.click("#no-viewer a")
    assert download.value.suggested_filename == "push_button_times-val-000.rrd"
    assert page.is_hidden("#viewer")
    context.close()


def test_previous_and_next_are_keys(served: tuple[Site, str], browser: Browser) -> None:
    site, address = served
    first, second, *_ = site.episodes(site.completed)
    with opened(browser, address) as page:
        page.goto(f"{address}/episodes/{first}")

        page.keyboard.press("n")
        page.wait_for_url(f"**/episodes/{second}")
        page.keyboard.press("p")
        page.wait_for_url(f"**/episodes/{first}")
