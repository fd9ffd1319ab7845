"""An episode's page in a real browser: everything follows the moment, viewer or not."""

from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page

from tests.chromium import CHROMIUM
from tests.web import sites
from tests.web.browsing import WIDTHS, opened, until
from tests.web.sites import Site
from tests.web.test_browser import STATE, VALUE

BLIND = "delete window.WebAssembly"  # no viewer, and none to wait for
SHOWN = "document.querySelector('[data-memory]:not([hidden])').dataset.memory"
PICTURE = "document.querySelector('.camera img').getAttribute('src')"
NOW = "document.querySelector('#now').textContent"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def served(served: tuple[Site, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Site, str]:
    """Where two policies played an episode."""
    sites.recorded_run(served[0].hub, tmp_path_factory.mktemp("others"), "random")
    return served


def page_of(site: Site, address: str, query: str = "") -> str:
    [id] = site.episodes(site.recorded)
    return f"{address}/episodes/{id}{query}"


def listed(address: str) -> list[dict[str, Any]]:
    """Every episode of a task, by REST."""
    answer = httpx.get(
        f"{address}/api/v1/episodes?task=push_button_times&limit=200", trust_env=False
    )
    found: list[dict[str, Any]] = answer.raise_for_status().json()["items"]
    return found


def moment_of(page: Page, decision: int) -> float:
    return float(page.get_attribute(f"[data-decision='{decision}'] .seek", "data-seek") or 0)


def blind(page: Page, address: str) -> None:
    """Open a page whose browser cannot run the viewer, which it may say in the console."""
    page.add_init_script(BLIND)
    page.add_init_script("console.error = () => {}")
    page.goto(address)
    page.wait_for_selector("#no-viewer:visible", timeout=20_000)


def test_everything_follows_the_moment_by_keyboard_alone(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, 1200) as page:
        blind(page, page_of(site, address))
        for _ in range(6):
            page.keyboard.press("ArrowRight")

        assert page.evaluate(NOW) == "decision 6 of 8"
        assert page.evaluate(SHOWN) == "6"
        assert "/observations/6/front.jpg" in page.evaluate(PICTURE)
        assert page.locator("#decisions tr.now").get_attribute("data-decision") == "6"
        assert "believed stages done: ≠ 1" in (
            page.get_attribute("#timeline", "aria-valuetext") or ""
        )
        until(page, "location.search === '?at=6'", 5)

        page.keyboard.press("o")
        page.keyboard.press("4")
        page.keyboard.press("ArrowLeft")
        large = page.get_attribute("#large-picture", "src") or ""
        assert large.endswith("/observations/5/wrist.jpg")
        assert page.inner_text("#large-title") == "wrist camera"
        page.keyboard.press("Escape")
        page.keyboard.press("?")
        assert page.is_visible("#help")
        page.keyboard.press("Escape")
        page.keyboard.press("End")
        page.focus("#timeline")
        page.keyboard.press("End")
        assert page.evaluate(NOW) == "the end"
        assert "/observations/8/front.jpg" in page.evaluate(PICTURE)


def test_a_decision_that_took_no_time_is_shown_as_well(
    served: tuple[Site, str], browser: Browser
) -> None:
    _, address = served
    [other] = [one for one in listed(address) if one["policy"] == "random" and one["recording"]]
    with opened(browser, address, 1200) as page:
        blind(page, f"{address}/episodes/{other['id']}")
        moments = (page.get_attribute("#timeline", "data-moments") or "").split()
        assert len(set(moments)) < len(moments)  # some could not be reached

        for decision in range(1, len(moments)):
            page.keyboard.press("ArrowRight")
            named = f"decision {decision} of {len(moments) - 1}"
            assert page.evaluate(NOW) == (named if decision < len(moments) - 1 else "the end")
        for decision in range(len(moments) - 2, -1, -1):
            page.keyboard.press("ArrowLeft")
            assert page.evaluate(NOW) == f"decision {decision} of {len(moments) - 1}"


def test_it_plays_without_the_viewer_and_faster(served: tuple[Site, str], browser: Browser) -> None:
    site, address = served
    with opened(browser, address, 1200) as page:
        blind(page, page_of(site, address))
        page.select_option("#speed", "1")
        page.focus("#timeline")

        page.keyboard.press("Space")
        assert page.inner_text("#play") == "Pause"
        until(page, f"{VALUE} > 0.3", 10)
        page.keyboard.press("Space")
        assert page.inner_text("#play") == "Play"
        there = page.evaluate(VALUE)
        page.wait_for_timeout(300)
        assert page.evaluate(VALUE) == there

        page.select_option("#speed", "4")
        page.click("#play")
        until(page, f"{NOW} === 'the end'", 10)
        assert page.inner_text("#play") == "Play"


def test_a_moment_in_the_address_is_shown_at_once_and_works_without_a_script(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, java_script_enabled=False) as page:
        page.goto(page_of(site, address, "?at=3"))

        assert page.inner_text("#now") == "decision 3 of 8"
        assert page.locator("[data-memory]:not([hidden])").get_attribute("data-memory") == "3"
        page.click("#step-on")
        page.wait_for_url("**?at=4")
        assert "/observations/4/" in (page.get_attribute(".camera img", "src") or "")


@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_two_runs_stand_beside_each_other_and_move_together(
    served: tuple[Site, str], browser: Browser, width: int
) -> None:
    site, address = served
    with opened(browser, address, width) as page:
        blind(page, page_of(site, address))
        page.locator("body").press("c")
        page.wait_for_url("**beside=ep_**")
        page.wait_for_selector("#no-viewer:visible", timeout=20_000)

        page.focus("#other-timeline")
        for _ in range(2):
            page.keyboard.press("ArrowRight")
        assert page.evaluate(NOW) == "decision 2 of 8"
        assert page.inner_text("[data-place=there]") == "decision 2"
        page.focus("#timeline")
        page.keyboard.press("End")
        assert page.inner_text("[data-place=here]") == "the end"
        assert page.inner_text("[data-place=there]") == "decision 8"  # it has more
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        page.locator("body").press("c")
        page.wait_for_url(lambda url: "beside" not in url)
        assert page.evaluate(NOW) == "decision 1 of 8"
        page.locator("body").press("c")
        page.wait_for_url(lambda url: "beside" in url and "at=1" in url)


def test_a_command_is_copied_and_says_so(served: tuple[Site, str], browser: Browser) -> None:
    site, address = served
    permissions = ["clipboard-read", "clipboard-write"]
    with opened(browser, address, 1200, permissions=permissions) as page:
        blind(page, page_of(site, address))

        page.click("[data-copy=rerun-command]")

        page.wait_for_selector("[data-copy=rerun-command]:has-text('Copied')")
        said = page.evaluate("navigator.clipboard.readText()")
        assert said == "hide eval expert --tasks push_button_times --split val --index 0"


def test_the_viewer_may_show_decisions_or_play_and_the_page_follows(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, 900) as page:
        page.goto(page_of(site, address, "?at=2"))
        known = "state.recordings[0]?.current_time?.time"
        second = moment_of(page, 2)
        until(
            page, f"({STATE})().then(state => state && Math.abs({known} / 1e9 - {second}) < 1e-3)"
        )

        to = '{timeline: "decision", sequence: 5, play_state: "paused"}'
        page.evaluate(f"document.querySelector('#viewer').viewer.set_time({to})")
        until(page, f"{NOW} === 'decision 5 of 8'")
        assert page.evaluate(VALUE) == pytest.approx(moment_of(page, 5), abs=1e-3)

        page.locator("body").press("ArrowRight")  # the viewer stays on the timeline of decisions
        until(page, f"({STATE})().then(state => {known} === 6)")
        assert page.evaluate(NOW) == "decision 6 of 8"

        page.focus("#timeline")
        page.keyboard.press("Home")
        page.click("#play")
        until(page, f"{VALUE} > 0.5")
        until(page, f"({STATE})().then(state => state.recordings[0].play_state === 'playing')")
        page.click("#play")
        until(page, f"({STATE})().then(state => state.recordings[0].play_state === 'paused')")


def test_the_viewer_leaves_the_keys_to_the_page_and_stands_still(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, 900) as page:
        page.goto(page_of(site, address))
        until(page, f"({STATE})().then(state => state?.recordings[0]?.current_time)")
        page.wait_for_timeout(3000)  # in which it would play, and take the focus

        assert page.evaluate("document.activeElement.tagName") != "CANVAS"
        assert page.evaluate(NOW) == "decision 0 of 8"
        assert page.evaluate(f"({STATE})()")["recordings"][0]["play_state"] == "paused"
        page.keyboard.press("ArrowRight")
        assert page.evaluate(NOW) == "decision 1 of 8"
