"""Comparing policies and ablations in a real browser: chosen, read, followed to the episodes."""

from collections.abc import Iterator
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from hide_tasks.contract import EpisodeSpec, Failure
from tests.chromium import CHROMIUM
from tests.server import ledgers
from tests.web import sites
from tests.web.browsing import WIDTHS, opened, serving

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]
MODELS = {"whole": "seek-small", "short": "seek-small/length_0", "base": "sam2act-small"}
THREE = "/comparisons?policy=whole&policy=short&policy=base"


def failing(below: int) -> ledgers.Outcomes:
    """Every episode with a smaller index fails."""

    def outcome(spec: EpisodeSpec) -> Failure | None:
        return Failure.WRONG_RECALL if spec.index < below else None

    return outcome


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    app = sites.empty(tmp_path_factory.mktemp("site"))
    hub = app.state.hub
    for place, (name, model) in enumerate(MODELS.items()):
        ledgers.uploaded(hub.database, hub.blobs, name, b"weights", model=model)
        ledgers.evaluated(hub.database, hub.blobs, name, failing(3 + 6 * place))
    with serving(app) as found:
        yield found


def faults(page: Page) -> list[str]:
    """What axe finds serious or critical."""
    found: list[dict[str, Any]] = Axe().run(page).response["violations"]
    grave = [one for one in found if one["impact"] in ("serious", "critical")]
    return [f"{one['id']}: {[node['target'] for node in one['nodes']][:3]}" for one in grave]


def test_policies_are_typed_compared_taken_out_and_followed_without_scripts(
    address: str, browser: Browser
) -> None:
    with opened(browser, address, WIDTHS["desk"], java_script_enabled=False) as page:
        page.goto(f"{address}/comparisons")
        page.get_by_label("Policy 1").fill("whole")
        page.get_by_label("Policy 2").fill("short")
        page.get_by_label("Policy 2").press("Enter")
        page.get_by_role("link", name="Add base@1").click()
        assert page.get_by_role("heading", name="Every pair").is_visible()
        page.get_by_role("link", name="Remove short").click()
        page.get_by_role("link", name="180 only A").click()

        page.locator("select[name=task]").select_option("search_drawer")
        page.get_by_role("button", name="Show").click()
        assert page.get_by_role("link", name="side by side").count() == 12
        page.get_by_role("link", name="search_drawer 3 side by side").click()

        assert "/episodes/ep_" in page.url and "beside=ep_" in page.url


def test_the_grid_is_walked_by_keyboard_alone(address: str, browser: Browser) -> None:
    with opened(browser, address, WIDTHS["desk"]) as page:
        page.goto(f"{address}{THREE}&which=differ&task=search_drawer#episodes")
        first = page.locator(".episode-grid a").first
        first.focus()
        page.keyboard.press("Tab")
        focused = page.evaluate("document.activeElement.querySelector('title').textContent")
        page.keyboard.press("Enter")
        page.wait_for_url("**/episodes/ep_*")

    assert focused == "search_drawer 4: A managed it"


@pytest.mark.parametrize(("width", "scheme"), [("desk", "light"), ("phone", "dark")])
def test_they_fit_and_axe_finds_nothing_serious(
    address: str, browser: Browser, width: str, scheme: str
) -> None:
    found = {}
    with opened(browser, address, WIDTHS[width], color_scheme=scheme) as page:
        for path in (THREE, f"{THREE}&which=only_a&category=HSR", "/ablations"):
            page.goto(address + path)
            overflow = page.evaluate("document.documentElement.scrollWidth - innerWidth")
            assert overflow <= 0, path
            found[path] = faults(page)

    assert {path: some for path, some in found.items() if some} == {}
