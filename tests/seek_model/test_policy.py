from pathlib import Path

import numpy as np
import pytest
import torch

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Belief, Keyframe, Observation, Policy
from hide_tasks.episode import play
from hide_tasks.layout import BOUNDS
from seek_model import checkpoint, policy
from seek_model.checkpoint_header import BadCheckpoint, read_header
from seek_model.frames import Frames
from seek_model.memory import Archive
from seek_model.network import Predictions
from seek_model.policy import SeekPolicy, carried_out
from seek_model.presets import preset
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.seek_model.tiny import tiny

DOWN = np.array([1.0, 0.0, 0.0, 0.0])  # x y z w: the tool points at the table


@pytest.fixture(scope="module")
def observation() -> Observation:
    with World(suite.build(suite.episode("push_button_times", "test", 0))) as world:
        return world.observe()


def loaded(path: Path, name: str = "seek-small") -> SeekPolicy:
    return policy.load(tiny_checkpoint(path / "some.safetensors", tiny(name)))


def pose(x: float, quaternion: np.ndarray = DOWN) -> np.ndarray:
    return np.array([x, 0.0, 1.0, *quaternion])


def test_a_checkpoint_is_a_policy_of_the_contract(tmp_path: Path, observation: Observation) -> None:
    made = loaded(tmp_path)
    assert isinstance(made, Policy)
    made.reset(observation.instruction, 7)

    action = made.act(observation)

    assert isinstance(action, Keyframe)
    low, high = np.array(BOUNDS).T
    assert np.all(low <= action.pose[:3]) and np.all(action.pose[:3] <= high)
    assert action.opening in (0.0, 1.0)


def test_an_episode_is_played_to_its_end_the_same_way_twice(tmp_path: Path) -> None:
    spec, made = suite.episode("push_button_times", "test", 1), loaded(tmp_path)

    first, records = play(spec, made, budget=3)
    again, repeated = play(spec, made, budget=3)

    assert [record.action for record in records] == [record.action for record in repeated]
    assert first.final_state_hash == again.final_state_hash
    assert all(isinstance(record.belief, Belief) for record in records)


def test_half_precision_hardly_changes_what_is_said(
    tmp_path: Path, observation: Observation
) -> None:
    whole = loaded(tmp_path)
    halved = checkpoint.halved(checkpoint.weights(whole.network))
    provenance = read_header(tmp_path / "some.safetensors").provenance
    checkpoint.save(tmp_path / "half.safetensors", halved, whole.config, provenance)

    one, other = (
        _predicted(made, observation)
        for made in (whole, policy.load(tmp_path / "half.safetensors"))
    )

    assert one.position is not None and other.position is not None and one.said and other.said
    assert torch.allclose(one.position, other.position, atol=1e-3)  # 0.5 mm
    for logits, nearly in zip(one.said, other.said, strict=True):
        assert torch.allclose(logits, nearly, atol=5e-3)
    assert one.coarse.boundary is not None and other.coarse.boundary is not None
    assert torch.allclose(one.coarse.boundary, other.coarse.boundary, atol=5e-3)


@torch.no_grad()
def _predicted(made: SeekPolicy, observation: Observation) -> Predictions:
    seen = policy.frames_of(observation, 0, made.config)
    return made.network.play(seen, made.network.begin(1))[0]


def test_belief_names_the_memories_that_there_were(
    tmp_path: Path, observation: Observation
) -> None:
    made = loaded(tmp_path)
    made.reset(observation.instruction, 7)
    for _ in range(9):
        made.act(observation)
        assert made._pending
        made._pending.commit()  # as if each had been carried out
        made._pending = None

    believed = made.belief()

    assert believed and believed.window == (2, 3, 4, 5, 6, 7)
    assert believed.anchor_index in (0, 1)
    assert believed.anchor_similarity == pytest.approx(1.0, abs=1e-3)
    assert believed.stage_count is not None and believed.boundary is not None
    by_view = dict.fromkeys(("top", "front", "right"), 0.0)
    for one in believed.attention:
        by_view[one.view] += one.weight
    assert all(total == pytest.approx(1.0, abs=1e-2) for total in by_view.values())
    assert {one.slot for one in believed.attention} == {
        *(f"window {age}" for age in range(1, 7)), "anchor", "stage",
    }  # fmt: skip


def test_a_policy_without_memory_believes_nothing(tmp_path: Path, observation: Observation) -> None:
    made = loaded(tmp_path, "sam2act-small")
    made.reset(observation.instruction, 7)
    made.act(observation)

    assert made.belief() is None


def test_an_action_that_found_no_path_is_not_remembered(
    tmp_path: Path, observation: Observation
) -> None:
    made = loaded(tmp_path)
    made.reset(observation.instruction, 7)
    first = made.act(observation)
    assert not np.allclose(first.pose[:3], observation.gripper_pose[:3], atol=0.01)

    made.act(observation)  # the arm stands where it stood

    assert not made._archives[0].entries
    moved = Observation(**{**vars(observation), "gripper_pose": first.pose})
    made.act(moved)
    assert [entry.decision for entry in made._archives[0].entries] == [1]


@pytest.mark.parametrize("name", ["seek-small", "sam2act-small"])
def test_what_found_no_path_is_tried_with_and_without_collisions(
    tmp_path: Path, observation: Observation, name: str
) -> None:
    made = loaded(tmp_path, name)
    tried = [made.act(observation) for _ in range(4)]  # the arm stands where it stood

    assert len({action.position for action in tried}) == 1
    first = tried[0].ignore_collisions
    assert [action.ignore_collisions for action in tried] == [first, not first, first, not first]


def test_to_the_letter_everything_is_remembered(tmp_path: Path, observation: Observation) -> None:
    made = policy.load(tiny_checkpoint(tmp_path / "a.safetensors", tiny(commit="always")))
    made.reset(observation.instruction, 7)

    made.act(observation)
    made.act(observation)

    assert len(made._archives[0].entries) == 1


def test_a_reset_forgets_everything(tmp_path: Path, observation: Observation) -> None:
    made = loaded(tmp_path)
    made.reset(observation.instruction, 7)
    first = made.act(observation)
    moved = Observation(**{**vars(observation), "gripper_pose": first.pose})
    made.act(moved)

    made.reset(observation.instruction, 7)

    assert made.belief() is None
    assert made.act(observation) == first


@pytest.mark.parametrize(
    ("before", "asked", "after", "truth"),
    [
        (pose(0.2), pose(0.3), pose(0.3), True),  # arrived
        (pose(0.2), pose(0.3), pose(0.25), True),  # stopped on the way
        (pose(0.2), pose(0.3), pose(0.2), False),  # no path
        (pose(0.2), pose(0.2), pose(0.2), True),  # only the fingers were asked
        (pose(0.2), pose(0.2, np.array([0.0, 1.0, 0.0, 0.0])), pose(0.2), False),  # no turn
    ],
)
def test_what_was_carried_out_shows_in_where_the_arm_stands(
    before: np.ndarray, asked: np.ndarray, after: np.ndarray, truth: bool
) -> None:
    assert carried_out(before, asked, after) is truth


def test_an_oracle_cannot_play(tmp_path: Path) -> None:
    with pytest.raises(BadCheckpoint, match="no annotation when it plays"):
        loaded(tmp_path, "seek-small/anchor_oracle")


def test_the_clock_of_a_policy_counts_its_decisions(
    tmp_path: Path, observation: Observation, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, told = loaded(tmp_path, "seek-small+clock"), []
    play = made.network.play

    def watched(frames: Frames, archives: list[Archive], true: None) -> object:
        told.append(frames.decision.tolist())
        return play(frames, archives, true)

    monkeypatch.setattr(made.network, "play", watched)
    for _ in range(2):
        made.reset(observation.instruction, 7)
        for _ in range(3):
            made.act(observation)

    assert told == [[[0]], [[1]], [[2]]] * 2


def test_a_policy_sees_no_more_points_than_it_was_trained_with(observation: Observation) -> None:
    config = preset("seek-small")

    seen = policy.frames_of(observation, 0, config)

    assert 0 < len(seen.points) <= config.model.views.points
    assert seen.points.abs().max() <= 1.0
