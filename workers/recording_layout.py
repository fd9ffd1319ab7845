"""What a recording is made of: its entities, timelines and lanes, and how the viewer shows them.

One layout serves every recording that has the same cameras: it asks for entities by folder, never
by a task's names. It is a file of its own because inside a recording it costs 83 KB and two leaked
threads (0.41), and could not be improved later.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hide_tasks.contract import CAMERAS

APPLICATION = "hide_seek"  # a layout applies to recordings of the same application
TIME = "time"  # timeline: simulated time
DECISION = "decision"  # timeline: what the policy saw, and what was true, when it chose

WORLD = "/world"
TARGET = f"{WORLD}/target"  # the pose that a keyframe asks for
# Lanes are sorted by path: the truth, what is believed of it, the stage, what counts.
HIDDEN = "/hidden"  # one lane a hidden value, whatever the task calls it
BELIEF = "/memory"  # what the policy says of its memory
STAGE = "/stage"
SUCCESS = "/success"  # the checks held at some step; one lane a check below it
SIGNALS = "/signals"  # numbers over time
ATTENTION = "/attention"  # a table of what the policy looks back at; below it view/slot over time
SUMMARY = "/summary"  # instruction and verdict
LOG = "/log"

EYE = (0.8, -1.6, 1.85)  # m; in front of the robot, well to its right, above the table
EYE_TARGET = (0.15, 0.0, 0.95)

Array = NDArray[np.float64]

YES, NO = (88, 140, 120), (150, 146, 140)
NOTHING = (196, 192, 186)
SHADES = (
    (84, 132, 176), (217, 154, 90), (141, 117, 165), (88, 140, 120), (199, 110, 110),
    (95, 158, 168), (176, 160, 80), (122, 122, 130), (196, 130, 170), (110, 150, 84),
)  # fmt: skip


def camera_path(name: str) -> str:
    """The entity of a camera; its pictures are its children `rgb` and `depth`."""
    return f"{WORLD}/cameras/{name}"


def write_layout(path: Path, cameras: Sequence[str] = CAMERAS) -> None:
    """Write the layout file (`.rbl`) that opens well beside any recording of these cameras."""
    path.parent.mkdir(parents=True, exist_ok=True)
    layout(cameras).save(APPLICATION, str(path))


def layout(cameras: Sequence[str] = CAMERAS) -> rrb.Blueprint:
    """The scene above states over time; beside them the instruction, the cameras and the log."""
    happened = rrb.Vertical(_scene(cameras), _states(), row_shares=[3, 2])
    told = rrb.Vertical(_summary(), _seen(cameras), _log(), row_shares=[5, 14, 9])
    return rrb.Blueprint(
        rrb.Horizontal(happened, told, column_shares=[3, 2]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIME),
        auto_views=False,
        auto_layout=False,
    )


def _scene(cameras: Sequence[str]) -> rrb.Spatial3DView:
    clouds = [f"- {camera_path(name)}/depth" for name in cameras]
    return rrb.Spatial3DView(
        origin=WORLD,
        name="Scene",
        contents=["$origin/**", *clouds],
        background=(236, 238, 240),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=EYE, look_target=EYE_TARGET, eye_up=(0, 0, 1)),
    )


def _summary() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=SUMMARY, name="Episode")


def _seen(cameras: Sequence[str]) -> rrb.Tabs:
    pictures = (_pictures("rgb", "Cameras", cameras), _pictures("depth", "Depth", cameras))
    return rrb.Tabs(*pictures, _memory(), active_tab=0)


def _memory() -> rrb.Vertical:
    """What the policy looks back at: now, as a table, and over time."""
    now = rrb.TextDocumentView(origin=ATTENTION, name="Looks back at")
    series = rrb.TimeSeriesView(
        origin=ATTENTION,
        name="Attention",
        plot_legend=rrb.PlotLegend(visible=False),  # it would cover the plot; pointing tells, too
        defaults=[_steps()],
    )
    return rrb.Vertical(now, series, row_shares=[2, 1], name="Memory")


def _pictures(kind: str, title: str, cameras: Sequence[str]) -> rrb.Grid:
    views = (
        rrb.Spatial2DView(
            origin=camera_path(name), name=name.replace("_", " "), contents=f"$origin/{kind}"
        )
        for name in cameras
    )
    return rrb.Grid(*views, grid_columns=min(2, len(cameras)), name=title)


def _states() -> rrb.StateTimelineView:
    folders = [f"{folder}/**" for folder in (HIDDEN, BELIEF, STAGE, SUCCESS)]
    return rrb.StateTimelineView(contents=folders, name="Hidden state, stage, checks")


def _log() -> rrb.Tabs:
    columns = rrb.TextLogColumns(text_log_columns=["loglevel", "body"])
    log = rrb.TextLogView(origin=LOG, name="Log", columns=columns)
    signals = rrb.TimeSeriesView(origin=SIGNALS, name="Signals", defaults=[_steps()])
    return rrb.Tabs(log, signals, active_tab=0)


def _steps() -> rr.SeriesLines:
    return rr.SeriesLines(interpolation_mode=rr.components.InterpolationMode.StepAfter)


class Moment(NamedTuple):
    """Where a row stands on the two timelines."""

    time: float  # simulated seconds
    decision: int


class Rows:
    """Rows by entity, sent as columns: a chunk an entity, not a chunk a row."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, Any], list[tuple[Moment, dict[str, Any]]]] = defaultdict(list)
        self._places: dict[str, list[tuple[Moment, Array]]] = defaultdict(list)

    def add(self, entity: str, archetype: Any, moment: Moment, **values: Any) -> None:
        """Keep one row; an entity's rows of one archetype name the same values."""
        self._rows[entity, archetype].append((moment, values))

    def place(self, entity: str, moment: Moment, transform: Array) -> None:
        """Keep where an entity is in the world, a transform (4, 4)."""
        self._places[entity].append((moment, transform))

    def send(self, stream: rr.RecordingStream) -> None:
        """Hand everything kept to the stream, and forget it."""
        for (entity, archetype), rows in self._rows.items():
            values = {name: [row[name] for _, row in rows] for name in rows[0][1]}
            stream.send_columns(entity, _times(rows), archetype.columns(**values))
        for entity, places in self._places.items():
            transforms = np.array([transform for _, transform in places])
            columns = rr.Transform3D.columns(
                translation=transforms[:, :3, 3],
                quaternion=Rotation.from_matrix(transforms[:, :3, :3]).as_quat(),
            )
            stream.send_columns(entity, _times(places), columns)
        self._rows.clear()
        self._places.clear()


def _times(rows: Sequence[tuple[Moment, Any]]) -> list[rr.TimeColumn]:
    times, decisions = zip(*(moment for moment, _ in rows), strict=True)
    return [rr.TimeColumn(TIME, duration=times), rr.TimeColumn(DECISION, sequence=decisions)]


class Lanes:
    """States over time, written when they change, with a colour for every value they took."""

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
        self._now: dict[str, str] = {}
        self._taken: dict[str, list[str]] = defaultdict(list)
        self._unexplained: list[str] = []

    def set(self, folder: str, moment: Moment, values: Mapping[str, object]) -> None:
        """The named values hold from this moment on."""
        for name, value in values.items():
            self.set_one(f"{folder}/{rr.escape_entity_path_part(name)}", moment, value)

    def set_one(self, lane: str, moment: Moment, value: object) -> None:
        """The lane's value from this moment on."""
        state = as_text(value)
        if self._now.get(lane) == state:
            return
        self._now[lane] = state
        self._rows.add(lane, rr.StateChange, moment, state=state)
        if state not in self._taken[lane]:
            self._taken[lane].append(state)
            self._unexplained.append(lane)

    def explain(self, stream: rr.RecordingStream) -> None:
        """Write the colours of the lanes that took a value for the first time."""
        for lane in dict.fromkeys(self._unexplained):
            states = self._taken[lane]
            style = rr.StateConfiguration(values=states, colors=_colors(states))
            stream.log(lane, style, static=True)
        self._unexplained.clear()


def as_text(value: object) -> str:
    """A hidden value as a lane shows it."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value == []:
        return "–"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(as_text(item) for item in value)
    return str(value)


def _colors(states: Sequence[str]) -> list[tuple[int, int, int]]:
    """A colour for each value, the same ones however many follow."""
    fixed = {"yes": YES, "no": NO, "–": NOTHING}
    return [fixed.get(state, SHADES[i % len(SHADES)]) for i, state in enumerate(states)]
