"""The simulator's end of a policy that lives in a process of its own.

The process is started when it is first needed, plays many episodes, and is killed with all its
children as soon as it fails or is late, so that no episode inherits another one's trouble.
"""

import contextlib
import os
import signal
import socket
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hide_tasks.contract import Belief, Failure, Observation, PolicyFailure
from workers import wire
from workers.policy_host import CHECKPOINT
from workers.sandbox.choice import Sandbox, chosen
from workers.sandbox.launch import Launch, launch
from workers.sandbox.view import View, of_checkpoint, of_class

START_LIMIT = 120.0  # s until it is closed by its sandbox and has imported what serves
LOAD_LIMIT = 600.0  # s for importing and constructing a policy: weights may be large
DEATH_LIMIT = 10.0  # s that a process whose connection is gone may take to end
LONGEST_MESSAGE = 500  # characters of an error that are kept


class NotStarted(Exception):
    """A policy's process cannot be started, through no fault of the policy."""


class PolicyDied(Exception):
    """A signal ended a policy's process, not for the last time: the episode is played afresh."""


class PolicyProcess:
    """A policy of the contract, played by `workers.policy_host`.

    Args:
        target: `module:Class` or `path/to/file.py:Class`.
        timeout: seconds for one answer.
        first_timeout: seconds for an episode's first one, if that differs.
        log: file that takes what the policy prints; None throws it away.
        threads: how many threads its numeric libraries may use.
        sandbox: what is around it; None takes what the environment says, else the best.
        hidden: folders that a class must not see, whatever else it sees.

    Attributes:
        killed: the signal that ended the process since it was last made ready; None if none did.
    """

    def __init__(
        self,
        target: str,
        *,
        timeout: float,
        first_timeout: float | None = None,
        log: Path | None = None,
        threads: int | None = None,
        sandbox: Sandbox | None = None,
        hidden: Iterable[Path] = (),
    ):
        self.target = target
        self.timeout = timeout
        self.first_timeout = first_timeout
        self._first = True
        self.log = log
        self.threads = threads
        self.sandbox = chosen() if sandbox is None else sandbox
        self.hidden = tuple(hidden)
        self.killed: str | None = None
        self._belief: Belief | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._loaded = False
        self._launch: Launch
        self._connection: socket.socket

    def make_ready(self) -> None:
        """Starts the process if need be; nothing of the policy is loaded yet.

        Raises:
            NotStarted: it cannot be started, or its sandbox cannot be closed.
        """
        self.killed = None
        if self._process is None:
            self._start()

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Starts the process if need be and tells it of a new episode.

        Raises:
            PolicyFailure: it could not be loaded, raised, died or was late.
            NotStarted: it cannot be started.
        """
        self.load()
        self._ask({"reset": {"instruction": instruction, "policy_seed": policy_seed}}, self.timeout)
        self._belief, self._first = None, True

    def act(self, observation: Observation) -> Any:
        """The action in its dictionary form, or whatever the policy answered.

        Raises:
            PolicyFailure: it raised, died, was late or answered what is no message.
        """
        limit = self.first_timeout if self._first and self.first_timeout else self.timeout
        reply = self._ask({"act": wire.pack_observation(observation)}, limit)
        self._first = False
        try:
            said = reply["belief"]
            self._belief = None if said is None else Belief.model_validate(said)
        except ValidationError as error:
            fault = error.errors()[0]
            raise self._failed(Failure.POLICY_INVALID, f"belief: {fault['msg']}") from None
        return reply["action"]

    def belief(self) -> Belief | None:
        """What the policy said it believes, with its last action."""
        return self._belief

    def load(self, limit: float = LOAD_LIMIT) -> None:
        """Starts the process and loads the policy; does nothing if that is done.

        Raises:
            PolicyFailure: it could not be loaded.
            NotStarted: it cannot be started.
        """
        if self._process is None:
            self._start()
        if not self._loaded:
            self._ask({"load": self._target_within()}, limit)
            self._loaded = True

    def close(self) -> None:
        """Ends the process and all its children."""
        if self._process is None:
            return
        self._connection.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._launch.end()
        self._process = None

    def kill(self) -> None:
        """Kills the process and its children, from whatever thread; what is asked then fails."""
        process = self._process
        if process and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                self._launch = launch(
                    self.sandbox, theirs.fileno(), self._view(), threads=self.threads
                )
                self._process = self._spawned(theirs.fileno())
        except (OSError, ValueError) as error:
            ours.close()
            raise NotStarted(f"the policy's process cannot be started: {error}") from None
        self._connection, self._loaded = ours, False
        self._greet()

    def _spawned(self, connection: int) -> subprocess.Popen[bytes]:
        start = self._launch
        try:
            with open(self.log or os.devnull, "ab") as output:
                process = subprocess.Popen(
                    start.command,
                    pass_fds=[connection, *start.descriptors],
                    stdin=subprocess.PIPE,
                    stdout=output,
                    stderr=output,
                    env=start.environment,
                    cwd=start.folder,
                    start_new_session=True,
                )
        except OSError:
            start.end()
            raise
        finally:
            start.passed_on()
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError), process.stdin:
            process.stdin.write(start.tells)
        return process

    def _greet(self) -> None:
        """Waits until the process serves: it is closed by then, and the policy not loaded."""
        try:
            ready = wire.receive(self._connection, within=START_LIMIT)
        except (TimeoutError, EOFError, ConnectionError, wire.WireError):
            ready = None
        if ready != {"ready": {}}:
            cause = self._cause_of_death()
            self.close()
            raise NotStarted(f"{cause} before it served; its sandbox was {self.sandbox}")

    def _view(self) -> View:
        if self.target.startswith(CHECKPOINT):
            return of_checkpoint(Path(self.target.removeprefix(CHECKPOINT)))
        return of_class(self.target, self.hidden)

    def _target_within(self) -> str:
        """The target as the process finds it, wherever that starts."""
        source, _, name = self.target.rpartition(":")
        found = source.endswith(".py") and os.path.isfile(source)
        return f"{os.path.realpath(source)}:{name}" if found else self.target

    def _ask(self, request: dict[str, Any], limit: float) -> dict[str, Any]:
        try:
            self._connection.settimeout(limit)
            wire.send(self._connection, request)
            reply = wire.receive(self._connection, within=limit)
        except TimeoutError:
            message = f"{next(iter(request))} took longer than {limit:g} s"
            raise self._failed(Failure.POLICY_TIMEOUT, message) from None
        except wire.WireError as error:
            raise self._failed(Failure.POLICY_INVALID, str(error)) from None
        except (EOFError, ConnectionError):
            raise self._failed(Failure.POLICY_ERROR, self._cause_of_death()) from None
        return self._checked(reply)

    def _checked(self, reply: Any) -> dict[str, Any]:
        if not isinstance(reply, dict):
            raise self._failed(Failure.POLICY_INVALID, f"answered {type(reply).__name__}")
        if "error" in reply:
            raise self._failed(Failure.POLICY_ERROR, str(reply["error"]))
        if "invalid" in reply:
            raise self._failed(Failure.POLICY_INVALID, str(reply["invalid"]))
        return reply

    def _cause_of_death(self) -> str:
        assert self._process is not None
        try:
            code = self._process.wait(timeout=DEATH_LIMIT)
        except subprocess.TimeoutExpired:
            return "the policy's process closed its connection"
        number = self._signal(code)
        if number:
            self.killed = f"signal {number}, {signal.Signals(number).name}"
        return f"the policy's process died: {self.killed or f'exit code {code}'}"

    def _signal(self, code: int) -> int | None:
        """The signal that an exit status tells of; bubblewrap tells it as shells do."""
        number = code - 128 if self.sandbox is Sandbox.BUBBLEWRAP and code > 0 else -code
        return number if number in list(signal.Signals) else None

    def _failed(self, failure: Failure, message: str) -> PolicyFailure:
        self.close()
        return PolicyFailure(failure, message.splitlines()[-1][:LONGEST_MESSAGE])
