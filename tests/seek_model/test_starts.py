"""A training of memory that goes on from another training's policy without memory."""

from pathlib import Path

import pytest
import torch

from seek_model import checkpoint
from seek_model.config import Config, PatchTransformer, Views
from seek_model.distributed import Group
from seek_model.network import Network, Predictions
from seek_model.starts import started
from seek_model.trainer import Trainer, TrainingError
from seek_model.training import train
from tests.seek_model.tiny import frames, targets
from tests.seek_model.tiny import tiny as reduced
from tests.seek_model.trainings import tiny, tiny_store

GROUP = Group(0, 1, torch.device("cpu"))


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint of the first phase, whose policy is told no clock."""
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        train(tiny(), tiny_store(folder).path, folder / "out")
    return folder / "out" / "checkpoint-first.safetensors"


def with_model(config: Config, **changes: object) -> Config:
    return config.model_copy(update={"model": config.model.model_copy(update=changes)})


def said(network: Network) -> Predictions:
    """What a network says of made-up frames, the same for every network."""
    torch.manual_seed(0)
    shown = frames(2, 3)
    with torch.no_grad():
        return network.eval()(shown, targets(shown), zoom_noise=0.0)


def test_with_the_clock_it_begins_as_the_policy_without(first: Path) -> None:
    clocked = with_model(tiny(start=str(first)), clock=True, memory=None)

    trainer = Trainer("second", clocked, GROUP, started(first, clocked)[0])

    before, after = said(checkpoint.load(first)[0]), said(trainer.network)
    for name in ("logits", "center"):
        assert torch.equal(getattr(before.fine, name), getattr(after.fine, name))
    assert torch.equal(before.coarse.decoded.logits, after.coarse.decoded.logits)
    assert torch.equal(before.coarse.stop, after.coarse.stop)
    assert all(torch.equal(*pair) for pair in zip(before.fine.said, after.fine.said, strict=True))


def test_with_the_clock_and_memory_it_sees_as_the_policy_without(first: Path) -> None:
    clocked = with_model(tiny(start=str(first)), clock=True)

    network = Trainer("second", clocked, GROUP, started(first, clocked)[0]).network

    assert torch.equal(said(checkpoint.load(first)[0]).fine.logits, said(network).fine.logits)


def test_it_learns_to_listen_to_the_clock(first: Path) -> None:
    network = Network(with_model(tiny(), clock=True, memory=None).model)
    checkpoint.fill(network, started(first, with_model(tiny(), clock=True))[0])
    shown = frames(2, 3)

    network(shown, targets(shown)).coarse.decoded.logits.square().sum().backward()

    film = network.coarse.trunk.encoder.levels[0].film.weight
    assert not film[:, -1].any()
    assert film.grad[:, -1].any()


def test_a_policy_with_a_clock_is_no_start_of_one_without(first: Path, tmp_path: Path) -> None:
    clocked = with_model(tiny(), clock=True, memory=None)
    _, _, header = checkpoint.load(first)
    path = tmp_path / "clocked.safetensors"
    weights = checkpoint.weights(Network(clocked.model))
    checkpoint.save(path, weights, clocked, header.provenance)

    with pytest.raises(TrainingError, match=r"model\.clock = True; expected False"):
        started(path, tiny())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stop": False}, r"model\.stop = True; expected False"),
        ({"views": Views(size=32, points=100, voxel=0.05)}, r"model\.views = "),
    ],
)
def test_with_the_clock_nothing_else_may_differ(
    first: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(TrainingError, match=message):
        started(first, with_model(tiny(), clock=True, **changes))


def test_another_trunk_is_not_widened_for_the_clock(first: Path, tmp_path: Path) -> None:
    backbone = PatchTransformer(patch=4, channels=16, width=16, depth=2, heads=2)
    small = reduced("sam2act-small")
    views = small.model.views.model_copy(update={"layers": 1, "behind": False})
    language = small.model.language.model_copy(update={"colors": 0})
    plain = {"views": views, "language": language}
    model = with_model(small, backbone=backbone, decoder="convex", **plain)
    path = tmp_path / "patches.safetensors"
    weights = checkpoint.weights(Network(model.model))
    checkpoint.save(path, weights, model, checkpoint.load(first)[2].provenance)

    with pytest.raises(TrainingError, match=r"model\.clock = False; expected True"):
        started(path, with_model(model, clock=True))
