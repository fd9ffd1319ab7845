"""Measures pages as a browser has them: what is transferred, and when there is something to read.

Run it with: .venv/bin/python docs/measure_browser.py [EPISODES]
Cold is a browser that was never here, warm the same page once more. A page has useful content
when its largest element is drawn (largest contentful paint). Of the replay: from the click on an
episode to the first frame drawn. Medians of five. About half of the episodes are failures.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from docs.measure_pages import filled
from server.blobs import Blobs
from tests.chromium import CHROMIUM, FLAGS
from tests.server import ledgers
from tests.server.running import RunningServer

ROUNDS = 5
WIDTH = {"width": 1440, "height": 900}
SEEN = """() => new Promise((resolve) => {
    let drawn = 0, shifted = 0;
    const watch = (type, add) => new PerformanceObserver((list) => list.getEntries().forEach(add))
        .observe({ type, buffered: true });
    watch("largest-contentful-paint", (one) => (drawn = Math.max(drawn, one.startTime)));
    watch("layout-shift", (one) => (shifted += one.value));
    const patience = performance.now() + 5000;
    const tell = () => {
        if (!drawn && performance.now() < patience) return setTimeout(tell, 200);
        const all = ["navigation", "resource"].flatMap((t) => performance.getEntriesByType(t));
        const bytes = all.reduce((sum, one) => sum + one.transferSize, 0);
        resolve({ drawn, shifted, bytes, requests: all.length,
                  answer: performance.getEntriesByType("navigation")[0].responseStart });
    };
    setTimeout(tell, 400);
})"""
SHOWN = """document.querySelector("#viewer")?.viewer?.get_state().then(
    (state) => state?.recordings[0]?.current_time !== undefined)"""


class Seen(NamedTuple):
    """What a page took."""

    bytes: float
    requests: float
    answer: float  # ms until its first byte
    drawn: float  # ms until its largest element is there
    shifted: float  # layout shift score


def visit(page: Page, address: str) -> Seen:
    """Opens a page and says what it took."""
    page.goto(address)
    found: dict[str, float] = page.evaluate(SEEN)
    return Seen(**found)


def middle(seen: list[Seen]) -> Seen:
    """The medians of some visits."""
    return Seen(*(median(column) for column in zip(*seen, strict=True)))


@contextmanager
def fresh(browser: Browser) -> Iterator[BrowserContext]:
    """A browser that was never here."""
    context = browser.new_context(viewport=WIDTH)
    yield context
    context.close()


def measured(browser: Browser, address: str) -> tuple[Seen, Seen]:
    """Cold, and warm."""
    cold, warm = [], []
    for _ in range(ROUNDS):
        with fresh(browser) as context:
            page = context.new_page()
            cold.append(visit(page, address))
            warm.append(visit(page, address))
    return middle(cold), middle(warm)


def replay(browser: Browser, address: str, failures: str) -> tuple[float, float]:
    """Seconds from a click on an episode to its first frame: cold, and warm."""
    taken: tuple[list[float], list[float]] = ([], [])
    for _ in range(ROUNDS):
        with fresh(browser) as context:
            page = context.new_page()
            for kind in taken:
                page.goto(failures)
                began = time.perf_counter()
                page.click(f"a[href^='{address}']")
                until_shown(page)
                kind.append(time.perf_counter() - began)
    return median(taken[0]), median(taken[1])


def until_shown(page: Page) -> None:
    """Waits until the viewer has a frame."""
    while not page.evaluate(f"Promise.resolve({SHOWN}).catch(() => false)"):
        page.wait_for_timeout(20)


def pages(server: RunningServer) -> dict[str, str]:
    """The pages by name."""
    [done] = server.get("/evaluations", limit=1, state="completed", policy="model-007")["items"]
    [failed] = server.get("/episodes", evaluation=done["id"], exact=False, limit=1)["items"]
    versions = "&".join(f"policy=model-{n:03}" for n in range(4))
    return {
        "leaderboard": "/",
        "leaderboard, bars": "/?view=bars",
        "failures": "/failures",
        "failures of a task": "/failures?task=push_button_times",
        "failures, searched": "/failures?text=button",
        "evaluation": f"/evaluations/{done['id']}",
        "its failures": f"/evaluations/{done['id']}/failures",
        "episode without replay": f"/episodes/{failed['id']}",
        "comparison of two": "/comparisons?policy=model-001&policy=model-002",
        "comparison of four": f"/comparisons?{versions}",
        "ablations": "/ablations",
        "evaluations": "/evaluations",
        "new evaluation": "/evaluations/new",
        "tasks": "/tasks",
        "task": "/tasks/push_button_times",
    }


def recorded(server: RunningServer) -> dict[str, Any]:
    """An episode that the server's worker plays, with its recording."""
    wanted = {"policy": "expert", "tasks": ["push_button_times"], "episodes": 1, "split": "val"}
    id = server.post("/evaluations", wanted)["id"]
    server.finished(id)
    return dict(server.episodes(id)[0])


def told(name: str, cold: Seen, warm: Seen) -> None:
    """Prints a row."""
    for kind, one in (("cold", cold), ("warm", warm)):
        print(
            f"| {name} | {kind} | {one.bytes / 1000:.0f} | {one.requests:.0f} | {one.answer:.0f} "
            f"| {one.drawn:.0f} | {one.shifted:.3f} |",
            flush=True,
        )


def main(episodes: int) -> None:
    """Fills a ledger, opens every page, prints a table."""
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        data = Path(folder) / "data"
        database = ledgers.opened(data)
        filled(database, Blobs(data / "blobs"), episodes)
        database.close()
        launch: Callable[..., Browser] = playwright.chromium.launch
        browser = launch(executable_path=CHROMIUM, args=FLAGS)
        with RunningServer(data, "--no-references", workers=1) as server:
            one = recorded(server)
            print("| page | | kB | requests | answer, ms | content, ms | shift |")
            print("| --- | --- | --- | --- | --- | --- | --- |")
            for name, path in pages(server).items():
                told(name, *measured(browser, server.url + path))
            of_it = f"{server.url}/evaluations/{one['evaluation']}/failures?verdict=all"
            cold, warm = replay(browser, f"/episodes/{one['id']}", of_it)
            print(f"\nclick to the first frame of a replay: {cold:.1f} s cold, {warm:.1f} s warm")
        browser.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 22_500)
