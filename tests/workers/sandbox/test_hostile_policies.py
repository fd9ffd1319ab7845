"""Real hostile policies in every sandbox that this machine has, and without one where that shows
that the attempt is a real one."""

import os
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hide_tasks.contract import Failure, PolicyFailure
from tests.processes import alive, gone, wait_for
from tests.workers.sandbox.usable import usable
from tests.workers.test_policy_process import observation
from workers.policy_process import PolicyProcess
from workers.sandbox import view
from workers.sandbox.choice import Sandbox
from workers.sandbox.limits import MEMORY
from workers.simulator_process import descendants

HOSTILE = f"{Path(__file__).with_name('hostile.py')}:Hostile"
CLOSED = [one for one in Sandbox if one is not Sandbox.NONE]
DENIED = (
    *("PermissionError", "FileNotFoundError", "OSError", "BlockingIOError"),
    "AssertionError",  # there is nothing in it
)


@pytest.fixture(params=CLOSED)
def sandbox(request: pytest.FixtureRequest) -> Sandbox:
    return usable(request.param)


@contextmanager
def hostile(
    sandbox: Sandbox, target: str = HOSTILE, timeout: float = 60.0, **settings: object
) -> Iterator[PolicyProcess]:
    policy = PolicyProcess(target, timeout=timeout, sandbox=sandbox, **settings)
    try:
        yield policy
    finally:
        policy.close()


@pytest.fixture(scope="module", params=CLOSED)
def closed(request: pytest.FixtureRequest) -> Iterator[PolicyProcess]:
    """One that stays for several tests: what they try must not change it."""
    with hostile(usable(request.param)) as policy:
        yield policy


def tried(policy: PolicyProcess, *words: object) -> str:
    """What came of an attempt."""
    policy.reset(" ".join(map(str, words)), 7)
    return policy.act(observation())


def processes_of(policy: PolicyProcess) -> list[int]:
    assert policy._process is not None
    return [policy._process.pid, *descendants(policy._process.pid)]


@pytest.fixture
def secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ledger, in a data folder beside the policy's own."""
    data = tmp_path / "data"
    data.mkdir()
    ledger = data / f"ledger-{secrets.token_hex(4)}.sqlite3"
    ledger.write_text("what is hidden")
    monkeypatch.setenv(view.HIDDEN, str(data))
    return ledger


@contextmanager
def listening() -> Iterator[int]:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        yield server.getsockname()[1]


def test_each_attempt_succeeds_without_a_sandbox(secret: Path, tmp_path: Path) -> None:
    """So none of those below is denied because it is no attempt."""
    with listening() as port, hostile(Sandbox.NONE) as policy:
        done = {
            words: tried(policy, *words)
            for words in [
                ("opens_a_socket",),
                ("connects", port),
                ("reads", secret),
                ("lists", secret.parent),
                ("writes", tmp_path / "written"),
                ("changes_the_mode", tmp_path / "written"),
                ("truncates", tmp_path / "written"),
                ("deletes", tmp_path / "written"),
                ("starts_a_program",),
                ("eats_shared_memory",),
                ("signals_by_a_file", os.getpid()),
            ]
        }

    assert set(done.values()) == {"done"}, done


def test_no_network(closed: PolicyProcess) -> None:
    name = f"hide-{secrets.token_hex(4)}"
    with listening() as port, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as peer:
        peer.bind(f"\0{name}")
        for words in (
            ("opens_a_socket",),
            ("connects", port),
            ("sends_to_an_abstract_socket", name),
            ("calls", "io_uring_setup"),
        ):
            assert tried(closed, *words) in DENIED, words


def test_no_view_of_the_data_or_of_homes(
    sandbox: Sandbox, secret: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = secret.parents[1]
    home = folder / "home"
    home.mkdir()
    (home / "letter").write_text("a letter")
    monkeypatch.setenv("HOME", str(home))
    own = folder / "own"
    own.mkdir()
    (own / "hostile.py").write_bytes(Path(HOSTILE.rpartition(":")[0]).read_bytes())
    (own / ".env").write_text("a key")
    (own / "run").mkdir()
    (own / "run" / "results.json").write_text("{}")
    (own / "run" / "decisions.jsonl").write_text("what is hidden")
    (own / "leads").symlink_to(secret)

    with hostile(sandbox, f"{own / 'hostile.py'}:Hostile") as policy:
        assert tried(policy, "reads", own / "hostile.py") == "done"
        for attempt in ("reads", "looks_for"):
            assert tried(policy, attempt, secret) in DENIED, attempt
        for unseen in (
            secret.parent,
            home,
            home / "letter",
            Path("/etc/passwd"),
            own / ".env",
            own / "leads",
            own / "run" / "decisions.jsonl",
            Path("/proc") / str(os.getpid()) / "environ",
        ):
            attempt = "lists" if unseen.is_dir() else "reads"
            assert tried(policy, attempt, unseen) in DENIED, unseen


def test_a_class_beside_the_data_does_not_see_it(
    sandbox: Sandbox, secret: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it is where the server was started in the folder of the class."""
    folder = secret.parents[1]
    (folder / "beside.txt").write_text("mine")
    (folder / "hostile.py").write_bytes(Path(HOSTILE.rpartition(":")[0]).read_bytes())
    monkeypatch.syspath_prepend(os.getcwd())
    monkeypatch.chdir(folder)

    with hostile(sandbox, "hostile.py:Hostile") as policy:
        assert tried(policy, "reads", "beside.txt") == "done"
        assert tried(policy, "reads", secret) in DENIED
        assert tried(policy, "reads", f"data/{secret.name}") in DENIED


def test_no_writing_but_in_its_own_folder(sandbox: Sandbox, tmp_path: Path) -> None:
    mine = tmp_path / "hostile.py"
    mine.write_bytes(Path(HOSTILE.rpartition(":")[0]).read_bytes())
    there = tmp_path / "there"
    there.write_text("as it was")

    with hostile(sandbox, f"{mine}:Hostile") as policy:
        for words in (
            ("writes", tmp_path / "new"),
            ("writes", there),
            ("writes", mine),
            ("deletes", there),
            ("truncates", there),
            ("changes_the_mode", mine),
            ("writes", Path(view.__file__)),
            ("writes", "/dev/shm/kept"),
        ):
            assert tried(policy, *words) in DENIED, words
        assert tried(policy, "fills_the_disk") == "OSError"

    assert there.read_text() == "as it was"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hostile.py", "there"]


def test_no_further_processes(closed: PolicyProcess) -> None:
    for words in (("starts_a_program",), ("bombs",), ("calls", "clone3"), ("calls", "unshare")):
        assert tried(closed, *words) in DENIED, words

    assert len(processes_of(closed)) <= 3  # bubblewrap's two, and its own


def test_no_hand_on_other_processes(closed: PolicyProcess) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as victim:
        for words in (
            ("kills", victim.pid),
            ("signals_by_a_file", victim.pid),
            ("calls", "ptrace"),
            ("kills_all",),
            ("kills", os.getpid()),
        ):
            assert tried(closed, *words) in (*DENIED, "ProcessLookupError"), words
        assert alive(victim.pid)
        victim.kill()


def test_no_way_out_of_any_of_it(closed: PolicyProcess) -> None:
    for words in (
        ("outlives_its_parent",),
        ("calls", "mount"),
        ("raises_its_limits",),
        ("eats_shared_memory",),
    ):
        assert tried(closed, *words) in DENIED, words


def test_an_honest_one_calculates(closed: PolicyProcess) -> None:
    assert tried(closed, "calculates") == "done"


def test_no_more_memory_than_it_may_have(sandbox: Sandbox, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MEMORY, "0.75")
    with hostile(sandbox) as policy:
        for attempt in ("eats_memory", "eats_memory_in_threads"):
            assert tried(policy, attempt) == "MemoryError", attempt


@pytest.mark.parametrize("how", ["sleeps", "spins"])
def test_it_does_not_survive_its_parent(sandbox: Sandbox, how: str) -> None:
    program = (
        "from tests.workers.sandbox.test_hostile_policies import *\n"
        f"policy = PolicyProcess(HOSTILE, timeout=60.0, sandbox=Sandbox('{sandbox}'))\n"
        "policy.load()\n"
        "print(*processes_of(policy), flush=True)\n"
        f"tried(policy, '{how}')\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        processes = [int(pid) for pid in parent.stdout.readline().split()]
        time.sleep(0.2)
        assert all(map(alive, processes))
        parent.kill()

    wait_for(lambda: gone(processes), "the end of the policy", 10)


def test_one_that_sleeps_for_ever_is_late(sandbox: Sandbox) -> None:
    with hostile(sandbox, timeout=0.5) as policy:
        policy.load()
        processes, scratch = processes_of(policy), policy._launch.scratch

        with pytest.raises(PolicyFailure, match="act took longer") as raised:
            tried(policy, "sleeps")

    assert raised.value.failure is Failure.POLICY_TIMEOUT
    wait_for(lambda: gone(processes), "its end", 5)
    assert scratch is None or not scratch.exists()  # where it may write
