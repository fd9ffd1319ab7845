"""How often a policy's stated number of stages is right: against decisions counted one by one."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hide_tasks.contract import Belief, EpisodeSpec
from server import beliefs, lifecycle
from server.beliefs import Heard, Span, changed, public, right
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.leaderboard import leaderboard
from tests.server import ledgers
from tests.server.ledgers import Outcome, result_of
from workers.protocol import EpisodeCommit, HiddenChange, measured_digest

STAGES = ("press 1", "press 1", "press 2", "press 3")  # before each decision, and at the end


def stating(
    spec: EpisodeSpec, said: Sequence[int | None], failure: Outcome = None
) -> EpisodeCommit:
    """An episode of three decisions in which a policy states these numbers of stages."""
    plain = result_of(spec, failure)
    decisions = tuple(
        one.model_copy(update={"belief": None if count is None else Belief(stage_count=count)})
        for one, count in zip(plain.decisions, said, strict=True)
    )
    changes = tuple(
        HiddenChange(time=1.5 * n, decision=max(n - 1, 0), stage=stage, hidden={"n": n})
        for n, stage in enumerate(STAGES)
    )
    measured = (plain.result, plain.start, decisions, changes)
    update = {"decisions": decisions, "changes": changes, "digest": measured_digest(*measured)}
    return plain.model_copy(update=update)


def evaluated(database: Database, store: Blobs, policy: str, said: dict[int, Sequence]) -> str:
    """An evaluation in which a policy states, by index, these numbers of stages."""
    with database.writing() as session:
        id = ledgers.created(session, policy).id
        while found := ledgers.leased(session):
            attempt, shard = found
            for episode in lifecycle.open_episodes(shard):
                lifecycle.begin(session, attempt, episode)
                spec = lifecycle.spec_of(episode)
                what = stating(spec, said.get(spec.index, (None,) * 3))
                commit(session, store, attempt, episode, what)
            session.flush()
            lifecycle.end_attempt(session, attempt, None)
        return id


@pytest.fixture(scope="module")
def ledger(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Database, str]]:
    """One evaluation with statements, whose id is given, and one without."""
    folder = tmp_path_factory.mktemp("beliefs")
    database, store = ledgers.opened(folder), Blobs(folder / "blobs")
    ledgers.registered(database, "mine")
    ledgers.registered(database, "silent")
    id = evaluated(database, store, "mine", {0: (0, 0, 1), 1: (0, 1, 1), 2: (2, 2, 2)})
    ledgers.evaluated(database, store, "silent")
    yield database, id
    database.close()


def test_a_row_tells_how_often_what_is_stated_is_true(ledger: tuple[Database, str]) -> None:
    with ledger[0].reading() as session:
        rows = {row.policy: row.belief for row in leaderboard(session).rows}

    said = rows["mine"]
    assert said is not None and rows["silent"] is None
    assert (said.right, said.decisions, said.episodes) == (15 * 5, 15 * 9, 15 * 3)
    assert said.low < 5 / 9 < said.high


def test_what_was_counted_once_is_not_read_again(
    ledger: tuple[Database, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    database, id = ledger
    with database.reading() as session:
        first = beliefs.told(session, [id])
        monkeypatch.setattr(beliefs, "heard", None)
        assert beliefs.told(session, [id]) == first


def test_what_changes_back_within_a_decision_did_not_change() -> None:
    stages = [Span("a", 0, 2), Span("b", 2, 2), Span("a", 2, 5), Span("c", 5, 9)]

    assert changed(stages) == [5]


@given(
    true=st.lists(st.sampled_from("abc"), min_size=1, max_size=12),
    said=st.lists(st.integers(0, 5), min_size=1, max_size=12),
)
def test_spans_agree_as_often_as_decisions_one_by_one(true: list[str], said: list[int]) -> None:
    count = min(len(true), len(said))
    true, said = true[:count], said[:count]  # the stage before each decision, and what is said
    counts = [sum(a != b for a, b in pairwise(true[: n + 1])) for n in range(count)]

    expected = sum(one == other for one, other in zip(counts, said, strict=True))

    # A stage that stands before decision n began in the one before.
    stages = _runs(true, [max(n - 1, 0) for n in range(count)], count)
    assert right(_runs(said, list(range(count)), count), stages) == expected


def _runs(values: Sequence, places: Sequence[int], end: int) -> list[Span]:
    firsts = [n for n in range(len(values)) if n == 0 or values[n] != values[n - 1]]
    ends = [*(places[n] for n in firsts[1:]), end]
    return [Span(str(values[n]), places[n], after) for n, after in zip(firsts, ends, strict=True)]


def test_an_interval_is_wider_where_whole_episodes_are_right_or_wrong() -> None:
    alike, apart = Heard(), Heard()
    for number in range(40):
        alike = alike.and_episode(right=4 + 2 * (number % 2), decisions=10)
        apart = apart.and_episode(right=10 * (number % 2), decisions=10)

    narrow, wide = public(alike), public(apart)

    assert narrow is not None and wide is not None
    assert narrow.value == wide.value == 0.5
    assert wide.high - wide.low > 1.1 * (narrow.high - narrow.low)


def test_a_policy_that_states_nothing_has_no_accuracy() -> None:
    assert public(Heard()) is None
