import logging
from pathlib import Path

import pytest
from sqlalchemy import select

from seek_model import trained
from server import first_run
from server.blobs import Blobs
from server.db import Database
from server.first_run import ORDER, evaluate_own
from server.models import Evaluation
from server.trained_policies import register_trained
from tests.server import ledgers
from tests.workers import checkpoint_files
from workers.policies import BUILTIN


def registered(database: Database, folder: Path, *names: str) -> None:
    """The trained policies of these names are there."""
    folder.mkdir()
    for name in names:
        checkpoint_files.written(trained.path_of(name, folder))
    with database.writing() as session:
        register_trained(session, Blobs(folder / "blobs"), folder)


def queued(database: Database) -> list[Evaluation]:
    with database.reading() as session:
        return list(session.scalars(select(Evaluation).order_by(Evaluation.priority.desc())))


def names(found: list[Evaluation]) -> list[str]:
    return [one.policy_version.policy.name for one in found]


def test_a_new_server_evaluates_its_own_policies_once(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)
    registered(database, tmp_path / "trained", *trained.POLICIES)

    with database.writing() as session:
        first = evaluate_own(session)
    with database.writing() as session:
        second = evaluate_own(session)

    found = queued(database)
    assert (first, second) == (True, False)
    assert names(found) == list(ORDER)
    assert ORDER == ("expert", "amnesiac", "seek-small", "sam2act-small", "random", "noop")
    assert all(one.episodes == 25 for one in found)
    ranked = [
        name for name, one in zip(ORDER, found, strict=True) if not one.policy_version.reference
    ]
    assert ranked == list(trained.POLICIES)
    database.close()


@pytest.mark.parametrize("there", [(), ("sam2act-small",)])
def test_what_did_not_come_along_is_not_evaluated(tmp_path: Path, there: tuple[str, ...]) -> None:
    database = ledgers.opened(tmp_path)
    registered(database, tmp_path / "trained", *there)

    with database.writing() as session:
        evaluate_own(session)

    assert names(queued(database)) == [name for name in ORDER if name in (*BUILTIN, *there)]
    database.close()


def test_without_torch_trained_policies_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    database = ledgers.opened(tmp_path)
    registered(database, tmp_path / "trained", "seek-small")
    monkeypatch.setattr(first_run, "has_torch", lambda: False)

    with caplog.at_level(logging.WARNING), database.writing() as session:
        evaluate_own(session)

    assert names(queued(database)) == [name for name in ORDER if name in BUILTIN]
    assert "Not evaluated: seek-small. PyTorch is not installed" in caplog.text
    database.close()


def test_a_ledger_with_evaluations_is_left_alone(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)
    with database.writing() as session:
        ledgers.created(session, "noop", episodes=1)

    with database.writing() as session:
        assert not evaluate_own(session)
    database.close()
