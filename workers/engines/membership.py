"""How a machine becomes part of a cluster: it shows a token to the server, which tells the rest."""

from typing import TYPE_CHECKING, Annotated

import httpx
from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from distributed import Security

CLUSTER = "/api/v1/cluster"
TIMEOUT = 15.0  # s for the server's answer


class NoMember(Exception):
    """The server does not let this machine in; the message is one line."""

    def __init__(self, message: str, *, final: bool):
        super().__init__(message)
        self.final = final  # asking again would not help


class Membership(BaseModel):
    """Where the cluster's scheduler is, and what its members know each other by.

    Whoever has the key may run code on every member; it travels to those who show a token of the
    scope `worker`, and stands in the server's data folder.
    """

    model_config = ConfigDict(frozen=True)

    scheduler: Annotated[str, Field(pattern=r"^tls://.+:\d+$")]
    certificate: str  # PEM; signed by itself, and the only one that members accept
    key: Annotated[str, Field(repr=False)]  # PEM

    def security(self) -> "Security":
        """Dask's settings: both sides of every connection show the certificate."""
        from distributed import Security

        both = {"cert": self.certificate, "key": self.key}
        roles = ("client", "scheduler", "worker")
        shown = {f"tls_{role}_{name}": text for role in roles for name, text in both.items()}
        return Security(require_encryption=True, tls_ca_file=self.certificate, **shown)


def ask(server: str, token: str | None) -> Membership:
    """What the server tells a machine that may join.

    Raises:
        NoMember: it cannot be reached, or does not let this machine in.
    """
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    try:
        answer = httpx.get(
            f"{server.rstrip('/')}{CLUSTER}", headers=headers, timeout=TIMEOUT, trust_env=False
        )
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        wrong = isinstance(error, httpx.UnsupportedProtocol | httpx.InvalidURL)
        raise NoMember(f"{server} cannot be reached: {error}", final=wrong) from None
    if answer.is_success:
        return Membership.model_validate_json(answer.content)
    refused = f"{server} answers {answer.status_code}: {_detail(answer)}"
    raise NoMember(refused, final=answer.status_code < 500 and answer.status_code != 429)


def _detail(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return " ".join(answer.text.split())[:200]
