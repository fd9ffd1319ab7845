"""What a recording shows of a policy's memory."""

from pathlib import Path

import pytest

from hide_tasks.contract import Attention, Belief
from tests.workers.test_recording import (
    INSTRUCTION,
    SPEC,
    START,
    observation,
    parts,
    record,
    result,
    rows,
)
from workers.recording import Recorder
from workers.recording_memory import summary

LOOKS = (
    Attention(view="front", slot="window 1", weight=0.25),
    Attention(view="front", slot="anchor", weight=0.75),
    Attention(view="top|left", slot="anchor", weight=1.0),
)
BELIEF = Belief(
    stage_count=2,
    boundary=0.125,
    window=(3, 4, 5),
    anchor_index=1,
    anchor_similarity=0.5,
    attention=LOOKS,
)


def recorded(path: Path, *beliefs: Belief | None) -> Path:
    """Decisions that last a second each, and a belief at each of them."""
    with Recorder(path) as recorder:
        recorder.begin(SPEC, INSTRUCTION, parts(), START)
        for number, belief in enumerate(beliefs):
            recorder.decided(observation(number), record(number, belief=belief))
        recorder.end(result(), observation(len(beliefs)))
    return path


def test_a_belief_stands_at_the_decision_that_was_chosen_by_it(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd", None, BELIEF)

    assert rows(path, "/memory/stage_count", "StateChange:state") == {(1.0, 1): "2"}
    assert rows(path, "/memory/window", "StateChange:state") == {(1.0, 1): "3, 4, 5"}
    assert rows(path, "/memory/anchor_index", "StateChange:state") == {(1.0, 1): "1"}
    assert rows(path, "/signals/anchor_similarity", "Scalars:scalars") == {(1.0, 1): 0.5}
    assert rows(path, "/signals/boundary", "Scalars:scalars") == {(1.0, 1): 0.125}


def test_attention_is_a_series_for_each_view_and_slot(tmp_path: Path) -> None:
    other = BELIEF.model_copy(update={"attention": LOOKS[1:2]})

    path = recorded(tmp_path / "a.rrd", BELIEF, other)

    anchor = rows(path, "/attention/front/anchor", "Scalars:scalars")
    assert anchor == {(0.0, 0): 0.75, (1.0, 1): 0.75}
    window = rows(path, "/attention/front/window\\ 1", "Scalars:scalars")
    assert window == {(0.0, 0): 0.25}
    assert len(rows(path, "/attention/top\\|left/anchor", "Scalars:scalars")) == 1


def test_a_recording_without_belief_has_no_memory(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd", None, None)

    for entity in ("/memory/**", "/attention/**", "/signals/boundary"):
        assert rows(path, entity, "") == {}


def test_a_policy_may_believe_nothing(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.rrd", Belief(), Belief(window=()))

    assert rows(path, "/memory/window", "StateChange:state") == {(1.0, 1): "–"}


def test_the_table_tells_shares_and_the_most_of_a_view() -> None:
    lines = summary(BELIEF).splitlines()

    assert lines[0] == (
        "stages done **2** · a stage ends **12 %** · window **3, 4, 5** · "
        "anchor **1** · similarity **0.50**"
    )
    assert lines[2:] == [
        "| looks at | front | top/left |",
        "|---|---|---|",
        "| window 1 | 25 % ▂▂ | – |",
        "| anchor | **75 % ▂▂▂▂▂▂▂▂** | **100 % ▂▂▂▂▂▂▂▂▂▂** |",
    ]


@pytest.mark.parametrize("belief", [Belief(), Belief(stage_count=0)])
def test_without_attention_there_is_no_table(belief: Belief) -> None:
    assert "|" not in summary(belief)
