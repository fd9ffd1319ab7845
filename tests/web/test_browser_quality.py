"""Every page for everybody: what axe finds, what jumps while it loads, what moves on its own."""

from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from tests.chromium import CHROMIUM
from tests.web.browsing import WIDTHS, opened
from tests.web.pages import pages, paths
from tests.web.sites import Site

PICTURES = Path(__file__).parents[2] / "build" / "pictures"  # to be looked at
STEADY = 0.02  # of the layout shift score, of which 0.1 is still called good
SHIFT = """() => new Promise((resolve) => {
    let total = 0;
    const add = (list) => list.getEntries().forEach((one) => (total += one.value));
    new PerformanceObserver(add).observe({ type: "layout-shift", buffered: true });
    setTimeout(() => resolve(total), 150);
})"""
MOVING = "document.getAnimations().filter((one) => one.playState === 'running').length"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]


def violations(page: Page) -> list[str]:
    """What axe finds serious or critical: the rule, and where."""
    found: list[dict[str, Any]] = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {one['help']} {[node['target'] for node in one['nodes']][:3]}"
        for one in found
        if one["impact"] in ("serious", "critical")
    ]


@pytest.mark.parametrize(("width", "scheme"), [("desk", "light"), ("phone", "dark")])
def test_axe_finds_nothing_serious(
    served: tuple[Site, str], browser: Browser, width: str, scheme: str
) -> None:
    site, address = served
    PICTURES.mkdir(parents=True, exist_ok=True)
    with opened(browser, address, WIDTHS[width], color_scheme=scheme) as page:
        found = {}
        for name, path in pages(site).items():
            page.goto(address + path)
            page.screenshot(path=PICTURES / f"{name}-{width}-{scheme}.png", full_page=True)
            found[path] = violations(page)

    assert {path: some for path, some in found.items() if some} == {}


def test_nothing_jumps_and_nothing_moves_for_who_wants_rest(
    served: tuple[Site, str], browser: Browser
) -> None:
    site, address = served
    with opened(browser, address, WIDTHS["desk"], reduced_motion="reduce") as page:
        for path in paths(site):
            page.goto(address + path)

            assert page.evaluate(SHIFT) <= STEADY, path
            assert page.evaluate(MOVING) == 0, path
