"""Recordings: what a viewer and a server find in them."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright
from rerun.chunk import RrdReader

from hide_tasks import episode, suite
from hide_tasks.bullet import meshes
from hide_tasks.bullet.cameras import camera
from hide_tasks.bullet.meshes import Mesh
from hide_tasks.bullet.scene import Part
from hide_tasks.contract import (
    CAMERAS,
    Belief,
    CameraView,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    Event,
    Failure,
    HiddenState,
    JointPosition,
    Keyframe,
    MotionOutcome,
    Observation,
    Start,
)
from hide_tasks.policies import Expert
from tests.chromium import CHROMIUM, FLAGS
from workers.recording import Recorder, drawn, properties_of
from workers.recording_layout import as_text, write_layout

INSTRUCTION = "push the red button 3 times"
SPEC = EpisodeSpec(task="push_button_times", split="test", index=7, variation={"count": 3})
DECISIONS = 5
START = Start(
    stage="press 0",
    hidden={"presses_done": 0, "searched": []},
    checks={"pressed": False, "withdrawn": False},
)


def parts() -> list[Part]:
    table = meshes.merge([(meshes.box((1.2, 1.8, 0.04)), np.eye(4), (198, 182, 160))])
    button = [(meshes.box((0.1, 0.1, 0.02)), np.eye(4), (90, 90, 96))]
    cap = [(meshes.cylinder(0.03, 0.02), np.eye(4), (200, 40, 40))]
    arm = [(meshes.cylinder(0.04, 0.3), np.eye(4), (240, 240, 240))]
    return [
        Part("table", table),
        Part("button/base", meshes.merge(button)),
        Part("button/cap", meshes.merge(cap)),
        Part("robot/panda_hand", meshes.merge(arm)),
    ]


def poses(time: float) -> NDArray[np.float64]:
    """The hand goes up and down over the button."""
    result = np.tile(np.eye(4), (4, 1, 1))
    result[:, :3, 3] = [(0.25, 0, 0.732), (0.3, 0, 0.762), (0.3, 0, 0.78), (0.3, 0, 1.0)]
    result[3, 2, 3] += 0.05 * np.sin(time * np.pi)
    return result


def observation(seed: int = 0, opening: float = 0.0) -> Observation:
    rng = np.random.default_rng(seed)
    views = {name: _view(name, rng) for name in CAMERAS}
    pose = np.array([0.3, 0.0, 0.9, 1.0, 0.0, 0.0, 0.0])
    return Observation(views, pose, opening, np.zeros(7), INSTRUCTION)


def _view(name: str, rng: np.random.Generator) -> CameraView:
    lens = camera(name if name != "wrist" else "front")
    row, column = np.mgrid[:128, :128]
    rgb = np.stack([row, column, np.full_like(row, rng.integers(256))], axis=-1).astype(np.uint8)
    depth = (1.0 + 0.01 * row).astype(np.float32)
    return CameraView(rgb, depth, lens.intrinsics, lens.camera_to_world)


def record(decision: int, **fields: Any) -> DecisionRecord:
    done: HiddenState = {"presses_done": decision + 1, "searched": [*("top", "middle")[:decision]]}
    values: dict[str, Any] = {
        "decision": decision,
        "time": decision + 1.0,
        "action": Keyframe(position=(0.3, 0.0, 0.85), quaternion=(1, 0, 0, 0), opening=0.0),
        "outcome": MotionOutcome.ARRIVED,
        "path": "straight",
        "stage": f"press {decision + 1}",
        "hidden": done,
        "checks": {"pressed": decision >= 2, "withdrawn": decision % 2 == 0},
        "success": decision >= 2,
        "events": [Event(time=decision + 0.5, name="presses", total=decision + 1)],
        "belief": Belief(stage_count=decision, anchor_similarity=0.9),
    }
    return DecisionRecord(**values | fields)


def result(**fields: Any) -> EpisodeResult:
    values: dict[str, Any] = {
        "task": SPEC.task,
        "split": SPEC.split,
        "index": SPEC.index,
        "variation": SPEC.variation,
        "instruction": INSTRUCTION,
        "success": True,
        "exact": False,
        "failure": Failure.OVERCOUNT,
        "decisions": DECISIONS,
        "stage": "press 5",
        "scene_hash": "5ce0e",
        "final_state_hash": "f17a1",
    }
    return EpisodeResult(**values | fields)


def tell(recorder: Recorder, decisions: int = DECISIONS) -> None:
    """A small episode, told to the recorder as the loop tells it."""
    recorder.begin(SPEC, INSTRUCTION, parts(), START)
    recorder.frame(0.0, poses(0.0))
    for decision in range(decisions):
        seen = observation(decision)
        for step in range(1, 21):
            recorder.frame(decision + step / 20, poses(decision + step / 20))
        recorder.decided(seen, record(decision))


def recorded(path: Path, **verdict: Any) -> Path:
    with Recorder(path, policy="expert") as recorder:
        tell(recorder)
        recorder.end(result(**verdict), observation(DECISIONS))
    return path


def rows(path: Path, entity: str, column: str) -> dict[tuple[float, int], Any]:
    """Values of one entity by (time in s, decision)."""
    found = {}
    for chunk in RrdReader(path).stream().filter(content=entity, is_static=False).to_chunks():
        batch = chunk.to_record_batch().to_pydict()
        times = [time.total_seconds() for time in batch["time"]]
        for time, decision, value in zip(times, batch["decision"], batch[column], strict=True):
            found[time, decision] = value[0] if value else None
    return found


# --- the file ---


def test_a_recording_verifies(tmp_path: Path) -> None:
    path = recorded(tmp_path / "episodes" / "a.rrd")

    done = rerun_command(tmp_path, "rrd", "verify", str(path))

    assert done.returncode == 0, done.stderr
    assert [file.name for file in path.parent.iterdir()] == ["a.rrd"]


def rerun_command(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The SDK's command line; CI keeps it from sending statistics, HOME from noting that."""
    environment = {**os.environ, "CI": "1", "HOME": str(home), "XDG_CONFIG_HOME": str(home)}
    command = [sys.executable, "-m", "rerun", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)


def test_a_recording_says_what_it_is(tmp_path: Path) -> None:
    found = properties_of(recorded(tmp_path / "a.rrd"))

    assert found == {
        "suite": "hide 1",
        "task": "push_button_times",
        "split": "test",
        "index": 7,
        "variation": '{"count": 3}',
        "instruction": INSTRUCTION,
        "policy": "expert",
        "success": True,
        "exact": False,
        "failure": "overcount",
        "decisions": DECISIONS,
        "scene_hash": "5ce0e",
    }


def test_an_exact_recording_names_no_failure(tmp_path: Path) -> None:
    found = properties_of(recorded(tmp_path / "a.rrd", exact=True, failure=None))

    assert found["exact"] is True
    assert "failure" not in found


def test_hidden_values_stand_after_the_decision_that_changed_them(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd")

    presses = rows(path, "/hidden/presses_done", "StateChange:state")
    searched = rows(path, "/hidden/searched", "StateChange:state")

    assert presses == {(float(d), d): str(d) for d in range(DECISIONS + 1)}
    assert searched == {(0.0, 0): "–", (2.0, 2): "top", (3.0, 3): "top, middle"}


def test_pictures_stand_before_the_decision_that_saw_them(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd")

    for name in CAMERAS:
        seen = rows(path, f"/world/cameras/{name}/rgb", "EncodedImage:blob")
        assert list(seen) == [(float(d), d) for d in range(DECISIONS + 1)]


def test_dense_actions_are_pictured_twice_a_second(tmp_path: Path) -> None:
    rest = JointPosition(chunk=((0.0,) * 8,) * 2)

    with Recorder(tmp_path / "a.rrd") as recorder:
        recorder.begin(SPEC, INSTRUCTION, parts(), START)
        for decision in range(20):
            now = (decision + 1) / 10
            recorder.frame(now, poses(now))
            recorder.decided(observation(), record(decision, time=now, action=rest))
        recorder.end(result(), observation())

    seen = rows(tmp_path / "a.rrd", "/world/cameras/wrist/rgb", "EncodedImage:blob")
    assert list(seen) == [(0.0, 0), (0.5, 5), (1.0, 10), (1.5, 15), (2.0, 20)]


def test_the_first_decision_has_a_scene_and_lanes(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd")

    assert (0.0, 0) in rows(path, "/world/robot/panda_hand", "Transform3D:translation")
    assert rows(path, "/stage", "StateChange:state")[0.0, 0] == "press 0"
    assert (0.0, 0) in rows(path, "/hidden/presses_done", "StateChange:state")


def test_a_part_that_stands_still_is_written_once(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd")

    table = rows(path, "/world/table", "Transform3D:translation")
    hand = rows(path, "/world/robot/panda_hand", "Transform3D:translation")

    assert list(table) == [(0.0, 0)]
    assert len(hand) == 1 + 20 * DECISIONS
    assert {decision for (time, decision) in hand if 1.0 < time <= 2.0} == {2}


def test_an_episode_that_dies_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="lost"), Recorder(tmp_path / "a.rrd") as recorder:
        tell(recorder, decisions=1)
        assert list(tmp_path.iterdir()) == [recorder.partial]
        raise RuntimeError("worker lost")

    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_growing_recording_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workers.recording.SEND_EVERY", 0.0)

    with Recorder(tmp_path / "a.rrd") as recorder:
        tell(recorder, decisions=2)
        stages = rows(recorder.partial, "/stage", "StateChange:state")

    assert stages == {(0.0, 0): "press 0", (1.0, 1): "press 1", (2.0, 2): "press 2"}


def test_two_attempts_at_one_episode_do_not_meet(tmp_path: Path) -> None:
    first, second = Recorder(tmp_path / "a.rrd"), Recorder(tmp_path / "a.rrd")
    tell(first)
    tell(second, decisions=1)

    first.end(result(), observation())
    second.discard()

    assert len(rows(tmp_path / "a.rrd", "/world/cameras/front/rgb", "EncodedImage:blob")) == 6


def test_an_expert_episode_is_small_and_tells_its_hidden_state(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"

    with Recorder(path, policy="expert") as recorder:
        spec = suite.episode("push_button_times", "test", 0)
        verdict, records = episode.play(spec, Expert(), witnesses=[recorder])

    assert path.stat().st_size < 1_500_000
    assert properties_of(path)["scene_hash"] == verdict.scene_hash
    for name in records[0].hidden:
        told = rows(path, f"/hidden/{name}", "StateChange:state")
        values = [as_text(record.hidden[name]) for record in records]
        assert list(told.values()) == [value for value, _ in groupby(values)]


def test_a_part_inside_another_is_refused(tmp_path: Path) -> None:
    cube = meshes.box((1, 1, 1))

    with pytest.raises(ValueError, match="'chest/top' would move with part 'chest'"):
        Recorder(tmp_path / "a.rrd").begin(
            SPEC, "", [Part("chest", cube), Part("chest/top", cube)], START
        )


def test_faces_of_two_colours_share_no_vertex() -> None:
    cube = meshes.box((1, 1, 1))
    colors = np.zeros((len(cube.faces), 3), dtype=np.uint8)
    colors[::2] = (255, 0, 0)  # of the two triangles of a side, one is red

    mesh = drawn(Mesh(cube.vertices, cube.normals, cube.faces, colors))

    assert mesh.triangle_indices and mesh.vertex_colors
    corners = np.array(mesh.triangle_indices.as_arrow_array().to_pylist())
    rgba = np.array(mesh.vertex_colors.as_arrow_array().to_pylist())
    assert {hex(value) for value in rgba[corners[::2]].flat} == {"0xff0000ff"}
    assert {hex(value) for value in rgba[corners[1::2]].flat} == {"0xff"}
    assert len(rgba) == 6 * 6


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (True, "yes"),
        (3, "3"),
        (None, "–"),
        ([], "–"),
        (["top", False], "top, no"),
        ("left", "left"),
    ],
)
def test_a_hidden_value_reads_well(value: object, text: str) -> None:
    assert as_text(value) == text


# --- the process ---


def test_recordings_leave_no_threads_behind(tmp_path: Path) -> None:
    recorded(tmp_path / "first.rrd")
    before = threads()

    for index in range(40):
        recorded(tmp_path / f"{index}.rrd")

    assert threads() <= before + 2


def threads() -> int:
    """Threads of this process, native ones too."""
    return len(list(Path("/proc/self/task").iterdir()))


def test_recording_touches_no_file_but_its_own(tmp_path: Path) -> None:
    """The usage statistics would make their folders in HOME before the first one is sent."""
    home, out = tmp_path / "home", tmp_path / "out"
    home.mkdir()
    clean = {name: value for name, value in os.environ.items() if name[:3] not in ("CI", "XDG")}
    script = (
        "import sys; from pathlib import Path; from workers.recording_layout import write_layout;"
        "from workers.recording import Recorder;"
        "from hide_tasks.contract import EpisodeSpec, Start;"
        "start = Start(stage='s', hidden={}, checks={});"
        "spec = EpisodeSpec(task='t', split='val', index=0, variation={});"
        "Recorder(Path(sys.argv[1])).begin(spec, 'go', [], start); write_layout(Path(sys.argv[2]))"
    )

    command = [sys.executable, "-c", script, str(out / "a.rrd"), str(out / "l.rbl")]
    subprocess.run(command, env={**clean, "HOME": str(home)}, check=True, timeout=60)

    assert list(home.iterdir()) == []
    assert sorted(file.suffix for file in out.iterdir()) == [".part", ".rbl"]


# --- the viewer ---

PAGE = """<!doctype html><body style="margin:0"><div id="v" style="width:100vw;height:100vh"></div>
<script type="module">
import { WebViewer } from "/viewer.js";
console.debug = () => {};  // 20,000 lines about shaders, each carried to the test: half a minute
const viewer = window.viewer = new WebViewer();
await viewer.start(
  [location.origin + "/layout.rbl", location.origin + "/episode.rrd"], document.getElementById("v"),
  { hide_welcome_screen: true, width: "100%", height: "100%", theme: "light" });
window.views = async () => (await viewer.get_state()).views;
window.duration = async () => {
  const [recording] = (await viewer.get_state()).recordings;
  const time = recording?.timelines.find(timeline => timeline.name === "time");
  return time && Number(time.time_range.end) / 1e9;
};
window.started = true;
</script>"""
LAID_OUT = "window.started && views().then(views => views.some(view => view.name === 'Scene'))"

VIEWS = {
    "Scene",
    "Episode",
    *(name.replace("_", " ") for name in CAMERAS),
    "Hidden state, stage, checks",
    "Looks back at",
    "Attention",
    "Log",
    "Signals",
}


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A folder with the viewer and the layout, and its address."""
    package = find_spec("rerun_notebook")
    assert package and package.origin
    static = Path(package.origin).with_name("static")
    (tmp_path / "viewer.js").write_bytes(
        (static / "widget.js").read_bytes() + b"\nexport { WebViewer };\n"
    )
    (tmp_path / "re_viewer_bg.wasm").symlink_to(static / "re_viewer_bg.wasm")
    (tmp_path / "index.html").write_text(PAGE)
    write_layout(tmp_path / "layout.rbl")
    with served(tmp_path) as address:
        yield tmp_path, address


@contextmanager
def served(folder: Path) -> Iterator[str]:
    handler = partial(QuietHandler, directory=str(folder))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a line on standard error for each."""

    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def opened(address: str) -> Iterator[Page]:
    """The page once the viewer has the recording."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_page(viewport={"width": 640, "height": 400})
        try:
            page.goto(address)
            until(page, LAID_OUT)
            yield page
        finally:
            browser.close()


def until(page: Page, condition: str, seconds: float = 90) -> None:
    """Wait until an expression holds."""
    deadline = monotonic() + seconds
    while not page.evaluate(condition):
        assert monotonic() < deadline, f"{condition} did not come true within {seconds:.0f} s"
        page.wait_for_timeout(200)


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium")
def test_the_viewer_shows_a_recording_without_errors(site: tuple[Path, str]) -> None:
    folder, address = site
    recorded(folder / "episode.rrd")

    with opened(address) as page:
        until(page, "duration().then(seconds => seconds === 5)")
        to = {"timeline": "time", "duration_nanos": 3_000_000_000, "play_state": "paused"}
        page.evaluate("to => viewer.set_time(to)", to)
        page.wait_for_timeout(3000)
        shown = page.evaluate("views()")

    assert [report for view in shown for report in view["reports"]] == []
    assert {view["name"] for view in shown} == VIEWS
