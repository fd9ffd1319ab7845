"""One episode as a Rerun recording: a witness that writes what can be watched later.

A decision's picture stands at the moment before its action; what the action brought about stands
at the moment after, under the next decision. So decision k shows what the policy saw, and what
was true, when it chose. Rows are collected and sent entity by entity, because many small chunks
make a file slow and four times as large; a slow episode is sent every few seconds, so that its
growing file can be watched.

The SDK (0.41) opens no connection and touches no file but the recording. Its command line does
both, for usage statistics, unless CI is set in the environment.
"""

import io
import json
import uuid
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import rerun as rr
import rerun_bindings
from numpy.typing import NDArray
from PIL import Image
from rerun.chunk import RrdReader

from hide_tasks.contract import (
    CameraView,
    DecisionRecord,
    EpisodeResult,
    EpisodeSpec,
    Keyframe,
    Observation,
    Start,
    Value,
)
from hide_tasks.poses import matrix
from workers.recording_layout import (
    APPLICATION,
    HIDDEN,
    LOG,
    SIGNALS,
    STAGE,
    SUCCESS,
    SUMMARY,
    TARGET,
    WORLD,
    Array,
    Lanes,
    Moment,
    Rows,
    camera_path,
)
from workers.recording_memory import MemoryTrack

if TYPE_CHECKING:  # whoever reads a recording needs no simulator
    from hide_tasks.bullet.meshes import Mesh
    from hide_tasks.bullet.scene import Part

JPEG_QUALITY = 90
MILLIMETRES = 1000.0  # depth images: units per metre, up to 65 m
PICTURE_EVERY = 0.5  # simulated s between the pictures of dense actions; keyframes show them all
SEND_EVERY = 3.0  # s of wall time between two pieces of a growing file
STILL = 1e-5  # poses that changed by less (metres, entries of the rotation) are not written again

_PROPERTIES = ["/__properties/episode", "/__properties/verdict"]


class Recorder:
    """Writes one episode to `path`; until its end the file is `partial`, beside it.

    As a context it leaves nothing behind of an episode that raises. One instance, one attempt.
    """

    def __init__(self, path: Path, *, policy: str | None = None):
        self.attempt = uuid.uuid4().hex  # also the recording's id
        self.path = Path(path)
        self.partial = self.path.with_name(f"{self.path.name}.{self.attempt[:8]}.part")
        self._policy = policy
        self._rows = Rows()
        self._lanes = Lanes(self._rows)
        self._memory = MemoryTrack(self._rows, self._lanes)
        self._stream: rr.RecordingStream | None = None
        self._decision, self._chosen_at, self._now = 0, 0.0, 0.0
        self._pictured_at = -PICTURE_EVERY
        self._violations: set[str] = set()

    # --- what a witness is told ---

    def begin(
        self, spec: EpisodeSpec, instruction: str, parts: Sequence["Part"], start: Start
    ) -> None:
        """Open the file and write what does not change.

        Raises:
            ValueError: a part's name is a folder of another's, whose motion it would inherit.
        """
        self._entities = _part_paths([part.name for part in parts])
        self._poses = np.full((len(parts), 4, 4), np.inf)
        self._stream = stream = self._opened()
        stream.send_recording_name(spec.name)
        stream.send_property("episode", _values(self._identity(spec, instruction)))
        stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log(TARGET, rr.TransformAxes3D(axis_length=0.07), static=True)
        for entity, part in zip(self._entities, parts, strict=True):
            stream.log(entity, drawn(part.mesh), static=True)
        played = spec.name + f" · {self._policy}" * bool(self._policy)
        self._summary = f"### {instruction}\n\n{played}"
        self._summarise(Moment(0.0, 0), self._summary)
        self._know(Moment(0.0, 0), start, Moment(0.0, 0))
        self._send()

    def frame(self, time: float, poses: Array) -> None:
        """Take the parts' world transforms (n, 4, 4) at a simulated time in seconds."""
        self._now = time
        moved = np.flatnonzero(np.abs(poses - self._poses).max(axis=(1, 2)) > STILL)
        if not moved.size:
            return
        self._poses[moved] = poses[moved]
        moment = Moment(time, self._decision + (time > self._chosen_at))
        for part, transform in zip(moved.tolist(), poses[moved], strict=True):
            self._rows.place(self._entities[part], moment, transform)

    def decided(self, observation: Observation, record: DecisionRecord) -> None:
        """Take what was seen before an action, and what the action came to."""
        before = Moment(self._chosen_at, record.decision)
        after = Moment(record.time, record.decision + 1)
        if isinstance(record.action, Keyframe):
            self._observe(before, observation)
            self._rows.place(TARGET, before, matrix(record.action.pose))
        elif before.time - self._pictured_at >= PICTURE_EVERY:
            self._observe(before, observation)
        self._know(after, record, before)
        self._tell(after, record)
        self._chosen_at, self._decision = after
        if monotonic() - self._sent_at > SEND_EVERY:
            self._send()

    def end(self, result: EpisodeResult, observation: Observation) -> None:
        """Take the last picture and the verdicts; the file gets its name."""
        assert self._stream is not None, "begin comes before end"
        last = Moment(max(self._now, self._chosen_at), self._decision)
        self._observe(last, observation)
        verdict = _verdict(result)
        self._log(last, verdict, _level(bad=not result.exact))
        self._summarise(last, f"{self._summary} · **{verdict}**")
        self._stream.send_property("verdict", _values(_verdicts(result)))
        self._send()
        self._close()
        self.partial.replace(self.path)

    # --- the file ---

    def discard(self) -> None:
        """Drop an episode that did not end. After `end` it does nothing."""
        self._close()
        self.partial.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.discard()

    def _opened(self) -> rr.RecordingStream:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        batches = rr.ChunkBatcherConfig(flush_tick=timedelta(hours=1))
        stream = rr.RecordingStream(APPLICATION, recording_id=self.attempt, batcher_config=batches)
        stream.save(self.partial)
        return stream

    def _send(self) -> None:
        assert self._stream is not None, "begin comes first"
        self._lanes.explain(self._stream)
        self._memory.explain(self._stream)
        self._stream.flush()  # lenses and colours go before the columns that need them
        self._rows.send(self._stream)
        self._stream.flush()
        self._sent_at = monotonic()

    def _close(self) -> None:
        if self._stream is None:
            return
        self._stream.flush()
        self._stream.disconnect()
        self._stream = None
        # Else every recording leaves two threads and its memory behind (rerun issue 2116).
        rerun_bindings.flush_and_cleanup_orphaned_recordings()

    def _identity(self, spec: EpisodeSpec, instruction: str) -> dict[str, Value]:
        return {
            "suite": f"{spec.suite} {spec.version}",
            "task": spec.task,
            "split": spec.split,
            "index": spec.index,
            "variation": json.dumps(spec.variation),
            "instruction": instruction,
            "policy": self._policy,
        }

    # --- its rows ---

    def _observe(self, moment: Moment, observation: Observation) -> None:
        self._pictured_at = moment.time
        for name, view in observation.views.items():
            self._picture(camera_path(name), moment, view)
        opening = observation.gripper_opening
        self._rows.add(f"{SIGNALS}/gripper_opening", rr.Scalars, moment, scalars=opening)

    def _picture(self, camera: str, moment: Moment, view: CameraView) -> None:
        if moment.decision == 0 and self._stream:
            self._stream.log(camera, _lens(view), static=True)
        self._rows.place(camera, moment, view.camera_to_world)
        rgb = {"blob": jpeg(view.rgb), "media_type": "image/jpeg"}
        depth = {"blob": png(view.depth), "media_type": "image/png", "meter": MILLIMETRES}
        self._rows.add(f"{camera}/rgb", rr.EncodedImage, moment, **rgb)
        self._rows.add(f"{camera}/depth", rr.EncodedDepthImage, moment, **depth)

    def _know(self, moment: Moment, record: DecisionRecord | Start, chosen: Moment) -> None:
        self._lanes.set_one(STAGE, moment, record.stage)
        self._lanes.set(HIDDEN, moment, record.hidden)
        self._lanes.set_one(SUCCESS, moment, record.success)
        self._lanes.set(SUCCESS, moment, record.checks)
        if record.belief:
            self._memory.tell(record.belief, chosen)

    def _tell(self, moment: Moment, record: DecisionRecord) -> None:
        for event in record.events:
            happened = Moment(event.time, moment.decision)
            self._log(happened, f"{event.name}: {event.total}", rr.TextLogLevel.INFO)
        self._log(moment, _outcome(record), _level(bad=record.outcome.failed))
        for violation in sorted(set(record.violations) - self._violations):
            self._violations.add(violation)
            self._log(moment, f"violation: {violation}", rr.TextLogLevel.WARN)

    def _log(self, moment: Moment, text: str, level: rr.TextLogLevel) -> None:
        self._rows.add(LOG, rr.TextLog, moment, text=text, level=level)

    def _summarise(self, moment: Moment, text: str) -> None:
        self._rows.add(SUMMARY, rr.TextDocument, moment, text=text, media_type="text/markdown")


# --- what is written, and read again ---


def properties_of(path: Path) -> dict[str, Value]:
    """What a recording says of itself.

    suite, task, split, index, variation (JSON), instruction, policy if it was given; success,
    exact, failure (absent if there was none), decisions, scene_hash if the episode ended.
    """
    found: dict[str, Value] = {}
    for chunk in RrdReader(path).stream().filter(content=_PROPERTIES).to_chunks():
        columns = chunk.to_record_batch().to_pydict()
        found |= {name: rows[0][0] for name, rows in columns.items() if "." not in name}
    return found


def drawn(mesh: "Mesh") -> rr.Mesh3D:
    """The mesh as the viewer wants it: coloured vertices, split where the faces' colours differ."""
    if mesh.colors is None:
        return rr.Mesh3D(
            vertex_positions=mesh.vertices, triangle_indices=mesh.faces, vertex_normals=mesh.normals
        )
    color = mesh.colors.astype(np.int64) @ (1 << 16, 1 << 8, 1)
    corners = mesh.faces.astype(np.int64).reshape(-1) << 24 | np.repeat(color, 3)
    split, corner = np.unique(corners, return_inverse=True)
    vertex = split >> 24
    rgba = ((split & 0xFFFFFF) << 8 | 0xFF).astype(np.uint32)
    return rr.Mesh3D(
        vertex_positions=mesh.vertices[vertex].astype(np.float32),
        triangle_indices=corner.reshape(-1, 3).astype(np.uint32),
        vertex_normals=mesh.normals[vertex].astype(np.float32),
        vertex_colors=rgba,
    )


def jpeg(rgb: NDArray[np.uint8]) -> bytes:
    """A colour image (h, w, 3) as a file."""
    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "JPEG", quality=JPEG_QUALITY)
    return file.getvalue()


def png(depth: NDArray[np.float32]) -> bytes:
    """A depth image (h, w) in metres as a 16-bit file in millimetres."""
    file = io.BytesIO()
    units = np.clip(np.nan_to_num(depth) * MILLIMETRES + 0.5, 0, 65535).astype(np.uint16)
    Image.fromarray(units).save(file, "PNG", compress_level=3)
    return file.getvalue()


def _part_paths(names: Sequence[str]) -> list[str]:
    for name in names:
        inside = [other for other in names if other.startswith(f"{name}/")]
        if inside:
            raise ValueError(
                f"Part {inside[0]!r} would move with part {name!r}; "
                f"expected names of which none is a folder of another, like '{name}/base'."
            )
    return [f"{WORLD}/{rr.new_entity_path(name.split('/')).lstrip('/')}" for name in names]


def _lens(view: CameraView) -> rr.Pinhole:
    height, width = view.depth.shape
    return rr.Pinhole(
        image_from_camera=view.intrinsics, width=width, height=height, image_plane_distance=0.12
    )


def _level(*, bad: bool) -> rr.TextLogLevel:
    return rr.TextLogLevel.WARN if bad else rr.TextLogLevel.INFO


def _outcome(record: DecisionRecord) -> str:
    how = [record.path] * bool(record.path) + ["after a second plan"] * record.retried
    motion = f"{record.outcome}" + f" ({', '.join(how)})" * bool(how)
    stop = ", stop" * record.action.stop
    return f"decision {record.decision}: {record.action.kind}{stop} → {motion}"


def _verdict(result: EpisodeResult) -> str:
    if result.exact:
        return "success, exact"
    return f"{'success, not exact' if result.success else 'no success'}: {result.failure}"


def _verdicts(result: EpisodeResult) -> dict[str, Value]:
    return {
        "success": result.success,
        "exact": result.exact,
        "failure": result.failure,
        "decisions": result.decisions,
        "scene_hash": result.scene_hash,
    }


def _values(values: dict[str, Value]) -> rr.AnyValues:
    given: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    return rr.AnyValues(**given)
