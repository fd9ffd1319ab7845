"""The simulator's end of a policy that lives in a process of its own.

The process is started when it is first needed, plays many episodes, and is killed with all its
children as soon as it fails or is late, so that no episode inherits another one's trouble.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hide_tasks.contract import Belief, Failure, Observation, PolicyFailure
from workers import wire

LOAD_LIMIT = 600.0  # s for importing and constructing a policy: weights may be large
KEYS = "HIDE_REMOTE_KEYS"  # of policy servers: nothing for a policy to read
LONGEST_MESSAGE = 500  # characters of an error that are kept


class PolicyProcess:
    """A policy of the contract, played by `workers.policy_host`.

    Args:
        target: `module:Class` or `path/to/file.py:Class`.
        timeout: seconds for one answer.
        first_timeout: seconds for an episode's first one, if that differs.
        log: file that takes what the policy prints; None throws it away.
        threads: how many threads its numeric libraries may use.
    """

    def __init__(
        self,
        target: str,
        *,
        timeout: float,
        first_timeout: float | None = None,
        log: Path | None = None,
        threads: int | None = None,
    ):
        self.target = target
        self.timeout = timeout
        self.first_timeout = first_timeout
        self._first = True
        self.log = log
        self.threads = threads
        self._belief: Belief | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: socket.socket

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Starts the process if need be and tells it of a new episode.

        Raises:
            PolicyFailure: it could not be loaded, raised, died or was late.
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
        """
        if self._process is None:
            self._start()
            self._ask({"load": self.target}, limit)

    def close(self) -> None:
        """Ends the process and all its children."""
        if self._process is None:
            return
        self._connection.close()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process = None

    def kill(self) -> None:
        """Kills the process and its children, from whatever thread; what is asked then fails."""
        process = self._process
        if process and process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    def _start(self) -> None:
        ours, theirs = socket.socketpair()
        # -P: the researcher's folder comes first only once our own modules are imported.
        command = [sys.executable, "-P", "-m", "workers.policy_host", str(theirs.fileno())]
        with theirs, open(self.log or os.devnull, "ab") as output:
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=self._environment(),
                start_new_session=True,
            )
        self._connection = ours

    def _environment(self) -> dict[str, str]:
        path = os.pathsep.join(os.path.abspath(part) for part in sys.path)
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
        environment.pop(KEYS, None)
        if self.threads is not None:
            for library in ("OMP", "MKL", "OPENBLAS", "NUMBA"):
                environment[f"{library}_NUM_THREADS"] = str(self.threads)
        return environment

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
            code = self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            return "the policy's process closed its connection"
        how = f"signal {-code}, {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f"the policy's process died: {how}"

    def _failed(self, failure: Failure, message: str) -> PolicyFailure:
        self.close()
        return PolicyFailure(failure, message.splitlines()[-1][:LONGEST_MESSAGE])
