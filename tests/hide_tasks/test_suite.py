import itertools
from collections import Counter as Counted
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hide_tasks import ALL_TASKS, UnknownTask, load, suite
from hide_tasks.assets.block import Block
from hide_tasks.assets.button import Button
from hide_tasks.layout import Area, Crowded, Layout
from hide_tasks.task import Counter, Grid


def test_an_unknown_task_is_told_the_nearest_and_all():
    with pytest.raises(UnknownTask, match="Did you mean push_button_times") as caught:
        load("push_buton_times")
    assert all(name in str(caught.value) for name in ALL_TASKS)


@pytest.mark.parametrize(
    ("split", "index", "word"), [("exam", 0, "split"), ("test", 25, "0 to 24")]
)
def test_an_unknown_episode_is_told_what_there_is(split, index, word):
    with pytest.raises(ValueError, match=word):
        suite.episode("search_drawer", split, index)


@pytest.mark.parametrize(
    ("change", "known"),
    [
        ({"version": 2}, "in hide v1 alone"),
        ({"suite": "hide-hard"}, "in hide v1 alone"),
        ({"index": 25}, "0 to 24"),
        ({"variation": {"item_in": "attic"}}, "top, middle, bottom"),
        ({"variation": {"color": "red"}}, "chooses item_in; given: color"),
    ],
)
def test_an_episode_that_this_build_does_not_know_is_told_what_there_is(change, known):
    spec = suite.episode("search_drawer", "test", 3).model_copy(update=change)

    with pytest.raises(ValueError, match=known):
        suite.build(spec)


def test_the_splits_of_a_task_have_no_scene_in_common():
    scenes = {
        split: {suite.scene_hash(spec) for spec in suite.episodes("push_button_times", split)}
        for split in suite.SPLITS
    }

    assert sum(map(len, scenes.values())) == len(set.union(*scenes.values())) == 250


def test_the_policy_seed_does_not_depend_on_the_hidden_state():
    spec = suite.episode("search_drawer", "test", 3)
    assert suite.policy_seed(spec) == suite.policy_seed(spec.twin({"item_in": "bottom"}))


@given(st.integers(1, 6), st.integers(1, 12), st.integers(1, 120), st.integers(0, 2**32 - 1))
def test_a_grid_is_balanced_and_repeats_no_point_too_early(rows, columns, count, seed):
    grid = Grid(row=tuple(range(rows)), column=tuple(range(columns)))
    drawn = grid.balanced(count, np.random.default_rng(seed))

    for axis, values in grid.axes.items():
        counts = [sum(point[axis] == value for point in drawn) for value in values]
        assert max(counts) - min(counts) <= 1
    times = [drawn.count(point) for point in grid]
    assert max(times) <= -(-count // len(grid))


@given(st.sampled_from([(3, 19, 4), (2, 19, 3), (19, 2, 3)]), st.integers(0, 2**32 - 1))
def test_three_axes_whose_lengths_share_no_factor_do_not_tell_each_other(lengths, seed):
    grid = Grid(**{axis: tuple(range(many)) for axis, many in zip("abc", lengths, strict=True)})
    drawn = grid.balanced(100, np.random.default_rng(seed))

    for one, other in itertools.permutations("abc", 2):
        right, least = guessed(drawn, one, other)
        assert right <= least + 0.05
    for axis in "abc":
        times = Counted(point[axis] for point in drawn).values()
        assert max(times) - min(times) <= 1


@pytest.mark.parametrize("name", ALL_TASKS)
def test_what_is_told_does_not_tell_what_is_hidden(name):
    """Nobody guesses better who learns which hidden value goes with a word of the instruction."""
    task = load(name)
    hidden = task.axes().keys() - set(task.told())
    for split in suite.SPLITS:
        drawn = [spec.variation for spec in suite.episodes(name, split)]
        for told, axis in itertools.product(task.told(), hidden):
            right, least = guessed(drawn, told, axis)
            assert right <= least + 0.08, (split, told, axis)


def guessed(drawn, told, hidden):
    """How often the best rule from one axis to another is right, and how often it must be."""
    seen = defaultdict(Counted)
    for point in drawn:
        seen[point[told]][point[hidden]] += 1
    values = len({point[hidden] for point in drawn})
    right = sum(max(times.values()) for times in seen.values())
    least = sum(-(-times.total() // values) for times in seen.values())
    return right / len(drawn), least / len(drawn)


@given(st.lists(st.floats(0, 0.01), max_size=60))
def test_a_counter_counts_each_excursion_once(readings):
    values = iter(readings)
    counter = Counter("press", lambda: next(values), up=0.005, down=0.002)
    counted = sum(counter.watch() for _ in readings)

    high, expected = None, 0
    for value in readings:
        if high is None:
            high = value > 0.005
        elif not high and value > 0.005:
            high, expected = True, expected + 1
        elif high and value < 0.002:
            high = False
    assert counted == counter.total == expected


def test_scattered_assets_keep_their_distance():
    layout = Layout(np.random.default_rng(0))
    buttons = layout.scatter(
        map(Button, ("red", "blue", "green")), Area((0, 0.4), (-0.3, 0.3)), gap=0.05
    )
    for i, a in enumerate(buttons):
        for b in buttons[:i]:
            assert np.linalg.norm(a.at[:2] - b.at[:2]) >= 0.05 + a.radius + b.radius


def test_a_crowded_area_is_an_error():
    with pytest.raises(Crowded, match="No room for 9"):
        Layout(np.random.default_rng(0)).scatter(
            [Block() for _ in range(9)], Area((0, 0.1), (0, 0.1)), gap=0.1
        )
