"""Spans of hidden state: they cover an episode without gaps, and agree with what was measured."""

from itertools import groupby, pairwise

from hypothesis import given
from hypothesis import strategies as st

from hide_tasks.contract import (
    Attention,
    Belief,
    DecisionRecord,
    HiddenState,
    MotionOutcome,
    Start,
    Stop,
)
from server.spans import Span, derive
from workers.protocol import HiddenChange


def decision(
    number: int, time: float, hidden: HiddenState, stage: str = "search", belief: int | None = None
) -> DecisionRecord:
    return DecisionRecord(
        decision=number,
        time=time,
        action=Stop(),
        outcome=MotionOutcome.NONE,
        stage=stage,
        hidden=hidden,
        checks={},
        success=False,
        belief=None if belief is None else Belief(stage_count=belief),
    )


def start(hidden: HiddenState, stage: str = "search") -> Start:
    return Start(stage=stage, hidden=hidden, checks={})


def change(time: float, number: int, hidden: HiddenState, stage: str = "search") -> HiddenChange:
    return HiddenChange(time=time, decision=number, stage=stage, hidden=hidden)


def lane(spans: list[Span], kind: str, name: str) -> list[Span]:
    return [span for span in spans if (span.kind, span.name) == (kind, name)]


def told(spans: list[Span]) -> list[tuple[object, float, float]]:
    return [(span.value, span.time_from, span.time_to) for span in spans]


def test_an_episode_without_decisions_is_one_moment() -> None:
    spans = derive(start({"presses": 0}), [], [])

    assert told(lane(spans, "hidden", "presses")) == [(0, 0.0, 0.0)]


def test_a_value_that_never_changes_is_one_span() -> None:
    spans = derive(
        start({"item": "top"}), [decision(n, n + 1.0, {"item": "top"}) for n in range(3)], []
    )

    [span] = lane(spans, "hidden", "item")
    assert (span.time_from, span.time_to) == (0.0, 3.0)
    assert (span.decision_from, span.decision_to) == (0, 3)


def test_a_change_seen_only_between_decisions_has_a_span_of_its_own() -> None:
    """Pressed twice within one chunk: the decisions' rows alone say 0, then 2."""
    dense = [change(0.4, 0, {"presses": 1}), change(0.8, 0, {"presses": 2})]

    spans = derive(start({"presses": 0}), [decision(0, 1.0, {"presses": 2})], dense)

    assert told(lane(spans, "hidden", "presses")) == [(0, 0.0, 0.4), (1, 0.4, 0.8), (2, 0.8, 1.0)]


def test_a_value_that_returns_has_two_spans() -> None:
    dense = [change(0.4, 0, {"open": True}), change(0.8, 0, {"open": False})]

    spans = derive(start({"open": False}), [decision(0, 1.0, {"open": False})], dense)

    assert [span.value for span in lane(spans, "hidden", "open")] == [False, True, False]
    assert [span.number for span in lane(spans, "hidden", "open")] == [0, 1, 2]


def test_the_stage_has_a_lane() -> None:
    decisions = [decision(0, 1.0, {}, "search 1"), decision(1, 2.0, {}, "search 2")]

    spans = derive(start({}, "search 1"), decisions, [])

    assert told(lane(spans, "stage", "stage")) == [("search 1", 0.0, 2.0), ("search 2", 2.0, 2.0)]


def test_beliefs_begin_when_they_are_first_said() -> None:
    decisions = [
        decision(0, 1.0, {}),
        decision(1, 2.0, {}, belief=1),
        decision(2, 3.0, {}, belief=2),
    ]

    spans = derive(start({}), decisions, [])

    assert told(lane(spans, "belief", "stage_count")) == [(1, 1.0, 2.0), (2, 2.0, 3.0)]
    assert lane(spans, "belief", "anchor_index") == []


def test_a_belief_stands_at_the_decision_that_was_chosen_by_it() -> None:
    looks = (
        Attention(view="front", slot="window 1", weight=0.25),
        Attention(view="front", slot="anchor", weight=0.75),
        Attention(view="top", slot="stage", weight=1.0),
    )
    belief = Belief(stage_count=1, boundary=0.5, window=(0,), anchor_index=0, attention=looks)
    decisions = [
        decision(0, 1.0, {}),
        decision(1, 2.0, {}).model_copy(update={"belief": belief}),
        decision(2, 3.0, {}),
    ]

    spans = derive(start({}), decisions, [])

    seen = {span.name: (span.value, span.time_from) for span in spans if span.kind == "belief"}
    assert seen == {
        "stage_count": (1, 1.0),
        "boundary": (0.5, 1.0),
        "window": ([0], 1.0),
        "anchor_index": (0, 1.0),
        "front looks at": ("anchor", 1.0),
        "top looks at": ("stage", 1.0),
    }


VALUES = st.none() | st.booleans() | st.sampled_from(["top", "bottom"]) | st.lists(st.text("ab"))
HIDDEN = st.fixed_dictionaries({"item": VALUES, "opened": VALUES})
STAGES = st.sampled_from(["search", "open", "shut"])


@st.composite
def episodes(draw: st.DrawFn) -> tuple[Start, list[DecisionRecord], list[HiddenChange]]:
    """An episode as it is measured: the dense sight agrees with the decision that ends with it."""
    first = start(draw(HIDDEN), draw(STAGES))
    changes = [change(0.0, 0, first.hidden, first.stage)]
    decisions: list[DecisionRecord] = []
    for number in range(draw(st.integers(0, 5))):
        for step in range(draw(st.integers(0, 3))):
            changes.append(change(number + 0.2 * (step + 1), number, draw(HIDDEN), draw(STAGES)))
        ends = draw(st.sampled_from([number + 0.9, number + 1.0]))
        last = changes[-1]
        belief = draw(st.none() | st.integers(0, 2))
        decisions.append(decision(number, ends, last.hidden, last.stage, belief))
    return first, decisions, changes


@given(episodes())
def test_the_spans_of_a_lane_partition_the_time(episode) -> None:
    first, decisions, changes = episode
    end = max([0.0, *(one.time for one in decisions), *(one.time for one in changes)])

    spans = derive(first, decisions, changes)

    for (kind, _), group in groupby(spans, key=lambda span: (span.kind, span.name)):
        lane = list(group)
        assert [span.number for span in lane] == list(range(len(lane)))
        assert lane[-1].time_to == end
        assert kind == "belief" or (lane[0].time_from, lane[0].decision_from) == (0.0, 0)
        assert all(span.time_from <= span.time_to for span in lane)
        assert all(span.decision_from <= span.decision_to for span in lane)
        for one, after in pairwise(lane):
            assert (one.time_to, one.decision_to) == (after.time_from, after.decision_from)
            assert one.value != after.value


@given(episodes())
def test_spans_say_what_the_decisions_say(episode) -> None:
    first, decisions, changes = episode

    spans = derive(first, decisions, changes)

    for one in decisions:
        said = {("hidden", name): value for name, value in one.hidden.items()}
        said["stage", "stage"] = one.stage
        for (kind, name), value in said.items():
            at = [span for span in lane(spans, kind, name) if span.time_from <= one.time]
            assert at[-1].value == value


@given(episodes())
def test_every_change_that_was_seen_is_told(episode) -> None:
    first, decisions, changes = episode
    seen = [value for value, _ in groupby(one.hidden["item"] for one in changes)]

    spans = derive(first, decisions, changes)

    assert [span.value for span in lane(spans, "hidden", "item")] == seen
