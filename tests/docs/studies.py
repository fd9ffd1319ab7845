"""Made-up studies: ledgers that look as if every run had been trained and played."""

import hashlib
import json
import struct
from pathlib import Path

from hide_tasks.contract import EpisodeSpec, Failure
from seek_model.checkpoint_header import FORMAT, Provenance
from seek_model.presets import preset
from seek_model.progress import LOSSES
from seek_model.study import FULL, Run, Study
from server.blobs import Blobs
from server.db import Database
from tests.server import ledgers

SMALL = FULL._replace(
    name="small",
    tasks=("push_button_times", "reopen_drawer", "search_drawer"),
    episodes=4,
    settings={"train": {"validate_episodes": 1}},
)
RATES = {"seek": 0.8, "twin": 0.4, "seek-clock": 0.85, "twin-clock": 0.6}  # others: between


def header(run: Run) -> bytes:
    """A checkpoint of a run without a single weight."""
    config = preset(run.preset)
    train = config.train.model_copy(update={"seed": run.seed, "start": run.start})
    provenance = Provenance(
        project="0", torch="2", suite="hide", version=1, data="d" * 64, tasks=("press",),
        phase="second" if run.start else "first", step=800, seed=run.seed, seconds=1800.0,
        start=hashlib.sha256(header(FULL.run(run.start))).hexdigest() if run.start else "",
    )  # fmt: skip
    metadata = {
        "format": FORMAT,
        "config": config.model_copy(update={"train": train}).model_dump_json(),
        "provenance": provenance.model_dump_json(),
    }
    text = json.dumps({"__metadata__": metadata}).encode()
    return struct.pack("<Q", len(text)) + text


def outcome(run: Run, spec: EpisodeSpec) -> Failure | None:
    """The same at every call; harder episodes are harder for all."""
    ease = _draw("episode", spec.task, spec.index)
    own = _draw(run.name, spec.task, spec.index)
    if (ease + own) / 2 < RATES.get(run.policy, 0.6):
        return None
    kinds = (Failure.UNDERCOUNT, Failure.WRONG_RECALL, Failure.OVERCOUNT, Failure.NOT_PLACED)
    return kinds[int(4 * _draw("failure", run.name, spec.task, spec.index))]


def _draw(*parts: object) -> float:
    return hashlib.sha256("/".join(map(str, parts)).encode()).digest()[0] / 256


def measured(study: Study, data: Path, *, without: tuple[str, ...] = ()) -> None:
    """A data folder in which every run of a study was evaluated, but for some."""
    database, store = ledgers.opened(data, "sqlite"), Blobs(data / "blobs")
    wanted = {"tasks": list(study.tasks) or None, "episodes": study.episodes}
    ledgers.evaluated(database, store, "expert", lambda _: None, **wanted)
    for run in study.measured:
        if run.name not in without:
            play(run, database, store, wanted)
    database.close()


def play(run: Run, database: Database, store: Blobs, wanted: dict[str, object]) -> None:
    """One run's upload and evaluation."""
    model, content = run.preset, header(run)
    version = ledgers.uploaded(database, store, run.policy, content, model=model)
    ledgers.evaluated(database, store, version, lambda spec: outcome(run, spec), **wanted)


def trained(study: Study, out: Path) -> None:
    """The folders that trainings leave, without weights."""
    for run in study.runs:
        folder = out / "runs" / run.name
        folder.mkdir(parents=True)
        phase = "second" if run.start else "first"
        rows = [
            {"kind": "step", "phase": phase, "step": step, "samples_per_second": 50.0 + step % 3,
             "losses": {"translation": 8.0 / (1 + step / 40) + _draw(run.name, step) / 5}}
            for step in range(1, 241)
        ]  # fmt: skip
        rows[120:120] = [_validation(phase, 120, 0.4)]
        rows.append(_validation(phase, 240, 0.5 + 0.3 * _draw(run.name)))
        (folder / LOSSES).write_text("".join(json.dumps(row) + "\n" for row in rows))
        name = "checkpoint.safetensors" if run.start else "checkpoint-first.safetensors"
        (folder / name).write_bytes(header(run))


def _validation(phase: str, step: int, near: float) -> dict[str, object]:
    overall = {"frames": 90, "position_near": near, "own_count": None}
    return {"kind": "validation", "phase": phase, "step": step, "overall": overall, "tasks": {}}
