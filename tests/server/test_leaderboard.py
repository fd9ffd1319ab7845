"""The leaderboard: only whole evaluations, the latest of each version, with honest ranks."""

from collections.abc import Iterator
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import pytest

from hide_tasks import SUITES
from hide_tasks.certificates import certificate
from hide_tasks.contract import EpisodeSpec, Failure
from server import lifecycle
from server.blobs import Blobs
from server.db import Database
from server.leaderboard import ceilings, leaderboard
from server.schemas.common import Verdict
from server.schemas.leaderboard import Leaderboard, LeaderboardRow
from tests.server import ledgers
from tests.server.ledgers import Outcomes

WHOLE = 25 * len(SUITES["hide"])
PROOFS = {task: certificate(task) for task in SUITES["hide"]}


def exact(_: EpisodeSpec) -> None:
    return None


def failing(below: int, failure: Failure = Failure.UNDERCOUNT) -> Outcomes:
    """Every episode with a smaller index fails."""
    return lambda spec: failure if spec.index < below else None


PLAYED: list[tuple[str, Outcomes]] = [
    ("lucky", exact),
    ("lucky", failing(20)),
    ("best", failing(5)),  # its first version; the second is registered below
    ("best", exact),
    ("steady", failing(5)),
    ("sloppy", failing(25, Failure.OVERCOUNT)),  # a success of the paper's, and not exact
    ("never", failing(25)),
    ("expert", exact),
    ("noop", failing(25)),
]


class Ledger(NamedTuple):
    """A ledger of whole evaluations, oldest first."""

    database: Database
    ids: list[str]

    def board(self, verdict: Verdict = "success") -> Leaderboard:
        with self.database.reading() as session:
            return leaderboard(session, verdict=verdict)

    def row(self, policy: str, version: int = 1) -> LeaderboardRow:
        [row] = [row for row in self.board().rows if (row.policy, row.version) == (policy, version)]
        return row


@pytest.fixture(scope="module")
def ledger(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ledger]:
    folder = tmp_path_factory.mktemp("leaderboard")
    database, store = ledgers.opened(folder), Blobs(folder / "blobs")
    for name in ("lucky", "best", "steady", "sloppy", "never"):
        ledgers.registered(database, name)
    ids = []
    for number, (policy, outcomes) in enumerate(PLAYED):
        if number == 3:
            ledgers.registered(database, "best")
        ids.append(ledgers.evaluated(database, store, policy, outcomes))
    with database.writing() as session:
        ledgers.created(session, "best")
    yield Ledger(database, ids)
    database.close()


def test_equal_rates_share_a_rank_and_the_next_one_is_left_out(ledger: Ledger) -> None:
    standing = [(row.rank, f"{row.policy}@{row.version}") for row in ledger.board().rows]

    assert sorted(standing[:2]) == [(1, "best@2"), (1, "sloppy@1")]
    assert sorted(standing[2:4]) == [(3, "best@1"), (3, "steady@1")]
    assert standing[4:6] == [(5, "lucky@1"), (6, "never@1")]


def test_reference_policies_follow_without_a_rank(ledger: Ledger) -> None:
    rows = ledger.board().rows

    assert [(row.rank, row.policy) for row in rows[6:]] == [(None, "expert"), (None, "noop")]
    assert [row.reference for row in rows] == [False] * 6 + [True] * 2


def test_each_verdict_ranks_by_itself(ledger: Ledger) -> None:
    ranks = {row.policy: row.rank for row in ledger.board("exact").rows if row.version == 1}

    assert (ledger.row("sloppy").rank, ranks["sloppy"]) == (1, 5)
    assert ranks["never"] == 5


def test_a_row_tells_the_rates_of_tasks_categories_and_all(ledger: Ledger) -> None:
    row = ledger.row("steady")

    assert (row.overall.success.successes, row.overall.success.episodes) == (WHOLE * 4 // 5, WHOLE)
    assert row.overall.success.low < 0.8 < row.overall.success.high
    assert {task: one.success.value for task, one in row.tasks.items()} == dict.fromkeys(
        SUITES["hide"], 0.8
    )
    assert sum(one.success.episodes for one in row.categories.values()) == WHOLE
    assert ledger.row("sloppy").overall.exact.value == 0.0


def test_a_version_stands_with_its_latest_evaluation_not_its_best(ledger: Ledger) -> None:
    assert ledger.row("lucky").evaluation == ledger.ids[1]
    assert ledger.row("lucky").overall.success.value == pytest.approx(0.2)


def test_an_evaluation_under_way_does_not_displace_the_last_one(ledger: Ledger) -> None:
    assert ledger.row("best", 2).evaluation == ledger.ids[3]


def test_what_is_not_shown_is_counted(ledger: Ledger) -> None:
    assert ledger.board().unlisted == 2  # superseded, and under way


def test_the_columns_are_the_tasks_by_category(ledger: Ledger) -> None:
    columns = [
        (["RC", "HSR", "EPT"].index(one.category), one.task) for one in ledger.board().columns
    ]

    assert columns == sorted(columns)
    assert {task for _, task in columns} == set(SUITES["hide"])


def test_an_evaluation_of_another_suite_version_is_not_mixed_in(
    ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hide_tasks.suite.VERSION", 2)

    assert ledger.board().rows == []


def test_what_is_not_whole_is_not_shown(tmp_path: Path) -> None:
    database, store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")
    ledgers.evaluated(database, store, episodes=1)
    ledgers.evaluated(database, store, tasks=["search_drawer"])
    ledgers.evaluated(database, store, episodes=1, rules="parity")
    ledgers.evaluated(database, store, split="val", episodes=1)
    with database.writing() as session:
        lifecycle.cancel(session, ledgers.created(session, "expert"))

    with database.reading() as session:
        test, val = leaderboard(session), leaderboard(session, split="val")
    database.close()
    assert (test.rows, test.unlisted, val.rows, val.unlisted) == ([], 4, [], 1)


@pytest.mark.parametrize("verdict", ["success", "exact"])
def test_the_ceilings_are_the_certificates(verdict: Verdict) -> None:
    wanted = {
        task: proof and getattr(proof, f"ceiling_{verdict}") for task, proof in PROOFS.items()
    }

    found = ceilings(verdict)

    assert {task: found[task] for task in SUITES["hide"]} == wanted
    whole = None not in wanted.values()
    assert found["overall"] == (pytest.approx(fmean(wanted.values())) if whole else None)
