"""The micro-tasks ask for memory and leak nothing."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from seek_model.micro_matrix import ALL, MEMORIES, model, play
from seek_model.micro_tasks import (
    AGO,
    CHANCE,
    COUNTS,
    FRAMES,
    TASKS,
    WINDOW,
    Cut,
    Episode,
    Step,
    collate,
    draw,
    single_frames,
    training_batch,
)
from seek_model.network import Network

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=15)


def episode(task: str, shown: int, hidden: int) -> Episode:
    return TASKS[task](np.random.default_rng(shown), np.random.default_rng(hidden))


def decisions(episode: Episode) -> list[Step]:
    return [step for step in episode.steps if step.choice >= 0]


def look_alike(one: Step, other: Step) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.colors, other.colors)


@few
@given(shown=seeds, task=st.sampled_from(list(TASKS)))
def test_a_decision_looks_the_same_whatever_is_right(shown: int, task: str) -> None:
    episodes = [episode(task, shown, hidden) for hidden in range(12)]

    first, *others = [step for one in episodes for step in decisions(one)]

    assert all(look_alike(first, other) for other in others)
    assert len({one.instruction for one in episodes}) == 1
    assert {step.choice for step in (first, *others)} == set(range(len(episodes[0].candidates)))


@few
@given(seed=seeds, task=st.sampled_from(list(TASKS)))
def test_body_and_fingers_never_tell(seed: int, task: str) -> None:
    frames, _ = collate([Cut(one := draw(np.random.default_rng(seed), task), 0, len(one.steps))])

    assert torch.equal(frames.pose, frames.pose[:, :1].expand_as(frames.pose))
    assert torch.equal(frames.fingers, frames.fingers[:, :1].expand_as(frames.fingers))


@few
@given(seed=seeds, task=st.sampled_from(list(TASKS)))
def test_the_target_of_a_decision_is_the_right_candidate(seed: int, task: str) -> None:
    one = draw(np.random.default_rng(seed), task)

    assert decisions(one)
    for step in decisions(one):
        assert np.array_equal(step.target, one.candidates[step.choice])


@few
@given(seed=seeds)
def test_repetitions_outnumber_the_window_at_both_decisions(seed: int) -> None:
    one = draw(np.random.default_rng(seed), "repeat")
    last, after = (t for t, step in enumerate(one.steps) if step.choice >= 0)
    done = [sum(step.boundary for step in one.steps[:t]) for t in (last, after)]

    assert done[1] == done[0] + 1 in COUNTS
    # A visit outside the window precedes both, so even an empty archive would not tell.
    first = next(t for t, step in enumerate(one.steps) if step.boundary)
    assert first < last - WINDOW


@few
@given(seed=seeds)
def test_the_cue_left_the_window_before_the_question(seed: int) -> None:
    one = draw(np.random.default_rng(seed), "cue")
    question = len(one.steps) - 1

    assert one.steps[question].choice >= 0
    assert question - WINDOW > one.steps[question].evidence == 0


@few
@given(seed=seeds)
def test_the_outcome_asked_for_is_in_the_window_and_no_question(seed: int) -> None:
    one = draw(np.random.default_rng(seed), "outcome")

    for t, step in enumerate(one.steps):
        if step.choice >= 0:
            evidence = one.steps[step.evidence]
            assert t - step.evidence in AGO
            assert evidence.choice == -1
            assert np.array_equal(evidence.target, step.target)


@few
@given(seed=seeds, task=st.sampled_from(list(TASKS)))
def test_everything_is_in_the_cube(seed: int, task: str) -> None:
    for step in draw(np.random.default_rng(seed), task).steps:
        assert np.abs(step.points).max() < 1
        assert step.colors.min() >= 0
        assert step.colors.max() <= 1


@pytest.mark.parametrize("task", TASKS)
def test_right_answers_are_as_frequent_as_chance_says(task: str) -> None:
    rng = np.random.default_rng(5)
    choices = [step.choice for _ in range(400) for step in decisions(draw(rng, task))]

    shares = np.bincount(choices) / len(choices)

    assert shares == pytest.approx(np.full(len(shares), CHANCE[task]), abs=0.07)


@few
@given(seed=seeds)
def test_a_batch_has_seven_supervised_steps_behind_their_past(seed: int) -> None:
    frames, targets = training_batch(np.random.default_rng(seed), 6)

    assert targets.supervised.sum(dim=1).tolist() == [FRAMES] * 6
    assert targets.supervised[:, -FRAMES:].all()
    assert (frames.present | ~targets.supervised).all()
    assert torch.equal(frames.decision.amax(dim=1) + 1, frames.present.sum(dim=1))


def test_a_cut_ends_before_what_is_to_come() -> None:
    one = draw(np.random.default_rng(0), "cue")

    frames, targets = collate([Cut(one, 1, 8), Cut(one, 0, 5)])

    assert frames.shape == (2, 8)
    assert frames.present[1].tolist() == [False] * 3 + [True] * 5
    assert np.array_equal(targets.position[1, -1].numpy(), one.steps[4].target)
    kept = frames.points[frames.owner == 8 + 3]
    assert np.array_equal(kept.numpy(), one.steps[0].points)


@few
@given(seed=seeds)
def test_stages_count_the_boundaries_before_a_step(seed: int) -> None:
    one = draw(np.random.default_rng(seed), "repeat")

    _, targets = collate([Cut(one, 0, len(one.steps))])

    before = targets.boundary.cumsum(dim=1) - targets.boundary
    assert torch.equal(targets.stage, before.long())
    assert targets.stage[0, 0] == 0


def test_single_frames_stand_alone() -> None:
    frames, targets = single_frames(np.random.default_rng(0), 12)

    assert frames.shape == (12, 1)
    assert frames.present.all()
    assert targets.supervised.all()


@pytest.mark.parametrize("memory", ["none", "wcm+pam+scm"])
def test_a_network_answers_for_the_supervised_steps(memory: str) -> None:
    torch.manual_seed(0)
    network = Network(model(MEMORIES[memory]))
    frames, targets = training_batch(np.random.default_rng(1), 2)

    said = network(frames, targets, coarse_only=True)

    answered = torch.zeros_like(targets.supervised)
    answered[said.rows.sequence, said.rows.step] = True
    assert torch.equal(answered, targets.supervised)


def test_play_answers_at_every_step_and_counts_only_its_own_boundaries() -> None:
    torch.manual_seed(0)
    network = Network(model(ALL)).eval()
    one = draw(np.random.default_rng(2), "cue")

    played = play(network, [one, draw(np.random.default_rng(3), "outcome")])

    steps = len(one.steps)
    assert played.place.shape == (2, max(steps, 10), 3)
    assert (played.done[0, -steps:].diff() <= 1).all()
    assert (played.anchor[0, -steps:][: WINDOW + 1] == -1).all()
    assert (played.anchor[0, -steps:][WINDOW + 1 :] >= 0).all()
