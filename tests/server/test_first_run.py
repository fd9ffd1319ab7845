from pathlib import Path

from sqlalchemy import select

from server.first_run import REFERENCES, evaluate_references
from server.models import Evaluation
from tests.server import ledgers


def test_a_new_server_evaluates_the_reference_policies_once(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)

    with database.writing() as session:
        first = evaluate_references(session)
    with database.writing() as session:
        second = evaluate_references(session)
        found = session.scalars(select(Evaluation).order_by(Evaluation.id)).all()

    assert (first, second) == (True, False)
    assert [one.policy_version.policy.name for one in found] == list(REFERENCES)
    assert all(one.policy_version.reference and one.episodes == 25 for one in found)
    database.close()


def test_a_ledger_with_evaluations_is_left_alone(tmp_path: Path) -> None:
    database = ledgers.opened(tmp_path)
    with database.writing() as session:
        ledgers.created(session, "noop", episodes=1)

    with database.writing() as session:
        assert not evaluate_references(session)
    database.close()
