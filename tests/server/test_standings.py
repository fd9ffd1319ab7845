"""The leaderboard as it is asked for: filters leave out, sorting orders, ranks stay."""

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from pydantic import ValidationError

from hide_tasks import SUITES, load
from hide_tasks.contract import Category
from server import leaderboard
from server.schemas.common import RatePublic, Verdicts
from server.schemas.leaderboard import BeliefPublic, Leaderboard, LeaderboardRow, NormalisedPublic
from server.schemas.policies import PolicyFacts
from server.standings import SORTS, BoardQuery, shown, value_of

NEW = datetime(2026, 3, 2, 8, tzinfo=UTC)


def row(name: str, rank: int | None, per_task: int, **more: Any) -> LeaderboardRow:
    """A policy with so many successes in the 25 episodes of every task, one less of them exact."""

    def of(tasks: int) -> Verdicts:
        exact = max(per_task - 1, 0) * tasks
        return Verdicts(
            success=RatePublic.of(per_task * tasks, 25 * tasks),
            exact=RatePublic.of(exact, 25 * tasks),
        )

    usual = {"ended": NEW, "owner": None, "facts": None, "belief": None, "normalised": None}
    return LeaderboardRow(
        rank=rank,
        rank_best=rank,
        rank_worst=rank,
        evaluation=f"ev_{name}",
        policy=name,
        version=1,
        reference=rank is None,
        tasks={task: of(1) for task in SUITES["hide"]},
        categories={str(kind): of(5) for kind in Category},
        overall=of(15),
        gap=RatePublic.of(15 if per_task else 0, 375),
        **{**usual, **more},
    )


def facts(memory: str, clock: bool | None, privileged: bool | None = False) -> PolicyFacts:
    return PolicyFacts(source="declared", memory=memory, clock=clock, privileged=privileged)


def said(right: int) -> BeliefPublic:
    return BeliefPublic(right=right, decisions=100, episodes=10, value=right / 100, low=0, high=1)


def norm(value: float) -> NormalisedPublic:
    return NormalisedPublic(value=value, low=-1, high=1, tasks=["search_drawer"], episodes=25)


ROWS = [
    row("seek", 1, 20, owner="ann", facts=facts("SCM", True), belief=said(80), normalised=norm(-1)),
    row("Open", 2, 15, owner="bob", facts=facts("none", False), normalised=norm(0.5)),
    row("told", 3, 10, facts=facts("SCM", None), belief=said(90), ended=NEW - timedelta(days=9)),
    row("old", 4, 0),
    row("expert", None, 25, facts=facts("script", False, True)),
    row("noop", None, 0, facts=facts("none", False)),
]
BOARD = Leaderboard(
    suite="hide 1",
    split="test",
    verdict="success",
    columns=leaderboard.columns(),
    ceilings={},
    rows=ROWS,
    unlisted=0,
)


def names(**wanted: Any) -> list[str]:
    return [one.policy for one in shown(BOARD, BoardQuery.model_validate(wanted)).rows]


def test_all_of_it_in_its_own_order_is_the_same_board() -> None:
    assert shown(BOARD, BoardQuery()) is BOARD


@pytest.mark.parametrize(
    ("wanted", "left"),
    [
        ({"search": "EE"}, ["seek"]),
        ({"search": "@1"}, ["seek", "Open", "told", "old", "expert", "noop"]),
        ({"search": "k@1"}, ["seek"]),
        ({"memory": "SCM"}, ["seek", "told"]),
        ({"memory": "none"}, ["Open", "noop"]),
        ({"clock": "yes"}, ["seek"]),
        ({"clock": "no"}, ["Open", "expert", "noop"]),
        ({"clock": "unknown"}, ["told", "old"]),
        ({"privileged": "hide"}, ["seek", "Open", "told", "old", "noop"]),
        ({"owner": "ann"}, ["seek"]),
        ({"since": "2026-03-02"}, ["seek", "Open", "old", "expert", "noop"]),
        ({"since": "2026-03-03"}, []),
        ({"memory": "SCM", "clock": "unknown"}, ["told"]),
        ({"owner": "", "since": "", "search": ""}, [one.policy for one in ROWS]),
    ],
)
def test_a_filter_leaves_rows_out(wanted: dict[str, str], left: list[str]) -> None:
    found = shown(BOARD, BoardQuery.model_validate(wanted))

    assert [one.policy for one in found.rows] == left
    assert found.left_out == len(ROWS) - len(left)


def test_ranks_stay_those_among_all() -> None:
    found = shown(BOARD, BoardQuery.model_validate({"memory": "SCM", "sort": "belief"}))

    assert [(one.policy, one.rank) for one in found.rows] == [("told", 3), ("seek", 1)]


@pytest.mark.parametrize(
    ("sort", "best_first"),
    [
        ("policy", ["old", "Open", "seek", "told"]),
        ("overall", ["seek", "Open", "told", "old"]),
        ("normalised", ["Open", "seek", "told", "old"]),
        ("belief", ["told", "seek", "Open", "old"]),
        ("ended", ["seek", "Open", "old", "told"]),
        ("search_drawer", ["seek", "Open", "told", "old"]),
        ("RC", ["seek", "Open", "told", "old"]),
        ("rank", ["seek", "Open", "told", "old"]),
    ],
)
def test_rows_are_sorted_and_references_stay_apart(sort: str, best_first: list[str]) -> None:
    assert names(sort=sort)[:4] == best_first
    assert set(names(sort=sort)[4:]) == {"expert", "noop"}


def test_what_is_missing_comes_last_both_ways() -> None:
    assert names(sort="belief", order="asc")[:4] == ["seek", "told", "Open", "old"]
    assert names(sort="belief", order="desc")[:4] == ["told", "seek", "Open", "old"]


@pytest.mark.parametrize("sort", SORTS)
def test_every_column_sorts_both_ways(sort: str) -> None:
    up, down = names(sort=sort, order="asc"), names(sort=sort, order="desc")

    values = {
        one.policy: one.rank if sort == "rank" else value_of(one, sort, "success")
        for one in ROWS[:4]
    }
    known = [values[name] for name in up[:4] if values[name] is not None]
    assert known == sorted(known)  # type: ignore[type-var]
    assert [values[name] for name in down[:4] if values[name] is not None] == known[::-1]


def test_a_category_leaves_its_columns_alone() -> None:
    found = shown(BOARD, BoardQuery(category=Category.EXECUTION_PROGRESS))

    assert {str(load(one.task).category) for one in found.columns} == {"EPT"}
    assert [one.rank for one in found.rows] == [one.rank for one in ROWS]


@pytest.mark.parametrize(
    "wanted",
    [
        {"sort": "beauty"},
        {"suite": "rlbench"},
        {"since": "soon"},
        {"order": "up"},
        {"owner": "x" * 81},
    ],
)
def test_what_is_no_column_or_day_is_refused(wanted: dict[str, str]) -> None:
    with pytest.raises(ValidationError):
        BoardQuery.model_validate(wanted)
