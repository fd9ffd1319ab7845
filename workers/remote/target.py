"""A remote policy as a worker is told of it, and what it finds out."""

from pydantic import BaseModel, ConfigDict, computed_field

from hide_tasks.contract import PolicyFailure
from workers.policy_host import REMOTE
from workers.policy_process import PolicyProcess
from workers.protocol import RemotePolicy
from workers.remote.wires import STATELESS, Dialect
from workers.sandbox.choice import Sandbox

PATIENCE = 5.0  # s for a server that refuses connections, once it was there
OPEN_LIMIT = 60.0  # s until a server has said what it is, whatever it does
REASONS = tuple(  # in front of messages that speak for themselves
    f"workers.remote.{name}: " for name in ("client.BadServer", "egress.Forbidden")
)


class Unreachable(Exception):
    """A remote policy cannot be played with now; no fault of the policy, and never scored."""


class Target(BaseModel):
    """A remote policy and how it may be reached, as the process that connects is told."""

    model_config = ConfigDict(frozen=True, hide_input_in_errors=True)

    policy: RemotePolicy
    allowed: tuple[str, ...] = ()  # see `egress.resolve`
    key: str | None = None


class About(BaseModel):
    """What was found out about a server."""

    model_config = ConfigDict(frozen=True)

    dialect: Dialect
    model: str = ""
    sessions: int = 1  # at a time
    sees: tuple[str, ...] = ()  # entries of its observations, if it declares them
    cameras: tuple[str, ...] = ()  # that its observations are to come from
    acts: str = ""  # the kind of its actions, if it declares it

    @computed_field  # type: ignore[prop-decorator]
    @property
    def stateless_transport(self) -> bool:
        """True if nothing but a new connection tells the policy of a new episode."""
        return self.dialect in STATELESS


class RemoteProcess(PolicyProcess):
    """A policy of the contract whose process speaks with a server; `open` comes before a reset."""

    def open(self, patience: float = PATIENCE) -> About:
        """Connects for an episode; what the server says of itself.

        Raises:
            Unreachable: there is no server with which an episode could be played.
        """
        try:
            self.load()
            return About.model_validate(self._ask({"open": patience}, OPEN_LIMIT)["about"])
        except PolicyFailure as error:
            raise Unreachable(_without_type(str(error))) from None


def _without_type(message: str) -> str:
    for reason in REASONS:
        message = message.removeprefix(reason)
    return message


def process_of(target: Target) -> RemoteProcess:
    """The process that plays a remote policy; it is started when it is needed."""
    policy = target.policy
    return RemoteProcess(
        f"{REMOTE}{target.model_dump_json()}",
        timeout=policy.timeout,
        first_timeout=max(policy.timeout, policy.first_timeout),
        sandbox=Sandbox.NONE,  # it is our own code, and needs the network
    )
