"""The leaderboard in a real browser: by keyboard, at every width, in every view."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.chromium import CHROMIUM
from tests.web import sites
from tests.web.browsing import WIDTHS, opened, serving

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]
VIEWS = ["/", "/?category=RC&sort=belief", "/?view=bars", "/?view=radar", "/?view=tasks"]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where a filled site is."""
    app = sites.empty(tmp_path_factory.mktemp("site"))
    with serving(app) as address:
        sites.filled(app, tmp_path_factory.mktemp("recordings"))
        yield address


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS.values(), ids=WIDTHS)
def test_every_view_fits_and_is_quiet(
    address: str, browser: Browser, width: int, scheme: str
) -> None:
    with opened(browser, address, width, color_scheme=scheme) as page:
        for path in [*VIEWS, "/snapshots/1?view=tasks"]:
            page.goto(address + path)

            assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, path


def test_policies_are_ticked_filtered_and_sorted_by_keyboard(
    address: str, browser: Browser
) -> None:
    with opened(browser, address, WIDTHS["desk"]) as page:
        page.goto(address)
        compare = page.get_by_role("button", name="Compare")
        assert compare.is_disabled()

        page.get_by_label("Choose mine@1").press("Space")
        assert compare.is_disabled() and page.get_by_role("button", name="Chart").is_enabled()
        page.get_by_label("Choose expert@1").press("Space")
        assert "2 ticked" in compare.inner_text()
        page.get_by_role("button", name="Chart").press("Enter")
        page.wait_for_url("**view=bars**")
        assert page.url == f"{address}/?view=bars&policy=mine%401&policy=expert%401"
        assert page.get_by_role("img", name="Success in percent, all tasks").is_visible()

        page.goto(address)
        page.get_by_role("link", name="belief").press("Enter")
        page.wait_for_url("**sort=belief")
        page.get_by_label("policy", exact=True).fill("min")
        page.get_by_label("policy", exact=True).press("Enter")
        page.wait_for_url("**search=min")
        assert page.url == f"{address}/?sort=belief&search=min"  # nothing that is empty
        assert page.locator("tbody .who input").count() == 1


def test_the_first_column_stays_while_the_table_scrolls(address: str, browser: Browser) -> None:
    for width in WIDTHS.values():
        with opened(browser, address, width) as page:
            page.goto(address)
            place = "document.querySelector('.board tbody th').getBoundingClientRect().left"
            before = page.evaluate(place)
            page.evaluate("document.querySelector('.scroll').scrollLeft = 300")

            assert page.evaluate(place) == before
