"""Episodes that are played again: the last word, whatever the rows say."""

import json
from collections import defaultdict
from pathlib import Path

import pytest

from hide_tasks.machine import fingerprint
from server.blobs import Blobs
from server.read_only import ReadOnlyFolder
from server.verification.findings import Findings
from server.verification.ledger import Verifier
from server.verification.verdicts import judged
from tests.server import played, tampering
from workers.resimulation import Recorded, resimulate

REALLY = "processor"  # a fact of the machine that another one has otherwise


def verified(folder: Path, sample: int | None = None) -> Findings:
    with ReadOnlyFolder.opened(folder) as opened:
        return Verifier(opened, sample=sample).verify()


def episode_of(folder: Path, evaluation: str) -> str:
    query = f"SELECT id FROM episodes WHERE evaluation_id = '{evaluation}'"
    return str(tampering.ask(folder, query)[0][0])


def told(found: Findings) -> dict[str, list[str]]:
    by_subject: dict[str, list[str]] = defaultdict(list)
    for one in found.mismatches:
        by_subject[one.subject].append(one.what)
    return by_subject


def test_honest_episodes_are_played_again_to_the_last_bit(tmp_path: Path) -> None:
    ids = played.data_folder(tmp_path)

    found = verified(tmp_path)

    assert found.mismatches == []
    assert (found.simulated, found.bitwise, found.files) == (2, 2, 4)
    assert [found.scores[id].success for id in ids.values()] == [1, 0]


def test_forgeries_that_agree_with_themselves_are_found(tmp_path: Path) -> None:
    """Verdicts, decisions and digests of one episode; the actions and digest of another."""
    ids = played.data_folder(tmp_path)
    better, other = (episode_of(tmp_path, ids[one]) for one in ("random", "expert"))
    last = f"episode_id = '{better}' AND number = (SELECT max(number) FROM decisions " + (
        f"WHERE episode_id = '{better}')"
    )
    checks = tampering.ask(tmp_path, f"SELECT checks FROM decisions WHERE {last}")[0][0]
    held = json.dumps(dict.fromkeys(json.loads(checks), True), separators=(",", ":"))
    verdict = "success = 1, exact = 1, failure = NULL"
    tampering.alter(
        tmp_path,
        f"UPDATE episodes SET {verdict} WHERE id = '{better}'",
        f"UPDATE decisions SET violations = '[]' WHERE episode_id = '{better}'",
        f"UPDATE decisions SET success = 1, checks = '{held}' WHERE {last}",
        "UPDATE decisions SET action = json_set(action, '$.position[2]', 1.2) "
        f"WHERE episode_id = '{other}' AND number = 1",
    )
    tampering.seal(tmp_path, better)
    tampering.seal(tmp_path, other)

    found = verified(tmp_path)

    assert {"success, played again", "exact, played again"} <= set(told(found)[better])
    assert "failure, played again" in told(found)[better]
    assert "final_state_hash, played again" in told(found)[other]
    assert any(what.startswith("decision 1: ") for what in told(found)[other])
    [score] = [one for one in found.mismatches if one.subject == ids["random"]][:1]
    assert (score.name, score.what, score.stored, score.found) == (
        "score", "success", "1 of 1", "0 of 1",
    )  # fmt: skip
    assert found.scores[ids["random"]].success == 0


def test_recordings_are_held_against_the_results(tmp_path: Path) -> None:
    """One is edited; another is a real recording, of another policy's episode."""
    ids = played.data_folder(tmp_path)
    recording = {
        policy: str(
            tampering.ask(tmp_path, f"SELECT recording FROM episodes WHERE evaluation_id = '{id}'")[
                0
            ][0]
        )
        for policy, id in ids.items()
    }
    file = Blobs(tmp_path / "blobs").path(recording["expert"])
    content = file.read_bytes()
    tampering.edit_blob(tmp_path, recording["expert"])
    tampering.alter(
        tmp_path,
        f"UPDATE episodes SET recording = '{recording['expert']}' "
        f"WHERE recording = '{recording['random']}'",
    )

    edited = told(verified(tmp_path, sample=0))
    file.write_bytes(content)
    swapped = told(verified(tmp_path, sample=0))

    assert edited[recording["expert"]] == ["sha256", "sha256"]  # named by two episodes
    wrong = swapped[episode_of(tmp_path, ids["random"])]
    assert {"policy in the recording", "success in the recording"} <= set(wrong)
    assert list(swapped) == [episode_of(tmp_path, ids["random"])]


def test_on_another_class_of_machine_verdicts_and_counts_must_agree(tmp_path: Path) -> None:
    ids = played.data_folder(tmp_path)
    tampering.alter(
        tmp_path,
        f"UPDATE evaluations SET machine = json_set(machine, '$.{REALLY}', 'another')",
        "UPDATE episodes SET final_state_hash = 'e' WHERE success = 1",
    )
    for id in ids.values():
        tampering.seal(tmp_path, episode_of(tmp_path, id))

    found = verified(tmp_path)

    assert found.mismatches == []
    assert (found.simulated, found.bitwise) == (2, 0)


def test_a_worker_elsewhere_tells_its_own_machine(tmp_path: Path) -> None:
    """The evaluation was asked for on this machine, one shard was played on another."""
    ids = played.data_folder(tmp_path)
    elsewhere = json.dumps(fingerprint() | {REALLY: "another"})
    shard = f"SELECT id FROM shards WHERE evaluation_id = '{ids['expert']}'"
    tampering.alter(
        tmp_path,
        f"UPDATE attempts SET machine = '{elsewhere}' WHERE shard_id IN ({shard})",
    )

    found = verified(tmp_path)

    assert found.mismatches == []
    assert (found.simulated, found.bitwise) == (2, 1)


def test_what_other_sources_played_is_left_out_and_said(tmp_path: Path) -> None:
    played.data_folder(tmp_path)
    tampering.alter(
        tmp_path, f"UPDATE evaluations SET sources = json_set(sources, '$.{played.TASK}', 'old')"
    )

    found = verified(tmp_path)

    assert (found.mismatches, found.simulated) == ([], 0)
    assert found.unplayed == {"the task's sources have changed since it was played": 2}


def test_a_record_that_ends_too_early_does_not_come_out_the_same() -> None:
    told, _ = played._played("expert", 0)
    actions = tuple(one.action for one in told.decisions)

    whole = resimulate(Recorded("whole", played.spec(), "hide", actions))
    cut = resimulate(Recorded("cut", played.spec(), "hide", actions[:-2]))

    assert whole.result.final_state_hash == told.result.final_state_hash
    assert whole.changes == told.changes
    assert (cut.result.exact, cut.result.failure) == (False, "policy_error")


@pytest.mark.parametrize(
    ("failure", "decision", "verdicts"),
    [
        (None, {"success": True}, (True, None)),
        ("undercount", {"success": True}, (True, None)),
        ("undercount", {"checks": {"held": False}}, (False, "undercount")),
        (None, {"checks": {"held": False}}, (False, "some failure")),
        ("unfinished", {"outcome": "no_path"}, (False, "unreachable_pose")),
        (None, {"success": True, "violations": ["overcount"]}, (True, "overcount")),
        ("policy_error", {"success": True}, (True, "policy_error")),
    ],
)
def test_verdicts_follow_from_decisions(failure, decision, verdicts) -> None:
    last = {
        "success": False,
        "checks": {"held": True},
        "violations": [],
        "outcome": "arrived",
        **decision,
    }

    found = judged(failure, {}, [last])

    assert (found["success"], found["failure"]) == verdicts
    assert found["exact"] == (found["failure"] is None)


def test_an_episode_without_a_decision_is_no_success() -> None:
    assert judged("policy_error", {"held": True}, [])["success"] is False
    assert judged(None, {}, [])["exact"] is False
