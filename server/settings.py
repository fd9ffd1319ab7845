"""Every setting of the server: an option of `hide serve`, or HIDE_SERVER_… in the environment."""

from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from seek_model.trained import FOLDER
from workers.evaluation import count_cpus
from workers.sandbox.choice import BEST

LEDGER = "ledger.sqlite3"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
EVERY_ADDRESS = ("0.0.0.0", "::")
Rate = Annotated[str, Field(pattern=r"^[1-9]\d{0,8}/(second|minute|hour|day)$")]
Count = Annotated[int, Field(ge=0)]


def _as_url(text: str) -> str:
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.path.strip("/"):
        raise ValueError("should be like https://evaluation.example.org")
    return text.rstrip("/")


class Settings(BaseSettings):
    """How a server is to run.

    Raises:
        ValidationError: a value is out of range, from the environment as well.
    """

    model_config = SettingsConfigDict(env_prefix="HIDE_SERVER_", frozen=True)

    data: Path = Path("data")  # the ledger, recordings and logs
    # postgresql+psycopg://…, where the ledger is instead; a secret, for it may hold a password
    database: SecretStr | None = None
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000  # 0: any that is free
    workers: Annotated[int, Field(ge=0, le=256)] = Field(default_factory=count_cpus)
    # tls://…, where machines of a cluster reach its scheduler; they play instead of this one
    scheduler: Annotated[str, Field(pattern=r"^tls://[^/\s]+:\d+$")] | None = None
    allow_python: bool = False  # may a client name a Python class of this machine as a policy?
    sandbox: str = BEST  # around the process of a policy: best, bubblewrap, landlock or none
    # hosts, host:port and networks where a remote policy may be besides the internet over TLS
    allow_remote: tuple[str, ...] = ()
    allow_webhook: tuple[str, ...] = ()  # and where receivers of webhooks may be
    log_format: Literal["text", "json"] = "text"  # of what the server says on standard error
    # from which on; default: INFO as json, else WARNING
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] | None = None
    references: bool = True  # evaluate the server's own policies on first start?
    # Of the trained checkpoints that are its own as well; an empty one: none are
    trained: Path = FOLDER
    smoke: bool = True  # play a new checkpoint's suite `smoke` at once?
    checkpoint_limit: Annotated[int, Field(gt=0)] = 4 * 2**30  # bytes of an uploaded one
    # Recordings that are removed to make room, never results; null: none
    keep_days: Annotated[float, Field(gt=0)] | None = None  # older ones go
    keep_bytes: Count | None = None  # of all of them; the oldest go first
    # s of wall time for an episode; what a Python policy may take comes on top
    episode_limit: Annotated[float, Field(gt=0)] = 600.0
    # local: everything is done as one owner; users: everybody signs in
    auth: Literal["local", "users"] = "local"
    token: bool | None = None  # local: ask for the printed token? default: beyond this machine
    # the address that people use, when a proxy or another machine stands between
    public_url: Annotated[str, AfterValidator(_as_url)] | None = None
    # In users mode, for whoever is no maintainer; null means without bound:
    quota_attempts: Count | None = 50  # evaluations in 24 hours
    quota_scored: Count | None = 10  # of them, of the whole suite's test split, in 30 days
    quota_storage: Count | None = 20 * 2**30  # bytes of checkpoints
    rate: Rate = "1200/minute"  # requests of one user
    rate_unknown: Rate = "120/minute"  # requests of one address without a user
    rate_sign_in: Rate = "10/minute"  # tries to sign in, of one address and at one name

    @property
    def ledger(self) -> Path | str:
        """Where the ledger is: a file of the data folder, or the address of a database."""
        return self.database.get_secret_value() if self.database else self.data / LEDGER

    @property
    def hosts(self) -> frozenset[str]:
        """Names under which the server may be addressed."""
        public = urlsplit(self.public_url).hostname if self.public_url else None
        bound = None if self.host in EVERY_ADDRESS else self.host
        return frozenset({*LOOPBACK, *(name.lower() for name in (public, bound) if name)})

    @property
    def beyond(self) -> bool:
        """True if others than this machine's users may reach it."""
        return self.host not in LOOPBACK or bool(self.hosts - set(LOOPBACK))

    @property
    def asks_token(self) -> bool:
        """True if the owner of local mode has to show the printed token."""
        return self.auth == "local" and (self.beyond if self.token is None else self.token)

    @property
    def is_open(self) -> bool:
        """True if whoever reaches the server is its owner."""
        return self.auth == "local" and not self.asks_token

    @property
    def secure(self) -> bool:
        """True if browsers reach it by TLS."""
        return (self.public_url or "").startswith("https:")
