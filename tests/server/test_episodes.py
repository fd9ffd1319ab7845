"""Episodes: filtered, in pages, with their neighbours and what is known of each."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from hide_tasks import load
from hide_tasks.contract import EpisodeSpec, Failure
from server import episodes
from server.blobs import Blobs
from server.db import Database
from server.problems import Problem
from tests.server import ledgers


def outcome(spec: EpisodeSpec) -> Failure | None:
    if spec.index == 0:
        return Failure.OVERCOUNT
    return Failure.UNDERCOUNT if spec.index in (1, 2) else None


TASKS = ["push_button_times", "reopen_drawer", "search_drawer"]


class Ledger(NamedTuple):
    """An older evaluation that is completed, and a newer one that waits."""

    database: Database
    done: str
    waits: str


@pytest.fixture(scope="module")
def ledger(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ledger]:
    folder = tmp_path_factory.mktemp("episodes")
    database = ledgers.opened(folder)
    ledgers.registered(database, "mine")
    done = ledgers.evaluated(
        database, Blobs(folder / "blobs"), "mine", outcome, tasks=TASKS, episodes=6
    )
    with database.writing() as session:
        waits = ledgers.created(session, "noop", tasks=["search_drawer"], episodes=5).id
    yield Ledger(database, done, waits)
    database.close()


def listed(ledger: Ledger, limit: int = 200, **filters: Any) -> list[tuple[str, str, int]]:
    """Evaluation, task and index of every episode of all pages, in order."""
    found, cursor = [], None
    with ledger.database.reading() as session:
        while True:
            page = episodes.listed(session, limit=limit, cursor=cursor, **filters)
            assert len(page.items) <= limit
            found += [(one.evaluation, one.task, one.index) for one in page.items]
            if (cursor := page.next) is None:
                return found


def all_of(ledger: Ledger) -> list[tuple[str, str, int]]:
    waiting = [(ledger.waits, "search_drawer", index) for index in range(5)]
    return waiting + [(ledger.done, task, index) for task in TASKS for index in range(6)]


@pytest.mark.parametrize("limit", [1, 7, 22, 23, 24])
def test_pages_show_every_episode_once(ledger: Ledger, limit: int) -> None:
    assert listed(ledger, limit) == all_of(ledger)


def test_pages_show_everything_once_while_evaluations_are_added(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)
    with database.writing() as session:
        there = ledgers.created(session, tasks=["search_drawer"], episodes=23).id
    found, cursor = [], None
    while True:
        with database.writing() as session:
            page = episodes.listed(session, limit=7, cursor=cursor)
            ledgers.created(session, tasks=["search_drawer"], episodes=3)
        found += [one.index for one in page.items if one.evaluation == there]
        if (cursor := page.next) is None:
            break
    database.close()

    assert found == list(range(23))


@pytest.mark.parametrize(
    ("filters", "indices"),
    [
        ({"success": False}, {1, 2}),
        ({"success": True}, {0, 3, 4, 5}),
        ({"exact": True}, {3, 4, 5}),
        ({"exact": False}, {0, 1, 2}),
        ({"exact": False, "success": True}, {0}),
        ({"failure": Failure.UNDERCOUNT}, {1, 2}),
        ({"failure": Failure.DROPPED_OBJECT}, set()),
        ({"state": "final"}, {0, 1, 2, 3, 4, 5}),
        ({"state": "pending"}, set()),
        ({"category": "RC", "failure": Failure.OVERCOUNT}, {0}),
    ],
)
def test_filters_choose(ledger: Ledger, filters: dict[str, Any], indices: set[int]) -> None:
    found = listed(ledger, evaluation=ledger.done, **filters)

    assert {index for _, _, index in found} == indices


def test_filters_by_what_was_played(ledger: Ledger) -> None:
    assert {one[0] for one in listed(ledger, policy="mine")} == {ledger.done}
    assert {one[0] for one in listed(ledger, policy="noop")} == {ledger.waits}
    assert {one[1] for one in listed(ledger, task="search_drawer")} == {"search_drawer"}
    assert {one[1] for one in listed(ledger, category="RC")} == {"push_button_times"}
    assert listed(ledger, policy="nobody") == []


@pytest.mark.parametrize("cursor", ["nonsense", "WyJhIl0", "WyJhIiwiYiIsIjMiXQ", "W10"])
def test_a_foreign_cursor_is_refused(ledger: Ledger, cursor: str) -> None:
    with ledger.database.reading() as session, pytest.raises(Problem, match="not given out"):
        episodes.listed(session, cursor=cursor)


def test_neighbours_lead_through_all_episodes_of_the_evaluation(ledger: Ledger) -> None:
    with ledger.database.reading() as session:
        rows = ledgers.episodes_of(session, ledger.done)
        forwards, here = [], rows[0].id
        while here is not None:
            forwards.append(here)
            here = episodes.get(session, here).next
        backwards, here = [], rows[-1].id
        while here is not None:
            backwards.append(here)
            here = episodes.get(session, here).previous

    assert forwards == [row.id for row in rows] == backwards[::-1]


def test_an_episode_that_waits_says_nothing_yet(ledger: Ledger) -> None:
    with ledger.database.reading() as session:
        [id, *_] = [row.id for row in ledgers.episodes_of(session, ledger.waits)]
        found = episodes.get(session, id)
        known = episodes.decisions(session, id), episodes.spans(session, id)

    assert known == ([], [])
    assert (found.state, found.success, found.exact, found.failure) == ("pending", None, None, None)
    assert (found.recording, found.thumbnail, found.start, found.checks) == (None, None, None, {})
    assert found.budget == load("search_drawer").budget()


def test_the_checks_are_those_at_the_end(ledger: Ledger) -> None:
    with ledger.database.reading() as session:
        rows = ledgers.episodes_of(session, ledger.done)
        checks = [episodes.get(session, row.id).checks["pressed_exactly"] for row in rows[:6]]

    assert checks == [False, False, False, True, True, True]


def test_the_budget_of_parity_is_the_papers(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)
    with database.writing() as session:
        id = ledgers.created(session, tasks=["search_drawer"], episodes=1, rules="parity").id
        [row] = ledgers.episodes_of(session, id)

        assert episodes.get(session, row.id).budget == 25
    database.close()


def test_parity_budgets_agree_with_the_simulators() -> None:
    from hide_tasks.episode import PARITY_BUDGET

    assert episodes.PARITY_BUDGET == PARITY_BUDGET


def test_failures_in_groups(ledger: Ledger) -> None:
    with ledger.database.reading() as session:
        groups = episodes.failure_groups(session, evaluation=ledger.done)

    assert {(one.failure, one.episodes) for one in groups} == {("undercount", 2), ("overcount", 1)}
    assert [one.episodes for one in groups] == sorted(
        (one.episodes for one in groups), reverse=True
    )
    assert sum(one.episodes for one in groups) == 9


def test_spans_come_in_a_fixed_order(ledger: Ledger) -> None:
    with ledger.database.reading() as session:
        [id, *_] = [row.id for row in ledgers.episodes_of(session, ledger.done)]
        found = [(one.kind, one.name, one.time_from) for one in episodes.spans(session, id)]

    kinds = ["hidden", "stage", "belief"]
    assert found == sorted(found, key=lambda one: (kinds.index(one[0]), *one[1:]))
    assert ("hidden", "presses_done", 1.5) in found


@pytest.mark.parametrize(
    "look", [episodes.get, episodes.decisions, episodes.spans, episodes.changes, episodes.row]
)
def test_an_episode_that_is_not_there(ledger: Ledger, look: Any) -> None:
    with ledger.database.reading() as session, pytest.raises(Problem, match="No episode 'ep_x'"):
        look(session, "ep_x")
