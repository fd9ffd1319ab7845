"""What a validation measures, on networks that are right, wrong, or nothing in particular."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from seek_model.clouds import SCALE, to_cube
from seek_model.coarse import Coarse
from seek_model.config import Config
from seek_model.frames import Targets
from seek_model.heads import Said
from seek_model.network import Network, Predictions, Rows
from seek_model.rotations import BINS
from seek_model.sampling import Cut, assembled
from seek_model.store import Store
from seek_model.trunk import Decoded
from seek_model.validation import Precision, differences, summary, validate, whole_episodes
from tests.seek_model.trainings import tiny, tiny_store

FP32 = Precision(torch.device("cpu"), bf16=False)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return tiny_store(tmp_path_factory.mktemp("validation"))


@pytest.fixture
def network() -> Network:
    torch.set_num_threads(1)
    torch.manual_seed(0)
    return Network(tiny().model).train()


def without_memory(config: Config) -> Config:
    return config.model_copy(update={"model": config.model.model_copy(update={"memory": None})})


def two_frames() -> Targets:
    """Both with an open hand; the first ends a stage, the second the episode."""
    return Targets(
        position=torch.tensor([[0.1, 0.2, 0.3], [-0.1, 0.0, 0.5]]),
        rotation=torch.tensor([[0, 36, 10], [0, 36, 20]]),
        opening=torch.tensor([1, 1]),
        ignore_collisions=torch.tensor([0, 1]),
        stage=torch.tensor([0, 1]),
        boundary=torch.tensor([1.0, 0.0]),
        stop=torch.tensor([0.0, 1.0]),
        evidence=torch.tensor([-1, -1]),
        supervised=torch.tensor([True, True]),
    )


def logits(bins: Tensor, count: int) -> Tensor:
    return torch.nn.functional.one_hot(bins, count).float()


def said_of(true: Targets, off: float = 0.0) -> Predictions:
    """Predictions that are right but for an offset of `off` metres along x."""
    nothing = torch.zeros(2, 3, 4, 4)
    coarse = Coarse(
        decoded=Decoded(nothing),
        features=nothing[:, :, None],
        target=true.position,
        done=true.stage,
        boundary=true.boundary - 0.5,
        stop=true.stop - 0.5,
        key=None,
        recalled=None,
    )
    said = Said(
        logits(true.rotation, BINS), logits(true.opening, 2), logits(true.ignore_collisions, 2)
    )
    place = true.position + torch.tensor([off * SCALE, 0.0, 0.0])
    rows = Rows(torch.zeros(2, dtype=torch.long), torch.arange(2))
    return Predictions(rows, coarse, None, said, place)


def test_who_is_right_is_right_in_everything() -> None:
    true = two_frames()

    found = summary(differences(said_of(true), true, counts=True))

    assert found["frames"] == 2
    assert found["position_cm"] == 0.0
    assert found["rotation_degrees"] == pytest.approx(0.0, abs=1e-3)
    for share in ("position_near", "coarse_near", "opening", "collisions", "keyframe", "stop"):
        assert found[share] == 1.0
    assert found["boundary_precision"] == found["boundary_recall"] == 1.0


@pytest.mark.parametrize(("off", "near"), [(0.019, 1.0), (0.021, 0.0)])
def test_distances_are_in_centimetres_of_the_world(off: float, near: float) -> None:
    true = two_frames()

    found = summary(differences(said_of(true, off), true, counts=True))

    assert found["position_cm"] == pytest.approx(100 * off, abs=1e-3)
    assert found["position_near"] == found["keyframe"] == near
    assert found["coarse_near"] == 1.0


@pytest.mark.parametrize("wrong", ["rotation", "opening"])
def test_a_keyframe_is_right_as_a_whole_or_not_at_all(wrong: str) -> None:
    true = two_frames()
    off = {"rotation": (true.rotation + 3) % BINS, "opening": 1 - true.opening}[wrong]

    found = summary(differences(said_of(replace(true, **{wrong: off})), true, counts=True))

    assert found["keyframe"] == 0.0
    assert found["position_near"] == 1.0


def test_a_bin_is_five_degrees() -> None:
    true = two_frames()
    said = said_of(replace(true, rotation=true.rotation + torch.tensor([0, 0, 1])))

    found = summary(differences(said, true, counts=True))

    assert found["rotation_degrees"] == pytest.approx(5.0, abs=1e-3)


def test_of_boundaries_precision_and_recall_are_told_apart() -> None:
    true = two_frames()
    always = said_of(replace(true, boundary=torch.ones(2)))
    never = said_of(replace(true, boundary=torch.zeros(2)))

    found = [summary(differences(said, true, counts=True)) for said in (always, never)]

    assert [one["boundary_precision"] for one in found] == [0.5, None]
    assert [one["boundary_recall"] for one in found] == [1.0, 0.0]


def test_every_frame_of_every_task_is_counted_once(store: Store, network: Network) -> None:
    episodes = whole_episodes(store, tiny().train)

    found = validate(network, episodes, FP32)

    assert {task: one["frames"] for task, one in found["tasks"].items()} == {"press": 13, "lift": 3}
    assert found["overall"]["frames"] == 16
    assert 0 <= found["overall"]["own_count"] <= 1
    assert network.training


def test_episodes_are_whole_and_as_they_were_recorded(store: Store) -> None:
    for task, [(frames, targets)] in whole_episodes(store, tiny().train).items():
        part = store.part(task, "val")
        there = frames.present

        assert there.sum(dim=1).tolist() == [one.keyframes for one in store.episodes(task, "val")]
        assert torch.equal(there, targets.supervised)
        assert (targets.stop.argmax(dim=1) == there.sum(dim=1) - 1).all()
        recorded = torch.tensor(to_cube(part.action_pose[:, :3]), dtype=torch.float32)
        assert torch.allclose(targets.position[there], recorded, atol=1e-6)


def test_fewer_episodes_can_be_asked_for(store: Store, network: Network) -> None:
    episodes = whole_episodes(store, tiny(validate_episodes=1, tasks=("press",)).train)

    found = validate(network, episodes, FP32)

    assert list(found["tasks"]) == ["press"]
    assert found["overall"]["frames"] == 4


def test_without_episodes_there_is_nothing_to_tell(network: Network) -> None:
    found = validate(network, {}, FP32)

    assert found["overall"]["frames"] == 0
    assert {value for name, value in found["overall"].items() if name != "frames"} == {None}


def test_episodes_in_one_batch_are_as_if_they_were_alone(store: Store, network: Network) -> None:
    part = store.part("press", "val")
    alone = [
        assembled([Cut(part, one, 0, 0, one.keyframes)], 0, one.keyframes)
        for one in store.episodes("press", "val")
    ]
    together = whole_episodes(store, tiny(tasks=("press",)).train)

    found = [validate(network, episodes, FP32) for episodes in (together, {"press": alone})]

    assert found[0] == found[1]


def test_who_never_sees_a_boundary_counts_to_zero(store: Store, network: Network) -> None:
    memory = network.coarse.memory
    assert memory and memory.boundary
    torch.nn.init.constant_(memory.boundary.net[-1].bias, -1e3)

    found = validate(network, whole_episodes(store, tiny().train), FP32)["overall"]

    # Stages are of two keyframes: the first two frames of each of the three episodes.
    assert found["own_count"] == pytest.approx(6 / 16, abs=1e-4)
    assert found["boundary_recall"] == 0.0


def test_a_memory_free_network_has_no_counts(store: Store) -> None:
    torch.manual_seed(0)
    network = Network(without_memory(tiny()).model)

    found = validate(network, whole_episodes(store, tiny().train), FP32)["overall"]

    assert found["frames"] == 16
    assert found["own_count"] is None
    assert found["boundary_recall"] is None
    assert found["stop"] is not None
