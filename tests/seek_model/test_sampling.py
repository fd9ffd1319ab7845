"""Batches: functions of the step, uniform over tasks, archives of the past alone."""

import threading
import time

import numpy as np
import pytest
import torch

from seek_model.clouds import to_cube
from seek_model.config import Augment, Phase, Train
from seek_model.rotations import encode
from seek_model.sampling import Loader, Sampler
from seek_model.store import Store
from tests.seek_model.stores import SHADE, store

COUNTS = {
    ("count", "train"): [3, 5, 9, 4],
    ("count", "val"): [4, 6, 2],
    ("open", "train"): [9],
    ("open", "val"): [5],
}
STILL = Augment(shift=(0.0, 0.0, 0.0), turn=0.0)
SLIGHT = Augment(shift=(0.01, 0.01, 0.01), turn=5.0)  # no point of the plate leaves the cube
SINGLE = Phase(steps=1, horizon=1, warmup=0, batch=6)
SEVERAL = Phase(steps=1, horizon=1, warmup=0, batch=6, frames=4)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Store:
    torch.set_num_threads(1)
    return store(tmp_path_factory.mktemp("whole"), COUNTS)


def sampler(whole: Store, phase: Phase = SEVERAL, *, rank=0, world=1, seed=0, **train) -> Sampler:
    return Sampler(whole, Train(second=SEVERAL, **train), phase, seed, rank=rank, world=world)


def equal(first, second) -> bool:
    return all(
        torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b
        for one, other in zip(first, second, strict=True)
        for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
    )


def test_a_batch_is_a_function_of_the_step(whole):
    first, second = sampler(whole), sampler(whole)
    second.batch(0)

    assert equal(first.batch(3), second.batch(3))
    assert not equal(first.batch(3), first.batch(4))
    assert not equal(first.batch(3), sampler(whole, seed=1).batch(3))


def test_the_phases_draw_differently(whole):
    config = Train(first=SINGLE, second=SINGLE.model_copy(update={"rate": 1.0}))

    first, second = (Sampler(whole, config, phase, 0) for phase in (config.first, config.second))

    assert not equal(first.batch(0), second.batch(0))


def test_processes_share_one_batch(whole):
    together = sampler(whole).batch(2)[1].position

    apart = [sampler(whole, rank=rank, world=2) for rank in range(2)]
    shares = [[one.cut(2, element) for element in one.elements] for one in apart]

    assert not equal(apart[0].batch(2), apart[1].batch(2))
    assert len(together) == sum(map(len, shares))
    whose = [shares[element % 2][element // 2] for element in range(6)]
    assert whose == [sampler(whole).cut(2, element) for element in range(6)]


def test_a_batch_that_cannot_be_shared_is_refused(whole):
    with pytest.raises(ValueError, match="A batch of 6 cannot be shared by 4 processes"):
        sampler(whole, world=4)


def test_single_frames_come_without_an_archive(whole):
    frames, targets = sampler(whole, SINGLE).batch(0)

    assert frames.shape == (6, 1)
    assert frames.present.all()
    assert targets.supervised.all()
    assert len(frames.instructions) == 6
    assert frames.owner.unique().tolist() == list(range(6))


def test_tasks_are_drawn_uniformly_whatever_their_number_of_episodes(whole):
    instructions = [
        name for step in range(100) for name in sampler(whole, SINGLE).batch(step)[0].instructions
    ]

    share = np.mean([name.startswith("open") for name in instructions])
    assert abs(share - 0.5) < 0.07  # 600 draws; three standard deviations are 0.06


def test_chosen_tasks_alone_are_drawn(whole):
    frames, _ = sampler(whole, tasks=("open",)).batch(0)

    assert set(frames.instructions) == {"open to 0"}


def test_a_task_without_episodes_is_refused(whole):
    with pytest.raises(ValueError, match=r"no train episodes of shut; it has those of count, open"):
        sampler(whole, tasks=("open", "shut"))


def test_every_window_is_drawn_the_last_one_included(whole):
    cuts = [sampler(whole, tasks=("open",)).cut(step, 0) for step in range(120)]

    assert {(cut.start, cut.stop) for cut in cuts} == {(s, s + 4) for s in range(6)}


def test_windows_reach_the_ends_of_an_episode_more_often_than_by_chance(whole):
    """Where a count is complete tells most, and only the last window holds it."""
    whole_sampler = sampler(whole, tasks=("open",))
    cuts = [whole_sampler.cut(step, 0) for step in range(600)]

    held = np.array([sum(cut.start <= k < cut.stop for cut in cuts) / 600 for k in range(9)])

    assert held[[0, -1]] == pytest.approx(4 / 12, abs=0.08)  # of six windows, each as likely: 1/6
    assert held.min() > 0.25


def test_every_keyframe_is_drawn_alone(whole):
    cuts = [sampler(whole, SINGLE, tasks=("open",)).cut(step, 0) for step in range(150)]

    assert {cut.start for cut in cuts} == set(range(9))


def test_an_archive_is_the_past_and_all_of_it(whole):
    for step in range(10):
        frames, targets = sampler(whole).batch(step)
        for element in range(6):
            present = frames.present[element]
            supervised = targets.supervised[element]
            decisions = frames.decision[element][present].tolist()
            assert decisions == list(range(len(decisions)))  # nothing left out, in order
            assert not (supervised & ~present).any()
            first = int(supervised.nonzero()[0])
            assert all(supervised[first : first + int(supervised.sum())])
            assert not supervised[:first].any()
            assert int(supervised.sum()) == min(4, len(decisions))


def test_no_archive_is_longer_than_the_longest_of_its_batch(whole):
    frames, targets = sampler(whole).batch(0)

    assert frames.present[:, 0].any()
    first = targets.supervised.int().argmax(dim=1)
    assert len(set(first.tolist())) == 1
    assert frames.shape == (6, int(first[0]) + 4)


def test_the_literal_protocol_has_no_archive(whole):
    frames, targets = sampler(whole, archive="literal").batch(0)

    assert frames.shape == (6, 4)
    assert torch.equal(frames.present, targets.supervised)
    assert frames.decision.max() > 3


def test_short_episodes_are_padded_at_the_end(whole):
    cuts = [(step, e) for step in range(40) for e in range(6)]
    step, element = next(
        (step, e) for step, e in cuts if sampler(whole).cut(step, e).episode.keyframes == 3
    )

    frames, targets = sampler(whole, archive="literal").batch(step)

    assert frames.present[element].tolist() == [True, True, True, False]
    assert targets.supervised[element].tolist() == [True, True, True, False]
    assert targets.evidence[element, 3] == -1


def test_points_belong_to_their_keyframe(whole):
    frames, _ = sampler(whole, augment=STILL).batch(1)
    steps = frames.shape[1]

    decision = frames.decision.flatten()[frames.owner]
    assert torch.equal((frames.colors[:, 0] * 255 / SHADE).round().long(), decision)
    assert frames.present.flatten()[frames.owner].all()
    assert frames.owner.max() < 6 * steps
    assert torch.equal(frames.owner, frames.owner.sort().values)


def test_targets_are_those_of_the_keyframe(whole):
    frames, targets = sampler(whole, augment=STILL, tasks=("open",)).batch(0)
    part = whole.part("open", "train")

    rows = frames.decision[frames.present]
    action = part.action_pose[rows]
    assert torch.equal(targets.rotation[frames.present], torch.from_numpy(encode(action[:, 3:])))
    np.testing.assert_allclose(targets.position[frames.present], to_cube(action[:, :3]), atol=1e-6)
    np.testing.assert_allclose(
        frames.pose[frames.present][:, :3], to_cube(part.pose[rows, :3]), atol=1e-6
    )
    for name in ("ignore_collisions", "stage", "boundary", "stop", "evidence"):
        values = getattr(targets, name)[frames.present]
        np.testing.assert_array_equal(values, getattr(part, name)[rows])
    np.testing.assert_array_equal(targets.opening[frames.present], rows % 2)
    np.testing.assert_allclose(frames.fingers[frames.present][:, 0], part.opening[rows], atol=1e-6)
    assert float(frames.fingers.max()) <= 1 and float(frames.fingers[..., 1:].max()) <= 0.04


def test_a_sequence_is_moved_as_one(whole):
    (still, before), (moved, after) = (
        sampler(whole, augment=augment).batch(5) for augment in (STILL, SLIGHT)
    )

    assert not torch.allclose(before.position, after.position)
    for element, present in enumerate(still.present):
        mine = torch.div(still.owner, still.shape[1], rounding_mode="floor") == element
        distances = [
            torch.cdist(
                targets.position[element, present],
                torch.cat([frames.points[mine], frames.pose[element, present, :3]]),
                compute_mode="donot_use_mm_for_euclid_dist",
            )
            for frames, targets in ((still, before), (moved, after))
        ]
        torch.testing.assert_close(*distances, atol=1e-5, rtol=0)


def test_sequences_of_a_batch_are_moved_apart(whole):
    placements = [sampler(whole).cut(0, element).placement for element in range(6)]

    assert len({placement.turn for placement in placements}) == 6


def test_points_that_leave_the_cube_are_dropped(whole):
    still, moved = (sampler(whole, augment=augment).batch(5)[0] for augment in (STILL, Augment()))

    assert moved.points.abs().max() <= 1
    assert 0 < len(moved.points) < len(still.points)
    assert len(moved.points) == len(moved.colors) == len(moved.owner)


def test_a_loader_gives_the_batches_in_order(whole):
    made = sampler(whole)

    with Loader(made, 7) as loader:
        for step in (7, 8, 9, 10):
            assert equal(next(loader), made.batch(step))
        assert 0 <= loader.share <= 1

    assert list(loader) == []


class Slow:
    """Takes its time, then fails."""

    def __init__(self, seconds: float, last: int):
        self.seconds, self.last = seconds, last

    def batch(self, step: int):
        time.sleep(self.seconds)
        if step > self.last:
            raise OSError(f"no step {step}")
        return step


def test_what_goes_wrong_ahead_is_raised_in_its_place():
    with Loader(Slow(0.0, 2), 1) as loader:  # type: ignore[arg-type]
        assert (next(loader), next(loader)) == (1, 2)
        with pytest.raises(OSError, match="no step 3"):
            next(loader)


def test_a_loader_measures_how_long_it_was_waited_for():
    with Loader(Slow(0.1, 10), 0) as loader:  # type: ignore[arg-type]
        next(loader)
        next(loader)
        hungry = loader.share

        time.sleep(0.5)
        waited = loader.waited
        next(loader)

    assert hungry > 0.8
    assert loader.waited - waited < 0.05


def test_a_loader_that_nobody_reads_can_be_closed():
    threads = threading.active_count()
    loader = Loader(Slow(0.0, 1000), 0)  # type: ignore[arg-type]
    time.sleep(0.1)

    loader.close()

    assert threading.active_count() == threads
