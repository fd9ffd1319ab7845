"""Whole trainings of a few steps: killed, stopped, refused, in two processes."""

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from seek_model import checkpoint, training_folder
from seek_model.checkpoint_header import read_header
from seek_model.config import Config, Language, Memory, PatchTransformer, Phase, Sam2, Views
from seek_model.distributed import Group
from seek_model.optim import Lamb
from seek_model.presets import preset
from seek_model.progress import Pace, Step, Watcher
from seek_model.sampling import Sampler
from seek_model.store import Store, StoreError
from seek_model.trainer import Trainer, TrainingError
from seek_model.training import train
from seek_model.training_folder import TrainingFolderError
from seek_model.validation import Precision
from tests.seek_model.trainings import tiny, tiny_store

ROOT = Path(__file__).parents[2]
PROGRAM = "tests.seek_model.trainings"
WHEN = {"samples_per_second", "loader_share"}


@pytest.fixture(autouse=True)
def one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_store(tmp_path_factory.mktemp("tiny")).path


@pytest.fixture(scope="module")
def whole(store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a training that nothing interrupted."""
    torch.set_num_threads(1)
    out = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        train(tiny(), store, out)
    return out


def rows(out: Path) -> list[dict[str, Any]]:
    """Of losses.jsonl, without what depends on the clock."""
    found = [json.loads(line) for line in (out / "losses.jsonl").read_text().splitlines()]
    return [{name: value for name, value in row.items() if name not in WHEN} for row in found]


def weights(file: Path) -> dict[str, list[Any]]:
    network, _, _ = checkpoint.load(file)
    return {name: one.tolist() for name, one in checkpoint.weights(network).items()}


def begun(store: Path, out: Path, save_every: float, *before: str) -> subprocess.Popen[bytes]:
    command = [*before, "-m", PROGRAM, "ranks" if before else "train", store, out, save_every]
    return subprocess.Popen(list(map(str, [sys.executable, *command])), cwd=ROOT)


def wait_for(there: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    ends = time.monotonic() + 120
    while not there():
        assert process.poll() is None, "it ended before it was killed"
        assert time.monotonic() < ends
        time.sleep(0.002)


class Stopping(Watcher):
    """Presses Ctrl-C after a step."""

    def __init__(self, phase: str, step: int):
        self.at, self.said = (phase, step), ""

    def stepped(self, step: Step) -> None:
        if (step.phase, step.step) == self.at:
            os.kill(os.getpid(), signal.SIGINT)

    def say(self, line: str) -> None:
        self.said += line


def test_a_training_leaves_every_step_and_both_checkpoints(whole: Path) -> None:
    steps = [(row["phase"], row["step"]) for row in rows(whole) if row["kind"] == "step"]
    first, last = (
        read_header(whole / f"{name}.safetensors") for name in ("checkpoint-first", "checkpoint")
    )

    assert steps == [("first", 1), ("first", 2), ("second", 1), ("second", 2), ("second", 3)]
    assert first.config.model.memory is None
    assert last.config == tiny()
    assert (first.provenance.phase, first.provenance.step) == ("first", 2)
    assert (last.provenance.phase, last.provenance.step) == ("second", 3)
    assert last.provenance.tasks == ("lift", "press")
    assert json.loads((whole / "config.json").read_text())["config"]["name"] == "tiny"
    assert list((whole / "tensorboard").iterdir())


def test_every_part_of_the_loss_is_told(whole: Path) -> None:
    losses = rows(whole)[-2]["losses"]

    assert {"translation", "rotation_x", "opening", "boundary", "stop", "total"} <= set(losses)
    assert all(math.isfinite(value) for value in losses.values())


def test_each_phase_ends_with_a_validation_of_every_task(whole: Path) -> None:
    found = [row for row in rows(whole) if row["kind"] == "validation"]

    assert [(row["phase"], row["step"]) for row in found] == [("first", 2), ("second", 3)]
    assert set(found[1]["tasks"]) == {"lift", "press"}
    assert found[1]["overall"]["frames"] == 4 + 9 + 3
    assert found[0]["overall"]["own_count"] is None
    assert 0 <= found[1]["overall"]["own_count"] <= 1


def test_memory_starts_from_the_averaged_weights_of_the_first_phase() -> None:
    group = Group(0, 1, torch.device("cpu"))
    first = Trainer("first", tiny(), group, None)
    for one in first.averaged.values():
        one.add_(1)

    second = Trainer("second", tiny(), group, first.averaged)

    same = {name for name, one in second.weights.items() if name in first.averaged
            and torch.equal(one, first.averaged[name])}  # fmt: skip
    own = set(second.weights) - same
    assert {name.split(".")[1] for name in own} == {"memory", "stop"}
    assert {name for name in first.averaged if not name.startswith("coarse.stop.")} <= same
    assert all(torch.equal(one, second.averaged[name]) for name, one in second.weights.items())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("save_every", "killed_at"),
    [
        pytest.param(1e-9, 2, id="saved at every step"),
        pytest.param(1000.0, 4, id="saved at the end of the first phase"),
    ],
)
def test_a_killed_training_goes_on_as_if_it_had_not_been(
    store: Path, whole: Path, tmp_path: Path, save_every: float, killed_at: int
) -> None:
    out, config = tmp_path / "out", tiny(save_every=save_every)
    process = begun(store, out, save_every)
    lines = out / "losses.jsonl"
    wait_for(lambda: lines.exists() and lines.read_bytes().count(b"\n") >= killed_at, process)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL

    train(config, store, out)

    assert rows(out) == rows(whole)
    for name in ("checkpoint-first.safetensors", "checkpoint.safetensors"):
        assert weights(out / name) == weights(whole / name)


@pytest.mark.parametrize("at", [("first", 2), ("second", 2)])
def test_a_stopped_training_is_saved_and_goes_on(
    store: Path, whole: Path, tmp_path: Path, at: tuple[str, int]
) -> None:
    out, watch = tmp_path / "out", Stopping(*at)
    before = signal.getsignal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        train(tiny(), store, out, watch=watch)
    state = training_folder.kept(out, torch.device("cpu"))
    with (out / "losses.jsonl").open("a") as file:
        file.write('{"kind": "step", "pha')  # a row that was cut
    train(tiny(), store, out)

    assert state and (state["phase"], state["step"]) == at
    assert f"after step {at[1]} of phase {at[0]}" in watch.said
    assert rows(out) == rows(whole)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_finished_training_is_left_as_it_is(store: Path, whole: Path) -> None:
    names = ("checkpoint.safetensors", "losses.jsonl", "state.pt")
    before = {name: (whole / name).read_bytes() for name in names}

    result = train(tiny(), store, whole)

    assert result == whole / "checkpoint.safetensors"
    assert {name: (whole / name).read_bytes() for name in names} == before


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (tiny(seed=1), "config.train.seed is 0 there and 1 here"),
        (
            tiny(first=Phase(steps=2, horizon=9, warmup=2, batch=2)),
            "config.train.first.horizon is 8 there and 9 here",
        ),
    ],
)
def test_a_folder_of_another_training_is_refused(
    store: Path, whole: Path, config: Config, message: str
) -> None:
    with pytest.raises(TrainingFolderError, match=message):
        train(config, store, whole)


def test_a_folder_of_other_data_is_refused(whole: Path, tmp_path: Path) -> None:
    from tests.seek_model.stores import store as made

    other = made(tmp_path, {("press", "train"): [4]})

    with pytest.raises(TrainingFolderError, match=r"data\.hash is '"):
        train(tiny(), other.path, whole)


def test_a_folder_of_something_else_is_refused_and_left_alone(store: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("chapter one")

    with pytest.raises(TrainingFolderError, match="holds something that is no training"):
        train(tiny(), store, tmp_path)

    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_without_resume_a_training_that_is_there_is_refused(store: Path, whole: Path) -> None:
    with pytest.raises(TrainingFolderError, match="holds a training"):
        train(tiny(), store, whole, resume=False)


def test_a_folder_in_use_is_refused(store: Path, tmp_path: Path) -> None:
    about = Store.open(store)
    data = {"suite": "hide", "version": about.index.version, "hash": about.digest}

    with (
        training_folder.opened(tmp_path, tiny(), data, True),
        pytest.raises(TrainingFolderError, match="in use"),
    ):
        train(tiny(), store, tmp_path)


def test_a_damaged_state_is_told(store: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(tiny(), store, tmp_path, watch=Stopping("first", 1))
    (tmp_path / "state.pt").write_bytes(b"nothing of torch")

    with pytest.raises(TrainingFolderError, match=r"state\.pt cannot be read"):
        train(tiny(), store, tmp_path)


def test_a_store_of_other_clouds_is_refused(store: Path, tmp_path: Path) -> None:
    config = tiny()
    views = Views(size=16, points=99, voxel=0.05)
    other = config.model_copy(update={"model": config.model.model_copy(update={"views": views})})

    with pytest.raises(StoreError, match=r"points = 100, but model\.views\.points = 99"):
        train(other, store, tmp_path / "out")

    assert not (tmp_path / "out").exists()


def test_a_loss_that_is_no_number_ends_the_training(store: Path, tmp_path: Path) -> None:
    config = tiny(first=Phase(steps=4, horizon=8, warmup=0, batch=2, rate=1e30, clip=0.0))

    with pytest.raises(TrainingError, match="of phase first; what was saved before is kept"):
        train(config, store, tmp_path)


def test_nothing_to_train_is_told(store: Path, tmp_path: Path) -> None:
    nothing = Phase(steps=0, horizon=1, warmup=0, batch=1)

    with pytest.raises(TrainingError, match="Nothing to train"):
        train(tiny(first=nothing, second=nothing), store, tmp_path)


def test_without_a_memory_or_a_start_there_is_no_second_phase(store: Path, tmp_path: Path) -> None:
    base = tiny(precision="bf16")
    memory_free = base.model_copy(update={"model": base.model.model_copy(update={"memory": None})})

    train(memory_free, store, tmp_path)

    names = ("checkpoint-first.safetensors", "checkpoint.safetensors")
    first, last = (weights(tmp_path / name) for name in names)
    assert first == last
    assert read_header(tmp_path / names[1]).provenance.phase == "first"


@pytest.mark.slow
def test_two_processes_train_one_network(store: Path, tmp_path: Path) -> None:
    torchrun = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")

    assert begun(store, tmp_path / "out", 1000.0, *torchrun).wait(timeout=240) == 0

    one, other = (torch.load(tmp_path / "out" / f"rank-{rank}.pt") for rank in (0, 1))
    assert all(torch.equal(one[name], other[name]) for name in one)
    assert len([row for row in rows(tmp_path / "out") if row["kind"] == "step"]) == 5
    checkpoint.load(tmp_path / "out" / "checkpoint.safetensors")


def small_paper() -> Config:
    """The paper's protocol, on a toy of its network."""
    config = preset("seek-paper")
    transformer = PatchTransformer(channels=32, width=32, depth=2, heads=2)
    model = config.model.model_copy(
        update={
            "views": Views(size=56, points=100, voxel=0.05),
            "backbone": Sam2(encoder="toy", image=64, lora=4, transformer=transformer),
            "language": Language(channels=16, tokens=8),
            "memory": Memory(channels=8, layers=1, feedforward=16),
        }
    )
    phases = {
        name: getattr(config.train, name).model_copy(update={"batch": 2})
        for name in ("first", "second")
    }
    return config.model_copy(
        update={"model": model, "train": config.train.model_copy(update=phases)}
    )


def test_the_protocol_of_the_paper_takes_a_step_in_each_phase(store: Path) -> None:
    config, group = small_paper(), Group(0, 1, torch.device("cpu"))
    data, before = Store.open(store), None

    for name, kinds in (("first", [Lamb, torch.optim.Adam]), ("second", [torch.optim.Adam])):
        trainer = Trainer(name, config, group, before)
        frames, targets = Sampler(data, config.train, trainer.phase, 0).batch(0)
        start = {part: one.clone() for part, one in trainer.weights.items()}
        values = trainer.update(frames, targets, Precision(group.device, bf16=True), stop=False)
        before = trainer.averaged

        moved = {n for n, one in trainer.weights.items() if not torch.equal(one, start[n])}
        assert [type(one) for one in trainer.optimizers.optimizers] == kinds
        assert math.isfinite(values["total"])
        assert values["rate"] == pytest.approx(trainer.phase.rate / trainer.phase.warmup)
        assert any(n.startswith("coarse.trunk.encoder.") for n in moved) == (name == "first")
        assert any(n.startswith("coarse.memory.") for n in moved) == (name == "second")
        assert any(n.startswith("fine.") for n in moved)


def test_a_pace_leaves_out_what_is_not_training(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 2.0, 12.0, 14.0])
    monkeypatch.setattr("seek_model.progress.monotonic", lambda: next(now))
    pace = Pace(samples=8, steps=10)

    pace.step(waited=1.0)
    pace.skip()
    pace.step(waited=0.0)

    assert pace.samples_per_second == 4.0
    assert pace.loader_share == 0.25
    assert pace.left(done=2) == 16.0


def test_the_second_phase_can_start_from_a_checkpoint(
    store: Path, whole: Path, tmp_path: Path
) -> None:
    """Ablations share one first phase: the memory comes out as if it had been trained along."""
    start = whole / "checkpoint-first.safetensors"

    train(tiny(start=str(start)), store, tmp_path / "out")

    assert not (tmp_path / "out" / "checkpoint-first.safetensors").exists()
    origin = read_header(tmp_path / "out" / "checkpoint.safetensors").provenance
    assert origin.start == hashlib.sha256(start.read_bytes()).hexdigest()
    along, after = (weights(out / "checkpoint.safetensors") for out in (whole, tmp_path / "out"))
    assert along == after


def test_stopped_it_still_says_of_which_start_it_is(
    store: Path, whole: Path, tmp_path: Path
) -> None:
    start = tmp_path / "start.safetensors"
    start.write_bytes((whole / "checkpoint-first.safetensors").read_bytes())
    begun_with = hashlib.sha256(start.read_bytes()).hexdigest()
    with pytest.raises(KeyboardInterrupt):
        train(tiny(start=str(start)), store, tmp_path / "out", watch=Stopping("second", 1))
    start.unlink()

    train(tiny(start=str(start)), store, tmp_path / "out")

    origin = read_header(tmp_path / "out" / "checkpoint.safetensors").provenance
    assert origin.start == begun_with


def test_a_start_may_be_in_half_precision(store: Path, whole: Path, tmp_path: Path) -> None:
    network, config, header = checkpoint.load(whole / "checkpoint-first.safetensors")
    half = tmp_path / "stage-one.safetensors"
    halved = checkpoint.halved(checkpoint.weights(network))
    checkpoint.save(half, halved, config, header.provenance)
    base = tiny(start=str(half))
    twin = base.model_copy(update={"model": base.model.model_copy(update={"memory": None})})

    train(twin, store, tmp_path / "out")

    last = read_header(tmp_path / "out" / "checkpoint.safetensors")
    assert last.provenance.step == base.train.second.steps
    assert {one.dtype for one in last.tensors.values()} == {"F32"}


def test_without_a_memory_a_start_is_trained_on(store: Path, whole: Path, tmp_path: Path) -> None:
    """The memory-free twin has as many updates as the model with memory."""
    base = tiny(start=str(whole / "checkpoint-first.safetensors"))
    twin = base.model_copy(update={"model": base.model.model_copy(update={"memory": None})})

    train(twin, store, tmp_path)

    last = read_header(tmp_path / "checkpoint.safetensors").provenance
    assert (last.phase, last.step) == ("second", base.train.second.steps)
    before, after = weights(Path(base.train.start)), weights(tmp_path / "checkpoint.safetensors")
    assert before.keys() == after.keys()
    assert all(before[name] != after[name] for name in before if name.startswith("coarse.decoder"))


def test_a_start_of_another_model_is_refused(store: Path, whole: Path, tmp_path: Path) -> None:
    config = tiny(start=str(whole / "checkpoint-first.safetensors"))
    other = config.model.model_copy(update={"stop": False})

    with pytest.raises(TrainingError, match=r"model\.stop = True; expected False"):
        train(config.model_copy(update={"model": other}), store, tmp_path / "out")
    with pytest.raises(TrainingError, match="cannot be used"):
        train(tiny(start="nowhere.safetensors"), store, tmp_path / "another")
