"""POLICY, as written on the command line, and how each kind of it is made."""

import difflib
import hashlib
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from hide_tasks.catalogue import cameras_of
from hide_tasks.contract import CAMERAS, Action, EpisodeSpec, Policy, PolicyFailure
from seek_model import trained
from seek_model.checkpoint_header import BadCheckpoint, read_header
from workers import actions_file, fitness, run_folder
from workers.policy_host import CHECKPOINT
from workers.policy_process import LOAD_LIMIT, NotStarted, PolicyProcess
from workers.protocol import RemotePolicy
from workers.remote import egress
from workers.remote.keys import BadKeys, key_of
from workers.remote.maps import cameras_in
from workers.remote.target import About, RemoteProcess, Target, Unreachable, process_of
from workers.remote.wires import BY_SCHEME
from workers.sandbox.choice import Sandbox

BUILTIN = ("expert", "amnesiac", "random", "noop")
DENSE = ("expert-joint-position", "expert-ee-delta")  # the expert's motion; on no leaderboard
ACCEPTED = (
    f"{', '.join((*BUILTIN, *DENSE))}, replay:DIR (a run folder), "
    "replay:FILE.json (an episode's actions), "
    "python:module:Class or python:path/to/file.py:Class, "
    f"{', '.join(trained.POLICIES)} (trained checkpoints that come along), "
    "a checkpoint, path/to/file.safetensors; a policy that is served, ws://host:port or wss://…, "
    "http://host:port/act, tcp://host:port"
)
SUFFIX = ".safetensors"  # of a checkpoint
MISMATCH = f"{BadCheckpoint.__module__}.{BadCheckpoint.__qualname__}: "  # a traceback's last line
NO_TORCH = "PyTorch is not installed, and checkpoints need it: pip install 'hide-seek[seek]'"


class BadPolicy(ValueError):
    """POLICY names nothing that can play; the message says what is accepted or what is wrong."""


@dataclass(frozen=True)
class Surroundings:
    """What a policy in a process of its own is given besides episodes."""

    timeout: float = 60.0  # s for one answer
    log: Path | None = None  # takes what it prints
    threads: int | None = None  # for its numeric libraries
    sandbox: Sandbox | None = None  # None: what the environment says, else the best
    hidden: tuple[Path, ...] = ()  # folders that a class must not see


class PolicyChoice(ABC):
    """A policy that was asked for: what it needs to be made in another process."""

    @abstractmethod
    def make(self) -> Policy:
        """A new policy."""

    def require(self, tasks: Sequence[str]) -> None:
        """Does nothing if it can play these tasks; asked before any is played.

        Raises:
            BadPolicy: it cannot, and why.
        """
        if reason := self.unfit(tasks):
            raise BadPolicy(reason)

    def unfit(self, _tasks: Sequence[str]) -> str:
        """Why it cannot play these tasks; empty if it can."""
        return ""

    def for_episode(self, _spec: EpisodeSpec) -> "PolicyChoice":
        """What a worker needs to play this episode.

        Raises:
            BadPolicy: the policy knows nothing of this episode.
        """
        return self


@dataclass(frozen=True)
class BuiltIn(PolicyChoice):
    """A policy of hide_tasks; it runs inside the simulator's process."""

    name: str

    def make(self) -> Policy:
        from hide_tasks import policies

        return policies.make(self.name)


@dataclass(frozen=True)
class Actions(PolicyChoice):
    """The recorded actions of one episode."""

    actions: Sequence[Action]

    def make(self) -> Policy:
        from hide_tasks import policies

        return policies.Replay(self.actions)


@dataclass(frozen=True)
class Replayed(PolicyChoice):
    """The recorded actions of another run folder, or of one episode's file."""

    folder: Path
    split: str
    actions: Mapping[tuple[str, int], Sequence[Action]]

    def make(self) -> Policy:
        raise TypeError("A replay is made for one episode at a time; call for_episode first.")

    def for_episode(self, spec: EpisodeSpec) -> PolicyChoice:
        actions = self.actions.get((spec.task, spec.index))
        if actions is None or spec.split != self.split:
            raise BadPolicy(
                f"replay:{self.folder} holds no actions of {spec.name}; evaluate it there first."
            )
        return Actions(actions)


@dataclass(frozen=True)
class Hosted(PolicyChoice):
    """A researcher's own class, in a process of its own."""

    target: str  # module:Class or path/to/file.py:Class
    surroundings: Surroundings = Surroundings()

    @property
    def text(self) -> str:
        """As messages name it."""
        return f"python:{self.target}"

    @property
    def cameras(self) -> tuple[str, ...]:
        """What it is to see through when it is served."""
        return CAMERAS

    def within(self, sandbox: Sandbox) -> Self:
        """The same policy in a sandbox."""
        return replace(self, surroundings=replace(self.surroundings, sandbox=sandbox))

    def check(self, limit: float = LOAD_LIMIT) -> None:
        """Loads the policy once, in at most so many seconds.

        Raises:
            BadPolicy: it cannot be loaded, and why.
        """
        policy = replace(self, surroundings=replace(self.surroundings, log=None)).make()
        try:
            policy.load(limit)
        except PolicyFailure as error:
            reason = str(error).removeprefix(MISMATCH)
            raise BadPolicy(f"{self.text} cannot be loaded: {reason}") from None
        except NotStarted as error:
            raise BadPolicy(f"{self.text} cannot be tried: {error}") from None
        finally:
            policy.close()

    def make(self) -> PolicyProcess:
        where = self.surroundings
        return PolicyProcess(
            self.target,
            timeout=where.timeout,
            log=where.log,
            threads=where.threads,
            sandbox=where.sandbox,
            hidden=where.hidden,
        )


class ChangedCheckpoint(Exception):
    """The file is not the one that was asked for any more."""


@dataclass(frozen=True)
class Checkpoint(Hosted):
    """A file of weights, loaded by SEEK's own code. Made by `of_file`."""

    sha256: str = ""

    @classmethod
    def of_file(
        cls, path: Path, sha256: str, surroundings: Surroundings = Surroundings()
    ) -> "Checkpoint":
        """The policy in a file that has this hash, or had it when it was asked for."""
        return cls(f"{CHECKPOINT}{path.absolute()}", surroundings, sha256)

    @property
    def path(self) -> Path:
        """The file."""
        return Path(self.target.removeprefix(CHECKPOINT))

    @property
    def text(self) -> str:
        """As messages name it."""
        return self.path.name

    @property
    def cameras(self) -> tuple[str, ...]:
        """Those of the suite that it was trained on."""
        return cameras_of(read_header(self.path).provenance.suite)

    def unfit(self, tasks: Sequence[str]) -> str:
        """It was trained on another suite."""
        trained_on = read_header(self.path).provenance.suite
        return fitness.is_of_another_suite(self.path.stem, trained_on, tasks)

    def check(self, limit: float = LOAD_LIMIT) -> None:
        """Loads the checkpoint once, in at most so many seconds.

        Raises:
            BadPolicy: it cannot be loaded, and why.
        """
        if not has_torch():
            raise BadPolicy(f"{self.text} cannot be loaded: {NO_TORCH}.")
        try:
            super().check(limit)
        except ChangedCheckpoint as error:
            raise BadPolicy(f"{self.text} cannot be loaded: {error}.") from None

    def make(self) -> PolicyProcess:
        """A new policy.

        Raises:
            ChangedCheckpoint: training, say, has replaced the file meanwhile.
        """
        if hash_of_file(self.path) != self.sha256:
            raise ChangedCheckpoint(f"{self.path} was replaced; evaluate a copy of it")
        return super().make()


@dataclass(frozen=True)
class Remote(Hosted):
    """A policy that somebody serves; the process is ours, and connects. Made by `of_spec`."""

    allowed: tuple[str, ...] = ()  # see `egress.resolve`
    first_timeout: float = 0.0  # s

    @classmethod
    def of_spec(
        cls, spec: RemotePolicy, allowed: Sequence[str], surroundings: Surroundings = Surroundings()
    ) -> "Remote":
        """The policy at this address; the surroundings' time-out gives way to its own.

        Raises:
            BadPolicy: the address is none, or is certainly not allowed.
        """
        try:
            egress.foresee(egress.parse_url(spec.url, spec.schemes), allowed)
        except egress.Forbidden as error:
            raise BadPolicy(f"{error}.") from None
        told = replace(surroundings, timeout=spec.timeout)
        first = max(spec.timeout, spec.first_timeout)
        return cls(spec.model_dump_json(), told, tuple(allowed), first)

    @property
    def spec(self) -> RemotePolicy:
        """As it was declared."""
        return RemotePolicy.model_validate_json(self.target)

    @property
    def text(self) -> str:
        """As messages name it."""
        return self.spec.url

    def unfit(self, tasks: Sequence[str]) -> str:
        """It was declared to see a camera that one of them lacks."""
        return fitness.lacks_camera(self.text, cameras_in(self.spec.observation or {}), tasks)

    def found(self) -> About:
        """What its server says of itself; connects once.

        Raises:
            BadPolicy: it cannot be played with, and why.
        """
        try:
            process = replace(self, surroundings=replace(self.surroundings, log=None)).make()
        except BadKeys as error:
            raise BadPolicy(str(error)) from None
        try:
            return process.open(patience=0.0)
        except Unreachable as error:
            raise BadPolicy(f"{error}.") from None
        finally:
            process.close()

    def check(self, limit: float = LOAD_LIMIT) -> None:
        """Connects once.

        Raises:
            BadPolicy: it cannot be played with, and why.
        """
        self.found()

    def make(self) -> RemoteProcess:
        """A new process for it.

        Raises:
            BadKeys: the keys of servers cannot be read.
        """
        spec = self.spec
        key = key_of(egress.parse_url(spec.url, spec.schemes))
        process = process_of(Target(policy=spec, allowed=self.allowed, key=key))
        process.log, process.threads = self.surroundings.log, self.surroundings.threads
        return process


def has_torch() -> bool:
    """True if checkpoints can be loaded here; nothing is imported."""
    return find_spec("torch") is not None


def hash_of_file(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def parse(
    text: str,
    surroundings: Surroundings = Surroundings(),
    maps: Path | None = None,
    *,
    folder: Path = trained.FOLDER,
) -> PolicyChoice:
    """The policy that POLICY names.

    Args:
        maps: a file that declares what a remote policy sees and how it acts.
        folder: of the trained checkpoints that go by a name.

    Raises:
        BadPolicy: it names none.
    """
    kind, _, rest = text.partition(":")
    if kind in BY_SCHEME and rest:
        return read_remote(text, surroundings, maps)
    if maps is not None:
        raise BadPolicy(
            f"{maps} declares a remote policy; '{text}' is none, as ws://host:port would be."
        )
    if text in (*BUILTIN, *DENSE):
        return BuiltIn(text)
    if text in trained.POLICIES:
        return read_trained(text, surroundings, folder)
    if kind == "replay" and rest:
        return read_replay(Path(rest))
    if kind == "python" and all(rest.rpartition(":")[::2]):
        return Hosted(rest, surroundings)
    if text.endswith(SUFFIX):
        return read_checkpoint(Path(text), surroundings)
    raise BadPolicy(f"No policy '{text}'.{_nearest(text)} Policies: {ACCEPTED}.")


def _nearest(text: str) -> str:
    near = difflib.get_close_matches(text, (*BUILTIN, *DENSE, *trained.POLICIES), n=1)
    return f" Did you mean {near[0]}?" if near else ""


def read_trained(name: str, surroundings: Surroundings, folder: Path) -> Checkpoint:
    """The policy in a trained checkpoint that comes with the code.

    Raises:
        BadPolicy: it is not installed, or is damaged.
    """
    path = trained.path_of(name, folder)
    if not path.is_file():
        there = ", ".join(trained.there(folder)) or "none of them"
        raise BadPolicy(
            f"{name} is a trained checkpoint, and {path} is not installed (here: {there}). "
            f"Install a release that has it, or hide train {name} and name the file that it writes."
        )
    return read_checkpoint(path, surroundings)


def read_checkpoint(path: Path, surroundings: Surroundings = Surroundings()) -> Checkpoint:
    """The policy in a checkpoint whose header is in order.

    Raises:
        BadPolicy: there is no such file, or it is no checkpoint.
    """
    try:
        read_header(path)
        return Checkpoint.of_file(path, hash_of_file(path), surroundings)
    except BadCheckpoint as error:
        raise BadPolicy(f"{path} is no checkpoint: {error}.") from None
    except OSError as error:
        raise BadPolicy(f"No checkpoint {path}: {error.strerror}.") from None


def read_remote(
    url: str, surroundings: Surroundings = Surroundings(), maps: Path | None = None
) -> Remote:
    """The policy at an address that the user has typed, wherever that is.

    Args:
        maps: a TOML file with `observation`, `action` and what else of `RemotePolicy` differs.

    Raises:
        BadPolicy: the address or the file is wrong; nothing was connected.
    """
    wire = BY_SCHEME.get(url.partition(":")[0], "openpi")
    known = {"timeout": surroundings.timeout, "wire": wire}
    declared = {**known, **(_read_maps(maps) if maps else {}), "url": url}
    try:
        spec = RemotePolicy.model_validate(declared)
        return Remote.of_spec(spec, [egress.parse_url(url, spec.schemes).place], surroundings)
    except ValidationError as error:
        fault = error.errors()[0]
        place = "".join(f"{part}." for part in fault["loc"])[:-1]
        what = f"{place}: {fault['msg']}" if place else fault["msg"]
        raise BadPolicy(f"{maps or url}: {what}.") from None
    except egress.Forbidden as error:
        raise BadPolicy(f"{error}.") from None


def _read_maps(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BadPolicy(f"{path} is no TOML file that can be read: {error}.") from None


def read_replay(folder: Path) -> Replayed:
    """The recorded actions of a run folder, or of one episode's file.

    Raises:
        BadPolicy: it is neither.
    """
    try:
        if folder.suffix == actions_file.ACTIONS_SUFFIX and not folder.is_dir():
            one = actions_file.read(folder)
            return Replayed(folder, one.split, {(one.task, one.index): one.actions})
        actions = run_folder.read_actions(folder)
        return Replayed(folder, run_folder.read(folder).split, actions)
    except (run_folder.FolderError, actions_file.ActionsError) as error:
        raise BadPolicy(f"replay:{folder} has nothing to replay: {error}") from None
