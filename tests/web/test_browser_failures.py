"""The page of failures in a real browser: keys, previews, labels, views, at desk and phone."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.chromium import CHROMIUM
from tests.server import ledgers
from tests.web import sites
from tests.web.browsing import WIDTHS, opened, serving

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]
TASKS = ["push_button_times", "search_drawer"]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server whose ledger has two evaluations with every failure."""
    app = sites.empty(tmp_path_factory.mktemp("failures"))
    hub = app.state.hub
    for name in ("mine", "theirs"):
        ledgers.registered(hub.database, name)
        ledgers.evaluated(hub.database, hub.blobs, name, sites.every_outcome(), tasks=TASKS)
    with serving(app) as found:
        yield found


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """An evaluation with a recorded episode, which has a preview, and its server."""
    app = sites.empty(tmp_path_factory.mktemp("recorded"))
    folder = tmp_path_factory.mktemp("recordings")
    evaluation = sites._recorded(app.state.hub, folder)
    with serving(app) as found:
        yield evaluation, found


def focused(page: Page) -> str | None:
    """The episode of the card that has the focus."""
    script = "document.activeElement?.closest('.card')?.dataset.episode ?? null"
    found: str | None = page.evaluate(script)
    return found


def shown(page: Page) -> list[str]:
    found: list[str] = page.eval_on_selector_all(".card", "all => all.map(c => c.dataset.episode)")
    return found


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_it_fits(browser: Browser, address: str, width: int, scheme: str) -> None:
    with opened(browser, address, width, color_scheme=scheme) as page:
        for query in ("", "?task=push_button_times", "?text=zebra"):
            page.goto(f"{address}/failures{query}")
            assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        page.goto(f"{address}/failures")
        for menu in page.locator("details.menu summary").all():
            menu.click()
            assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_keys_walk_the_cards_and_the_episodes(browser: Browser, address: str) -> None:
    with opened(browser, address, 1440) as page:
        page.goto(f"{address}/failures?task=search_drawer")
        first, second, _, fourth, *_ = shown(page)
        page.keyboard.press("j")
        assert focused(page) == first
        page.keyboard.press("j")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("k")
        assert focused(page) == second
        page.keyboard.press("ArrowUp")
        page.keyboard.press("ArrowDown")
        assert focused(page) == fourth  # three cards in a row

        page.keyboard.press("/")
        page.keyboard.type("jkx?")
        expect(page.locator("#search")).to_have_value("jkx?")
        page.keyboard.press("Escape")
        page.keyboard.press("?")
        expect(page.locator("#keys")).to_be_visible()
        page.keyboard.press("Escape")

        page.goto(f"{address}/failures?task=search_drawer&sort=task")
        first, second, *_ = shown(page)
        page.keyboard.press("j")
        page.keyboard.press("Enter")
        page.wait_for_url(f"**/episodes/{first}?*")
        page.keyboard.press("n")
        page.wait_for_url(f"**/episodes/{second}?*")
        page.keyboard.press("p")
        page.wait_for_url(f"**/episodes/{first}?*")
        page.locator(".crumbs a", has_text="search_drawer").click()
        page.wait_for_url("**/failures?*sort=task*")


def test_n_goes_on_to_more_and_p_back_to_the_first(browser: Browser, address: str) -> None:
    with opened(browser, address) as page:
        page.goto(f"{address}/failures")
        first = shown(page)
        page.keyboard.press("n")
        page.wait_for_url("**cursor=**")
        assert not set(first) & set(shown(page))
        page.keyboard.press("p")
        page.wait_for_url("**/failures#episodes")
        assert shown(page) == first


def test_a_label_and_a_note_are_added_and_taken_back(browser: Browser, address: str) -> None:
    with opened(browser, address) as page:
        page.goto(f"{address}/failures?failure=overcount")
        page.keyboard.press("j")
        page.keyboard.press("l")
        page.keyboard.type("Lost Count")
        page.keyboard.press("Tab")
        page.keyboard.type("<b>twice</b>")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        card = page.locator(".card").first
        expect(card.locator(".said .label")).to_have_text("lost-count")
        expect(card.locator(".said q")).to_have_text("<b>twice</b>")

        page.goto(f"{address}/failures?label=lost-count")
        expect(page.locator(".card")).to_have_count(1)
        expect(page.locator(".facet a", has_text="lost-count")).to_have_attribute(
            "aria-current", "true"
        )
        page.get_by_role("button", name="Take back lost-count").click()
        expect(page.locator(".said li")).to_have_count(0)
        page.reload()
        expect(page.locator(".empty h2")).to_have_text("No episode matches")


def test_selected_cards_are_labelled_at_once(browser: Browser, address: str) -> None:
    with opened(browser, address) as page:
        page.goto(f"{address}/failures?failure=undercount&task=search_drawer")
        chosen = shown(page)[:2]
        for _ in chosen:
            page.keyboard.press("j")
            page.keyboard.press("x")
        expect(page.locator("#label-many b")).to_have_text("2 selected")
        field = page.locator("#label-many input[name=label]")
        field.fill("Ä?")
        field.press("Enter")
        expect(page.locator("#label-many .error")).to_contain_text("small letters")
        field.fill("slow")
        field.press("Enter")
        expect(page.locator(".said .label")).to_have_text(["slow", "slow"])
        page.goto(f"{address}/failures?label=slow")
        assert shown(page) == chosen


def test_a_view_is_saved_found_again_and_forgotten(browser: Browser, address: str) -> None:
    options = {"permissions": ["clipboard-read", "clipboard-write"]}
    with opened(browser, address, **options) as page:
        page.goto(f"{address}/failures?task=search_drawer&failure=undercount")
        page.locator("#copy-link").click()
        expect(page.locator("#copied")).to_have_text("Copied")
        assert page.evaluate("navigator.clipboard.readText()") == page.url
        page.locator("#views summary").click()
        page.locator("#view-name").fill("<i>drawers</i>")
        page.locator("#view-name").press("Enter")

        page.goto(f"{address}/failures")
        page.locator("#views summary").click()
        page.locator("#saved-views a", has_text="<i>drawers</i>").click()
        page.wait_for_url("**/failures?task=search_drawer&failure=undercount")
        page.locator("#views summary").click()
        page.locator("#saved-views button").click()
        page.reload()
        assert page.locator("#saved-views li").count() == 0


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_a_still_moves_when_asked(browser: Browser, recorded: tuple[str, str], motion: str) -> None:
    evaluation, address = recorded
    with opened(browser, address, reduced_motion=motion) as page:
        page.goto(f"{address}/evaluations/{evaluation}/failures?verdict=all")
        image = page.locator(".card img")
        image.hover()
        moves = "preview.webp" in (image.get_attribute("src") or "")
        assert moves == (motion == "no-preference")
        page.mouse.move(0, 0)
        expect(image).to_have_attribute("src", re.compile("thumbnail"))
        page.locator(".play").click()
        page.mouse.move(0, 0)
        expect(image).to_have_attribute("src", re.compile("preview"))
        page.locator(".play").click()
        page.mouse.move(0, 0)
        expect(image).to_have_attribute("src", re.compile("thumbnail"))


def test_without_javascript_facets_and_search_work(browser: Browser, address: str) -> None:
    with opened(browser, address, java_script_enabled=False) as page:
        page.goto(f"{address}/failures")
        page.locator(".facet a", has_text="undercount").click()
        page.locator("#search").fill("search_drawer")
        page.locator("#search").press("Enter")
        assert "failure=undercount" in page.url and "text=search_drawer" in page.url
        assert page.locator(".card").count() > 0
        assert page.locator(".say:visible, .play:visible, #views:visible").count() == 0
