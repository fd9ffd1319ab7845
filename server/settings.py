"""Every setting of the server: an option of `hide serve`, or HIDE_SERVER_… in the environment."""

from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from workers.evaluation import count_cpus

LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Settings(BaseSettings):
    """How a server is to run.

    Raises:
        ValidationError: a value is out of range, from the environment as well.
    """

    model_config = SettingsConfigDict(env_prefix="HIDE_SERVER_", frozen=True)

    data: Path = Path("data")  # the ledger, recordings and logs
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000  # 0: any that is free
    workers: Annotated[int, Field(ge=0, le=256)] = Field(default_factory=count_cpus)
    allow_python: bool = False  # may a client name a Python class of this machine as a policy?
    # hosts, host:port and networks where a remote policy may be besides the internet over TLS
    allow_remote: tuple[str, ...] = ()
    references: bool = True  # evaluate the built-in policies on first start?
    checkpoint_limit: Annotated[int, Field(gt=0)] = 4 * 2**30  # bytes of an uploaded one
    # s of wall time for an episode; what a Python policy may take comes on top
    episode_limit: Annotated[float, Field(gt=0)] = 600.0
