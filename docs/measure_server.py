"""Measures the server: pace against `hide eval`, recovery after kills, a replay in the browser.

Run it with: .venv/bin/python docs/measure_server.py [ROUNDS]
It takes about eight minutes a round; the machine should have nothing else to do.
"""

import sys
import time
from importlib.metadata import version
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.chromium import CHROMIUM, FLAGS
from tests.processes import command
from tests.server.running import RunningServer, kill, until
from workers.evaluation import Evaluation, evaluate
from workers.simulator_process import descendants

EPISODES = 20  # of each of three tasks
TASKS = ("push_button_times", "reopen_drawer", "search_drawer")
LAYOUT = f"/viewer/{version('rerun-sdk')}/layout.rbl"


def by_hide_eval(folder: Path, workers: int) -> float:
    """Episodes per minute of `hide eval`, start-up of its workers included."""
    began = time.perf_counter()
    evaluate(Evaluation("expert", TASKS, episodes=EPISODES), folder, workers=workers)
    return 60 * 3 * EPISODES / (time.perf_counter() - began)


def by_server(folder: Path, workers: int) -> float:
    """Episodes per minute of a server with as many workers, which start with the first shard."""
    with RunningServer(folder, "--no-references", workers=workers) as server:
        server.client.get(LAYOUT, timeout=60).raise_for_status()  # made once, on first start
        began = time.perf_counter()
        wanted = {"policy": "expert", "tasks": list(TASKS), "episodes": EPISODES}
        server.finished(server.post("/evaluations", wanted)["id"], 600)
        return 60 * 3 * EPISODES / (time.perf_counter() - began)


def recovery(folder: Path) -> dict[str, float]:
    """Seconds from a kill until the next episode is final."""
    with RunningServer(folder, "--no-references", workers=1) as server:
        wanted = {"policy": "expert", "tasks": ["search_drawer"], "episodes": 25}
        id = server.post("/evaluations", wanted)["id"]
        until(lambda: server.final(id) >= 2, "two episodes", 120)
        taken = {}
        for name, victim in victims(server).items():
            taken[name] = _until_next(server, id, victim)
        began = time.perf_counter()
        final = server.final(id)
        server.kill()
        server.start()
        until(lambda: server.final(id) > final, "an episode", 120)
        taken["server, restarted at once"] = time.perf_counter() - began
    return taken


def victims(server: RunningServer) -> dict[str, Any]:
    """How to find what is killed: looked up when its turn comes."""

    def simulator() -> int:
        below = descendants(server.process.pid)
        return next(pid for pid in below if "simulator_host" in command(pid))

    return {"simulator": simulator, "worker": lambda: server.workers[0]}


def _until_next(server: RunningServer, id: str, victim: Any) -> float:
    final = server.final(id)
    began = time.perf_counter()
    kill(victim())
    until(lambda: server.final(id) > final, "an episode", 120)
    return time.perf_counter() - began


def replay(folder: Path) -> dict[str, float]:
    """Bytes and seconds to the first drawn frame of a replay, first and second visit."""
    from playwright.sync_api import sync_playwright

    with RunningServer(folder, "--no-references", workers=1) as server:
        wanted = {"policy": "expert", "tasks": ["search_drawer"], "episodes": 1}
        id = server.post("/evaluations", wanted)["id"]
        server.finished(id)
        [episode] = server.episodes(id)
        with sync_playwright() as playwright:
            context = playwright.chromium.launch_persistent_context(  # others cache little
                folder.with_name("profile"),
                executable_path=CHROMIUM,
                args=FLAGS,
                viewport={"width": 1440, "height": 900},
            )
            figures = {}
            for visit in ("first", "second"):
                for name, value in _visit(context, f"{server.url}/episodes/{episode['id']}"):
                    figures[f"{visit} visit, {name}"] = value
            context.close()
        return figures


def _visit(context: Any, url: str) -> list[tuple[str, float]]:
    page = context.new_page()
    transferred = 0

    def count(event: dict[str, Any]) -> None:
        nonlocal transferred
        transferred += event["encodedDataLength"]

    session = context.new_cdp_session(page)
    session.send("Network.enable")
    session.on("Network.loadingFinished", count)
    began = time.perf_counter()
    page.goto(url)
    drawn = "(async () => { const v = document.querySelector('#viewer')?.viewer; if (!v) return 0;"
    drawn += " const s = await v.get_state(); return s.recordings?.length ?? 0 })()"

    def open_recordings() -> int:
        try:
            return int(page.evaluate(drawn))
        except Exception:  # the viewer cannot be asked before it is ready
            return 0

    until(open_recordings, "the recording", 60)
    taken = time.perf_counter() - began
    page.close()
    return [("MB", transferred / 1e6), ("seconds", taken)]


def main() -> None:
    """Prints medians, side by side."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    for workers in (1, 2):
        paces: dict[str, list[float]] = {"hide eval": [], "server": []}
        for number in range(rounds):
            with TemporaryDirectory() as folder:
                paces["hide eval"].append(by_hide_eval(Path(folder) / "run", workers))
                paces["server"].append(by_server(Path(folder) / f"data{number}", workers))
        print(
            workers,
            "workers, episodes a minute:",
            {k: round(median(v), 1) for k, v in paces.items()},
        )
    with TemporaryDirectory() as folder:
        for name, seconds in recovery(Path(folder) / "data").items():
            print(f"killed {name}: next episode final after {seconds:.2f} s")
    if CHROMIUM:
        with TemporaryDirectory() as folder:
            for name, value in replay(Path(folder) / "data").items():
                print(f"replay, {name}: {value:.2f}")


if __name__ == "__main__":
    main()
