"""Shards with real simulators, policies and an HTTP server; and their violent ends."""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from hide_tasks import suite
from hide_tasks.contract import Failure, Stop
from hide_tasks.episode import play
from hide_tasks.policies import Expert
from hide_tasks.sources import sources_hash
from tests.processes import command, gone, parent, wait_for
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.workers.ledger_peer import TOKEN, Peer, serving
from workers import supervisor
from workers.checkpoint_cache import FOLDER, WrongContent
from workers.engines.local import LocalEngine
from workers.protocol import (
    AssignedEpisode,
    BuiltInPolicy,
    CheckpointPolicy,
    PolicySpec,
    PythonPolicy,
    ReplayPolicy,
    ShardJob,
    measured_digest,
)
from workers.recording import properties_of
from workers.sandbox import bubblewrap
from workers.sandbox.choice import best
from workers.simulator_process import descendants
from workers.supervisor import SCRATCH, ShardFailure, run_shard, scratch_folder

ROOT = Path(__file__).parents[2]
TASK = "push_button_times"
EXPERT = BuiltInPolicy(name="expert")
AT_ONCE = ReplayPolicy(evaluation="ev")  # its actions are one stop


@pytest.fixture
def peer() -> Iterator[Peer]:
    with serving() as peer:
        yield peer


@pytest.fixture(scope="module", autouse=True)
def _no_simulator_stays() -> Iterator[None]:
    yield
    supervisor.simulator.close()


def hosted(name: str, timeout: float = 20.0) -> PythonPolicy:
    return PythonPolicy(target=f"tests.workers.some_policies:{name}", timeout=timeout)


def shard(peer: Peer, policy: PolicySpec, count: int = 2, **fields: object) -> ShardJob:
    actions = (Stop(),) if policy.kind == "replay" else None
    specs = suite.episodes(TASK, "test", count)
    values = {
        "attempt": "a1",
        "token": TOKEN,
        "server": peer.url,
        "policy": policy,
        "policy_name": "mine",
        "episode_limit": 60.0,
        "episodes": [
            AssignedEpisode(id=f"e{spec.index}", spec=spec, actions=actions) for spec in specs
        ],
    }
    return ShardJob.model_validate(values | fields)


def test_a_shard_is_played_and_committed(peer: Peer, tmp_path: Path) -> None:
    run_shard(shard(peer, EXPERT))

    assert [what for what, _ in peer.kept.told] == ["start", "recording", "result"] * 2
    for index, (episode, commit) in enumerate(peer.kept.commits.items()):
        result, decisions = play(suite.episode(TASK, "test", index), Expert())
        assert commit.result.final_state_hash == result.final_state_hash
        assert list(commit.decisions) == decisions
        assert commit.digest == measured_digest(
            commit.result, commit.start, commit.decisions, commit.changes
        )
        file = tmp_path / f"{episode}.rrd"
        file.write_bytes(peer.kept.recordings[episode])
        told = properties_of(file)
        assert (told["index"], told["policy"], told["success"]) == (index, "mine", True)
    assert not list(Path(tempfile.gettempdir()).glob(f"{SCRATCH}{os.getpid()}-*"))


def test_a_recording_travels_while_its_episode_is_played(peer: Peer) -> None:
    run_shard(shard(peer, hosted("Slow"), 1))

    assert peer.kept.arrived[-1] - peer.kept.arrived[0] > 1.5
    assert sum(peer.kept.pieces) == len(peer.kept.recordings["e0"])


def test_without_recordings_none_is_sent(peer: Peer) -> None:
    run_shard(shard(peer, AT_ONCE, 1, recordings=False))

    assert peer.kept.told == [("start", "e0"), ("result", "e0")]
    assert peer.kept.commits["e0"].recording is None


def test_an_interrupted_upload_is_repeated(peer: Peer) -> None:
    peer.kept.answers["recording"] = [500]

    run_shard(shard(peer, AT_ONCE, 1))

    assert [what for what, _ in peer.kept.told] == ["start", "recording", "recording", "result"]
    assert peer.kept.faults == {}


def test_a_policy_that_hangs_is_a_result_and_the_shard_goes_on(peer: Peer) -> None:
    run_shard(shard(peer, hosted("Hangs", timeout=0.5), recordings=False))

    results = [commit.result for commit in peer.kept.commits.values()]
    assert [result.failure for result in results] == [Failure.POLICY_TIMEOUT] * 2
    assert results[0].detail == "act took longer than 0.5 s"
    assert peer.kept.faults == {}


def test_a_killed_simulator_costs_one_episode(peer: Peer) -> None:
    def kill() -> None:
        wait_for(lambda: peer.kept.pieces, "an episode under way")
        os.kill(supervisor.simulator.pid or 0, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with pytest.raises(ShardFailure) as raised:
        run_shard(shard(peer, hosted("Slow")))
    killer.join()

    reason = "the simulator's process died: signal 9, SIGKILL"
    assert str(raised.value) == (f"1 of 2 episodes could not be played: {TASK}-test-000: {reason}")
    assert peer.kept.faults == {"e0": reason}
    assert set(peer.kept.commits) == {"e1"} == set(peer.kept.recordings)


def test_a_refused_result_costs_one_episode(peer: Peer) -> None:
    peer.kept.answers["result"] = [422]

    with pytest.raises(ShardFailure, match=r"1 of 2 .* gave 422: .*as the test wants it"):
        run_shard(shard(peer, AT_ONCE))

    assert (set(peer.kept.faults), set(peer.kept.commits)) == ({"e0"}, {"e1"})


def test_what_a_job_that_was_placed_again_had_committed_is_left_alone(peer: Peer) -> None:
    peer.kept.final = {"e0"}

    run_shard(shard(peer, AT_ONCE, recordings=False))

    assert (set(peer.kept.commits), peer.kept.faults) == ({"e1"}, {})


def test_other_sources_than_the_evaluations_play_nothing(peer: Peer) -> None:
    with pytest.raises(ShardFailure, match=r"2 of 2 .* the sources of push_button_times changed"):
        run_shard(shard(peer, AT_ONCE, sources="0" * 64))
    run_shard(shard(peer, AT_ONCE, sources=sources_hash(TASK)))

    assert set(peer.kept.faults) == {"e0", "e1"} == set(peer.kept.commits)


def test_a_stale_attempt_ends_quietly(peer: Peer) -> None:
    peer.kept.answers["result"] = [409]

    run_shard(shard(peer, AT_ONCE, recordings=False))

    assert peer.kept.told == [("start", "e0"), ("result", "e0")]
    assert (peer.kept.commits, peer.kept.faults) == ({}, {})
    assert supervisor.simulator.pid is None


def test_an_attempt_that_turns_stale_while_it_plays_stops_at_once(peer: Peer) -> None:
    peer.kept.answers["recording"] = [409]

    run_shard(shard(peer, hosted("Hangs", timeout=60.0)))

    assert peer.kept.told == [("start", "e0"), ("recording", "e0")]
    assert supervisor.simulator.pid is None


def test_a_policy_that_signals_end_is_scored_at_the_third_and_the_shard_goes_on(peer: Peer) -> None:
    hostile = Path(__file__).with_name("sandbox") / "hostile.py"
    policy = PythonPolicy(target=f"{hostile}:KillsItselfAtOnce", timeout=20.0)

    run_shard(shard(peer, policy))

    assert peer.kept.faults == {}
    for episode, commit in peer.kept.commits.items():
        assert commit.result.failure is Failure.POLICY_ERROR
        assert "had died 2 times before: signal 9, SIGKILL" in commit.result.detail
        assert commit.sandbox is best()
        assert [what for what, whose in peer.kept.told if whose == episode].count("start") == 1
    assert len(peer.kept.commits) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("end", ["kill", "cancel"])
def test_nothing_is_left_of_an_attempt_that_is_ended(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # where its scratch folder stays behind
    supervisor.simulator.close()
    others = set(descendants_that_run("workers.simulator_host"))  # of tests before this one
    with closing(LocalEngine(run_shard, workers=1)) as engine:
        engine.submit("s1:1", shard(peer, hosted("Hangs", timeout=60.0)), 300.0)
        wait_for(lambda: peer.kept.pieces, "an episode under way")
        wait_for(lambda: len(descendants_that_run("workers.policy_host")) == 1, "its policy")
        [simulator] = set(descendants_that_run("workers.simulator_host")) - others
        [policy] = descendants_that_run("workers.policy_host")
        pool_process = parent(simulator)
        if end == "kill":
            os.kill(pool_process, signal.SIGKILL)
        else:
            engine.cancel("s1:1")

        wait_for(lambda: gone([pool_process, simulator, policy]), "the end of all", 5)
        wait_for(lambda: not engine.inventory(), "the end of the key", 5)
        [one] = engine.ended()
    reasons = {"kill": "its process died with signal 9", "cancel": "cancelled"}
    assert (one.reason, one.cancelled) == (reasons[end], end == "cancel")


def descendants_that_run(module: str) -> list[int]:
    commands = {pid: command(pid) for pid in descendants(os.getpid())}
    return [
        pid
        for pid, text in commands.items()
        if f" {module} " in text and not text.startswith(bubblewrap.program() or "-")
    ]


def test_what_a_killed_process_left_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    for pid in (dead.pid, os.getppid()):
        (tmp_path / f"{SCRATCH}{pid}-x").mkdir()

    with scratch_folder() as scratch:
        assert {path.name for path in tmp_path.iterdir()} == {
            f"{SCRATCH}{os.getppid()}-x",
            scratch.name,
        }
    assert not scratch.exists()


def checkpoint(content: bytes) -> CheckpointPolicy:
    return CheckpointPolicy(sha256=hashlib.sha256(content).hexdigest(), size=len(content))


def test_a_checkpoint_is_fetched_once_and_played(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path / "cache"))
    file = tmp_path / "tiny.safetensors"
    tiny_checkpoint(file)
    peer.kept.checkpoint = file.read_bytes()
    policy = checkpoint(peer.kept.checkpoint)

    run_shard(shard(peer, policy, 1, recordings=False, episode_limit=250.0))
    peer.kept.final = {"e0"}
    run_shard(shard(peer, policy, 1, recordings=False, episode_limit=250.0))

    [commit] = peer.kept.commits.values()
    assert commit.result.failure is not Failure.POLICY_ERROR, commit.result.detail
    assert commit.decisions[0].belief is not None
    assert [what for what, _ in peer.kept.told].count("checkpoint") == 1
    assert (tmp_path / "cache" / f"{policy.sha256}.safetensors").exists()


def test_another_checkpoint_than_was_asked_for_plays_nothing(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    peer.kept.checkpoint = b"other weights"

    with pytest.raises(WrongContent, match="The server sent a checkpoint with SHA-256"):
        run_shard(shard(peer, checkpoint(b"weights")))

    assert peer.kept.told == [("checkpoint", "a1")]


def test_an_attempt_that_is_stale_before_it_has_its_checkpoint_ends_quietly(
    peer: Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    peer.kept.answers["checkpoint"] = [409]

    run_shard(shard(peer, checkpoint(b"weights")))

    assert peer.kept.told == [("checkpoint", "a1")]


def test_the_supervisor_is_light() -> None:
    program = "import sys, workers.supervisor; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    )

    assert {"torch", "pybullet", "numba", "rerun", "scipy", "PIL"} & set(done.stdout.split()) == (
        set()
    )
