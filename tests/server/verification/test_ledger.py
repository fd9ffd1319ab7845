"""A ledger that was tampered with, without playing anything again."""

import hashlib
import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from hide_tasks import SUITES
from hide_tasks.contract import EpisodeSpec, Failure
from server import snapshots
from server.blobs import Blobs
from server.data_folder import DataFolder, DataFolderError
from server.db import Database, LedgerError, migrate
from server.read_only import ReadOnlyFolder
from server.settings import LEDGER
from server.verification.findings import Findings
from server.verification.ledger import NoEvaluation, Verifier
from tests.server import ledgers, tampering

TASKS = ["push_button_times", "search_drawer"]


def failing(spec: EpisodeSpec) -> Failure | None:
    return Failure.UNDERCOUNT if spec.index == 1 else None


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A stopped server's, with one evaluation: two tasks, and of each the second episode failed."""
    database = ledgers.opened(tmp_path)
    store = Blobs(tmp_path / "blobs")
    ledgers.evaluated(database, store, outcomes=failing, tasks=TASKS, episodes=2)
    database.close()
    return tmp_path


def verified(folder: Path, evaluation: str | None = None) -> Findings:
    with ReadOnlyFolder.opened(folder) as opened:
        return Verifier(opened, sample=0).verify(evaluation)


def failed(folder: Path) -> str:
    """The id of an episode that failed."""
    query = "SELECT id FROM episodes WHERE task = 'search_drawer' AND \"index\" = 1"
    return str(tampering.ask(folder, query)[0][0])


def test_an_honest_ledger_agrees(folder: Path) -> None:
    found = verified(folder)

    [(id, score)] = found.scores.items()
    assert found.mismatches == []
    assert (found.evaluations, found.episodes, found.files, found.simulated) == (1, 4, 4, 0)
    assert (score.final, score.success, score.exact) == (4, 2, 2)
    assert verified(folder, id).scores == found.scores


def test_an_index_that_does_not_fit_its_table_is_told(folder: Path) -> None:
    with closing(sqlite3.connect(folder / LEDGER)) as opened, opened:
        opened.execute("PRAGMA writable_schema = ON")
        opened.execute(
            "UPDATE sqlite_master SET sql = replace(sql, 'failure, category', 'stage, category') "
            "WHERE name = 'episodes_by_failure'"
        )

    [mismatch] = verified(folder).mismatches
    assert "episodes_by_failure" in str(mismatch) and mismatch.what == "integrity of the file"


def test_nothing_is_written(folder: Path) -> None:
    before = tampering.everything(folder)

    verified(folder)

    assert tampering.everything(folder) == before


def test_a_forged_verdict_is_told_with_the_score_that_it_made(folder: Path) -> None:
    id = failed(folder)
    verdict = "success = 1, exact = 1, failure = NULL"
    tampering.alter(folder, f"UPDATE episodes SET {verdict} WHERE id = '{id}'")

    found = verified(folder)

    told = {(one.subject, one.what): (one.stored, one.found) for one in found.mismatches}
    [evaluation] = found.scores
    assert told[id, "success"] == (True, False)
    assert told[id, "exact"] == (True, False)
    assert told[id, "failure"] == (None, "undercount")
    assert told[evaluation, "success"] == ("3 of 4", "2 of 4")
    assert told[evaluation, "exact"] == ("3 of 4", "2 of 4")
    assert (id, "digest") in told
    assert found.scores[evaluation].success == 2


def test_a_forged_verdict_whose_digest_and_decisions_were_forged_as_well_needs_a_replay(
    folder: Path,
) -> None:
    """Without a key, whoever may write everything makes rows that agree with each other."""
    id = failed(folder)
    tampering.alter(
        folder,
        f"UPDATE episodes SET success = 1, exact = 1, failure = NULL WHERE id = '{id}'",
        "UPDATE decisions SET success = 1, violations = '[]', "
        "checks = '{\"pressed_exactly\": true}' "
        f"WHERE episode_id = '{id}' AND number = 2",
    )
    tampering.seal(folder, id)

    assert verified(folder).mismatches == []  # test_simulation.py plays such a one again


EDITS = {
    "an action": "UPDATE decisions SET action = json_set(action, '$.position[0]', 0.5) "
    "WHERE episode_id = '{id}' AND number = 0",
    "a check": "UPDATE decisions SET checks = json_set(checks, '$.arm_withdrawn', json('false')) "
    "WHERE episode_id = '{id}' AND number = 2",
    "a decision less": "DELETE FROM decisions WHERE episode_id = '{id}' AND number = 2",
    "a hidden state": "UPDATE hidden_changes SET hidden = json_set(hidden, '$.item_in', 'low') "
    "WHERE episode_id = '{id}' AND number = 1",
    "a span": "UPDATE hidden_spans SET value = '\"bottom\"' "
    "WHERE episode_id = '{id}' AND name = 'item_in'",
    "a span less": "DELETE FROM hidden_spans WHERE episode_id = '{id}' AND kind = 'stage'",
    "the start": "UPDATE episodes SET start = json_set(start, '$.stage', 'end') WHERE id = '{id}'",
    "the final state": "UPDATE episodes SET final_state_hash = 'e' WHERE id = '{id}'",
    "the scene": "UPDATE episodes SET scene_hash = 'e' WHERE id = '{id}'",
    "the instruction": "UPDATE episodes SET instruction = 'rest' WHERE id = '{id}'",
    "the variation": "UPDATE episodes SET variation = '{{}}' WHERE id = '{id}'",
    "the draw": "UPDATE episodes SET draw = draw + 1 WHERE id = '{id}'",
    "the digest": "UPDATE episodes SET digest = upper(digest) WHERE id = '{id}'",
    "the failure": "UPDATE episodes SET failure = 'overcount' WHERE id = '{id}'",
    "no JSON": "UPDATE decisions SET action = '{{' WHERE episode_id = '{id}'",
    "no JSON of the episode": "UPDATE episodes SET start = '{{' WHERE id = '{id}'",
    "JSON of another kind": "UPDATE decisions SET checks = '3' WHERE episode_id = '{id}'",
    "a start of another kind": "UPDATE episodes SET start = '[]' WHERE id = '{id}'",
}


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_row_is_told(folder: Path, edit: str) -> None:
    id = failed(folder)
    tampering.alter(folder, EDITS[edit].format(id=id))

    found = verified(folder)

    assert id in {one.subject for one in found.mismatches}
    others = {one.subject for one in found.mismatches} - {id, *found.scores}
    assert others == set()


def test_an_episode_that_was_taken_out_is_missed(folder: Path) -> None:
    id = failed(folder)
    of = f"episode_id = '{id}'"
    rows = [f"DELETE FROM {one} WHERE {of}" for one in ("decisions", "hidden_changes")]
    spans, episode = (
        f"DELETE FROM hidden_spans WHERE {of}",
        f"DELETE FROM episodes WHERE id = '{id}'",
    )
    tampering.alter(folder, *rows, spans, episode)

    told = {(one.what, str(one.stored), str(one.found)) for one in verified(folder).mismatches}

    assert ("episodes of search_drawer", "[0, 1]", "[0]") in told


def test_an_edited_and_a_lost_file_are_told(folder: Path) -> None:
    thumbnails = [row[0] for row in tampering.ask(folder, "SELECT sha256 FROM blobs")]
    edited, lost = thumbnails
    tampering.edit_blob(folder, edited)
    Blobs(folder / "blobs").path(lost).unlink()

    told = {one.subject: one.what for one in verified(folder).mismatches}

    assert told == {edited: "sha256", lost: "file"}


def test_an_edited_checkpoint_is_told(folder: Path) -> None:
    database = Database(folder / "ledger.sqlite3")
    store = Blobs(folder / "blobs")
    ledgers.uploaded(database, store, "mine", b"weights of a network")
    database.close()
    sha256 = store.put(b"weights of a network")
    assert verified(folder).mismatches == []

    tampering.edit_blob(folder, sha256)

    [told] = verified(folder).mismatches
    assert (told.subject, told.what, told.stored) == (sha256, "sha256", sha256)


def test_a_running_server_goes_on_meanwhile(folder: Path) -> None:
    held = DataFolder(folder)
    database = Database(held.ledger)
    with database.writing() as session:
        ledgers.created(session, tasks=TASKS, episodes=1)
    with ReadOnlyFolder.opened(folder) as opened:
        verifier = Verifier(opened, sample=0)
        with database.writing() as session:
            assert ledgers.play_shard(session, Blobs(folder / "blobs"))

        found = verifier.verify()

        with database.writing() as session:
            assert ledgers.play_shard(session, Blobs(folder / "blobs"))
    database.close()
    held.close()
    assert found.mismatches == []
    assert (found.evaluations, found.episodes) == (2, 5)


def test_a_stopped_server_stays_so_while_it_is_read(folder: Path) -> None:
    DataFolder(folder).close()  # it ran once

    with ReadOnlyFolder.opened(folder), pytest.raises(DataFolderError, match="in use"):
        DataFolder(folder)

    DataFolder(folder).close()


@pytest.mark.parametrize("suite", SUITES)
def test_the_leaderboards_figures_are_recomputed(tmp_path: Path, suite: str) -> None:
    task, other, *_ = SUITES[suite]
    database, store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")
    ledgers.registered(database, "mine")
    wanted = {"suite": "full" if suite == "hide" else suite}
    id = ledgers.evaluated(database, store, "mine", failing, **wanted)
    database.close()
    assert verified(tmp_path, id).mismatches == []
    verdict = "success = 1, exact = 1, failure = NULL"
    where = f"task = '{task}' AND failure IS NOT NULL"
    tampering.alter(tmp_path, f"UPDATE episodes SET {verdict} WHERE {where}")

    told = {(one.name, one.what): (one.stored, one.found) for one in verified(tmp_path).mismatches}

    episodes = 25 * len(SUITES[suite])
    right, forged = episodes - len(SUITES[suite]), episodes - len(SUITES[suite]) + 1
    overall = (f"{forged} of {episodes}", f"{right} of {episodes}")
    assert told["leaderboard, mine@1, overall", "success"] == overall
    assert told[f"leaderboard, mine@1, {task}", "success"] == ("25 of 25", "24 of 25")
    assert told[f"leaderboard, mine@1, {task}", "exact"] == ("25 of 25", "24 of 25")
    assert (f"leaderboard, mine@1, {other}", "success") not in told


def test_an_evaluation_that_is_not_there(folder: Path) -> None:
    with pytest.raises(NoEvaluation, match="has no evaluation ev_0"):
        verified(folder, "ev_0")


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    with pytest.raises(DataFolderError, match="no data folder of a server"):
        verified(tmp_path)


def test_a_ledger_of_an_older_version_is_left_to_its_server(folder: Path) -> None:
    from tests.migrations.test_migrations import down

    database = Database(folder / "ledger.sqlite3")
    down(database, "0001")
    database.close()

    with pytest.raises(LedgerError, match=r"revision 0001, .* start the server once"):
        verified(folder)

    database = Database(folder / "ledger.sqlite3")
    migrate(database.engine)
    database.close()
    assert verified(folder).mismatches == []


def test_a_kept_leaderboard_is_compared_with_the_episodes(tmp_path: Path) -> None:
    database, store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")
    ledgers.registered(database, "mine")
    ledgers.evaluated(database, store, "mine", failing)
    with database.writing() as session:
        kept, _ = snapshots.keep(session, snapshots.content(session, "test"), "test")
        content = kept.content
    database.close()
    assert verified(tmp_path).mismatches == []
    document = json.loads(content)
    document["leaderboards"]["exact"]["rows"][0]["overall"]["exact"]["successes"] += 1
    forged = json.dumps(document, sort_keys=True, separators=(",", ":"))
    sha256 = hashlib.sha256(forged.encode()).hexdigest()

    quoted = forged.replace("'", "''")
    tampering.alter(tmp_path, f"UPDATE leaderboard_snapshots SET content = '{quoted}'")
    careless = {(one.subject, one.what) for one in verified(tmp_path).mismatches}
    tampering.alter(tmp_path, f"UPDATE leaderboard_snapshots SET sha256 = '{sha256}'")
    careful = {(one.name, one.what) for one in verified(tmp_path).mismatches}

    assert ("snapshot 1", "sha256") in careless
    assert careful == {("snapshot 1, mine@1, overall", "exact")}
