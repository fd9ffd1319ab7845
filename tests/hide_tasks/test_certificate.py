"""The proofs of what a score means: committed ones hold, and the computation is right."""

import itertools
from statistics import NormalDist

import numpy as np
import pytest

from hide_tasks import ALL_TASKS, suite
from hide_tasks.adversaries import ADVERSARIES
from hide_tasks.amnesiac import Amnesiac, options, signature
from hide_tasks.automaton import Automaton, Crossing, Road, explore
from hide_tasks.certificate import (
    ALIAS_EPISODES,
    ROLLS,
    VERDICTS,
    ceiling_of,
    judge,
)
from hide_tasks.certificates import certificate, committed
from hide_tasks.contract import CAMERAS, CameraView, Keyframe, Observation
from hide_tasks.likeness import JOINTS, PIXELS, likeness
from hide_tasks.mixing import best_mix
from hide_tasks.probe import Sample, probe
from hide_tasks.script import Point, library
from hide_tasks.sources import sources_hash
from hide_tasks.statistics import wilson

QUICKLY_EXPLORED = (  # and of one shape, so that one layout gives the whole ceiling
    "light_bulb_in_out",
    "reopen_drawer",
    "weighing_on_off",
)
LOOKS = len(ALL_TASKS) * len(VERDICTS) * (1 + len(ADVERSARIES))
FAMILY = NormalDist().inv_cdf(1 - 0.05 / LOOKS)  # Bonferroni: one in twenty that any is over it
every_task = pytest.mark.parametrize("name", ALL_TASKS)


@every_task
def test_the_committed_certificate_belongs_to_these_sources(name):
    assert committed(name)["sources"] == sources_hash(name, certified=True), "run `hide certify`"


@every_task
def test_every_declared_pair_was_verified_on_real_episodes(name):
    aliases = committed(name)["aliases"]

    assert aliases or committed(name)["verdict"] == "weak"
    assert not aliases or sum(alias["episodes"] for alias in aliases) >= ALIAS_EPISODES
    for alias in aliases:
        assert alias["verified"]
        assert max(alias["pixels"].values()) <= PIXELS
        assert alias["joints"] <= JOINTS
        assert alias["hidden"][0] != alias["hidden"][1]
        assert alias["next"][0] != alias["next"][1]


@every_task
@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize("policy", ["amnesiac", *ADVERSARIES])
def test_no_policy_without_memory_beats_the_computed_ceiling(name, verdict, policy):
    """One look in forty is over it by chance: the interval is that of all looks together."""
    document = committed(name)
    measured = {"amnesiac": document["amnesiac"], **document["adversaries"]}[policy]
    rolls = ROLLS if policy == "amnesiac" else 1
    successes = round(measured[verdict]["rate"] * measured["episodes"])
    low, _ = wilson(successes, measured["episodes"], FAMILY)

    assert measured["episodes"] == rolls * suite.SPLITS["test"]
    assert low <= document["ceilings"][verdict]


@every_task
def test_the_committed_verdict_follows_from_the_figures(name):
    document = committed(name)

    assert judge(document) == (document["verdict"], document["reason"])
    assert document["probe"]["samples"] >= 200 or not document["aliases"]
    assert certificate(name).verdict == document["verdict"]


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICKLY_EXPLORED)
def test_a_ceiling_computed_anew_is_the_committed_one(name):
    anew = ceiling_of(suite.episode(name, "train", 0))

    for verdict in VERDICTS:
        assert anew[verdict] == pytest.approx(committed(name)["ceilings"][verdict], abs=0.002)


def press_automaton(count, budget):
    """At every crossing: press on, or withdraw and stop."""

    def crossing(done):
        return Crossing(("press", "withdraw"), str(done))

    roads = {}
    for done in range(budget):
        good = done == count
        roads[crossing(done), "withdraw"] = Road(1, 1 if good else None, good, None)
        over = done == count
        roads[crossing(done), "press"] = Road(2, None, False, None if over else crossing(done + 1))
    return Automaton(Road(1, None, False, crossing(0)), roads)


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_the_best_odds_for_a_count_are_those_of_the_closed_form(count):
    mix, value = best_mix([press_automaton(count, 30)], "exact", 30)

    assert mix["press / withdraw"]["press"] == pytest.approx(count / (count + 1), abs=1e-3)
    assert value == pytest.approx((count / (count + 1)) ** count / (count + 1), abs=1e-6)


def test_a_budget_that_is_too_small_takes_the_probability_away():
    automaton = press_automaton(3, 30)

    mix = {"press / withdraw": {"press": 3.0, "withdraw": 1.0}}
    assert automaton.value(mix, "exact", 8) > 0
    assert automaton.value(mix, "exact", 7) == 0


def test_what_is_chosen_after_success_decides_whether_it_is_exact():
    crossing = Crossing(("go on", "stop"), "swapped")
    automaton = Automaton(
        Road(5, 5, True, crossing),
        {
            (crossing, "go on"): Road(3, None, False, None),
            (crossing, "stop"): Road(1, None, True, None),
        },
    )

    assert automaton.value({}, "success", 25) == 1.0
    assert automaton.value({}, "exact", 25) == pytest.approx(0.5)
    assert best_mix([automaton], "exact", 25)[1] == pytest.approx(1.0, abs=1e-5)


def test_a_choice_may_fall_otherwise_where_something_else_is_open():
    first, second = Crossing(("a", "b"), "one"), Crossing(("a", "c"), "two")
    automaton = Automaton(
        Road(1, None, False, first),
        {
            (first, "a"): Road(1, None, False, second),
            (first, "b"): Road(1, None, False, None),
            (second, "a"): Road(1, None, False, None),
            (second, "c"): Road(1, 1, True, None),
        },
    )

    assert best_mix([automaton], "exact", 25)[1] == pytest.approx(1.0, abs=1e-5)


def test_equal_truths_that_look_the_same_are_guessed_evenly():
    names = ("top", "middle", "bottom")
    crossing = Crossing(names, "pressed")
    automata = [
        Automaton(
            Road(6, None, False, crossing),
            {
                (crossing, name): Road(4, 3 if name == truth else None, name == truth, None)
                for name in names
            },
        )
        for truth in names
    ]
    mix, value = best_mix(automata, "exact", 25)

    assert value == pytest.approx(1 / 3, abs=1e-6)
    [odds] = mix.values()
    assert max(odds.values()) - min(odds.values()) < 0.01


def test_exploring_the_simulator_finds_the_closed_form():
    spec = suite.episode("push_button_times", "train", 0).twin({"count": 1})
    points = library(spec)
    automaton = explore(spec, points, 50)

    assert best_mix([automaton], "exact", 25)[1] == pytest.approx(0.25, abs=1e-6)


def test_the_amnesiac_chooses_by_the_present_alone():
    spec = suite.episode("push_button_times", "val", 0).twin({"count": 2})
    policy = Amnesiac({})
    policy.bind(None, spec)
    policy.reset("", 0)
    over_button = [p for p in policy.points if p.keyframes in (1, 3, 5)]

    assert signature(policy.points) == "reach x1, press x4, withdraw x1"
    for point in over_button:
        assert set(options(policy.points, point.observation)) == {"press", "withdraw"}
    picked = {policy.act(over_button[0].observation).position for _ in range(40)}
    assert len(picked) == 2


def test_options_tell_where_in_their_stages_they_are():
    """Over either peg a ring is carried on or put down: two places, for all that they look."""

    def point(script, within, x):
        keyframe = Keyframe(position=(x, 0.0, 1.0), quaternion=(1.0, 0.0, 0.0, 0.0))
        return Point(script, within, observation(), keyframe, f"carry {script}", within, {})

    over_left = options([point(0, 3, 0.1), point(1, 4, 0.2)], observation())
    over_right = options([point(0, 4, 0.1), point(1, 3, 0.2)], observation())

    assert set(over_left) == {"carry 0 from 3", "carry 1 from 4"}
    assert set(over_right) == {"carry 0 from 4", "carry 1 from 3"}


def observation(seed=0, joints=0.0, shade=0):
    rng = np.random.default_rng(seed)
    views = {
        name: CameraView(
            (rng.integers(0, 200, (128, 128, 3)) + shade).astype(np.uint8),
            rng.uniform(0.5, 2, (128, 128)).astype(np.float32),
            np.eye(3),
            np.eye(4),
        )
        for name in CAMERAS
    }
    return Observation(views, np.zeros(7), 1.0, np.full(7, joints), "")


def test_likeness_is_strict_about_each_part():
    same = observation()

    assert likeness(same, observation()).alike
    assert likeness(same, observation(shade=8)).alike
    assert not likeness(same, observation(shade=9)).alike
    assert not likeness(same, observation(joints=0.006)).alike
    assert not likeness(same, observation(seed=1)).alike


def test_the_probe_sees_what_is_visible_and_nothing_else():
    layouts = range(40)
    blind = [
        Sample(i, 0, observation(seed=i), label) for i, label in itertools.product(layouts, "ab")
    ]
    seeing = [
        Sample(i, 0, observation(seed=i, shade=40 * (label == "b")), label)
        for i, label in itertools.product(layouts, "ab")
    ]

    assert probe(blind)["nearest"]["accuracy"] <= 0.5
    assert not probe(seeing)["blind"]
    assert probe(seeing)["linear"]["accuracy"] > 0.9


def test_the_probe_may_see_which_moments_look_alike():
    samples = [
        Sample(i, 0, observation(seed=i, shade=20 * (i % 2)), f"{'ab'[i % 2]}{label}")
        for i, label in itertools.product(range(100), "12")
    ]
    report = probe(samples)

    assert (report["chance"], report["blind"]) == (0.5, True)
    assert report["nearest"]["accuracy"] == 0.5


SEES = {"blind": False, "chance": 0.5, "nearest": {"high": 0.55}, "linear": {"high": 0.67}}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"ceilings": {"exact": 0.9}}, "exact in 90%"),
        ({"aliases": []}, "No two moments"),
        ({"aliases": [{"verified": False}]}, "declared pair"),
        ({"probe": SEES}, "interval ends at 67%, chance is 50%"),
    ],
)
def test_a_certificate_is_weak_for_one_named_reason(change, word):
    strong = {
        "ceilings": {"exact": 0.3},
        "aliases": [{"verified": True}],
        "probe": {"blind": True},
    }

    assert judge(strong)[0] == "strong"
    verdict, reason = judge({**strong, **change})
    assert verdict == "weak" and word in reason
