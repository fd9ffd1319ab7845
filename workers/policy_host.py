"""The process in which a policy lives; started by `workers.sandbox.launch`, which may close it.

It hears the instruction, an opaque seed and observations, and answers with actions. It knows
neither episode nor task, and ends with the process that started it.
"""

import contextlib
import ctypes
import importlib
import importlib.util
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from pydantic import BaseModel

from hide_tasks.contract import InvalidAction, Policy
from workers import wire

PR_SET_PDEATHSIG = 1  # prctl(2)
CHECKPOINT = "checkpoint:"  # then an absolute path: no class has such a name
REMOTE = "remote:"  # then a `workers.remote.target.Target` as JSON


def load(target: str) -> Policy:
    """A new policy: `module:Class`, `path/to/file.py:Class`, `checkpoint:/path/to/file` or remote.

    Raises:
        TypeError: the class has no reset or no act.
        ValueError: the file is no checkpoint that can be loaded, or the server none that could be
            played with; the message names the mismatch.
        Exception: whatever importing or constructing a class raises.
    """
    if target.startswith(f"{CHECKPOINT}/"):
        return _checkpoint(Path(target.removeprefix(CHECKPOINT)))
    if target.startswith(f"{REMOTE}{{"):
        return _remote(target.removeprefix(REMOTE))
    source, _, name = target.rpartition(":")
    module = _module_of_file(Path(source)) if source.endswith(".py") else _module(source)
    if not hasattr(module, name):
        raise AttributeError(f"{source} has no class {name}")
    policy = getattr(module, name)()
    for method in ("reset", "act"):
        if not callable(getattr(policy, method, None)):
            raise TypeError(f"{name} has no method {method}; a policy has reset and act")
    return policy  # type: ignore[no-any-return]


def _checkpoint(path: Path) -> Policy:
    # By name: other policies do not wait for torch.
    policy: Policy = importlib.import_module("seek_model.policy").load(path)
    return policy


def _remote(target: str) -> Policy:
    # By name: other policies need no WebSocket, and no wire another one's libraries.
    parsed = importlib.import_module("workers.remote.target").Target.model_validate_json(target)
    policy: Policy = importlib.import_module(f"workers.remote.{parsed.policy.wire}").load(parsed)
    return policy


def _module(name: str) -> ModuleType:
    sys.path.insert(0, str(Path.cwd()))
    return importlib.import_module(name)


def _module_of_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    sys.path.insert(0, str(path.parent.resolve()))  # as if it were run: it may import its siblings
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


class Host:
    """Answers messages with what the policy says."""

    policy: Policy

    def load(self, target: str) -> dict[str, Any]:
        self.policy = load(target)
        return {}

    def convert(self, path: str) -> dict[str, Any]:
        """Reads a file of torch.save as a checkpoint, for `piece`."""
        self.checkpoint: bytes = importlib.import_module("seek_model.conversion").converted(
            Path(path)
        )
        return {"size": len(self.checkpoint)}

    def piece(self, bounds: list[int]) -> dict[str, Any]:
        return {"piece": self.checkpoint[bounds[0] : bounds[1]]}

    def open(self, patience: float) -> dict[str, Any]:
        """What a remote policy has found out about its server, connected anew."""
        return {"about": plain(self.policy.open(patience))}  # type: ignore[attr-defined]

    def reset(self, request: dict[str, Any]) -> dict[str, Any]:
        self.policy.reset(request["instruction"], request["policy_seed"])
        return {}

    def act(self, observation: dict[str, Any]) -> dict[str, Any]:
        action = plain(self.policy.act(wire.unpack_observation(observation)))
        belief: Callable[[], object] | None = getattr(self.policy, "belief", None)
        return {"action": action, "belief": plain(belief()) if belief else None}

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """The reply to a request {kind: content}; a policy's exception is a reply, too."""
        [(kind, content)] = request.items()
        answers: dict[str, Callable[[Any], dict[str, Any]]]
        answers = {
            "load": self.load,
            "open": self.open,
            "reset": self.reset,
            "act": self.act,
            "convert": self.convert,
            "piece": self.piece,
        }
        try:
            return answers[kind](content)
        except InvalidAction as error:
            return {"invalid": str(error)}
        except BaseException as error:  # a policy that calls sys.exit has failed as well
            traceback.print_exc()
            return {"error": "".join(traceback.format_exception_only(error)).strip()}


def plain(value: object) -> object:
    """An answer as lists, dictionaries and numbers; what is none of these stays what it is."""
    if isinstance(value, BaseModel):
        return value.model_dump()
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value


def serve(connection: socket.socket) -> None:
    """Says that it is ready, and answers until the other side is gone."""
    host = Host()
    with contextlib.suppress(EOFError, ConnectionError):
        wire.send(connection, {"ready": {}})
        while True:
            reply = host.answer(wire.receive(connection))
            try:
                wire.send(connection, reply)
            except wire.WireError as error:
                wire.send(connection, {"invalid": str(error)})


def die_with_parent() -> None:
    """Linux kills this process when the one that started it ends, whatever the policy is doing."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def main() -> None:
    """Serve on the socket whose number is the only argument."""
    die_with_parent()
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        serve(connection)


if __name__ == "__main__":
    main()
