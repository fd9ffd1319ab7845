"""What a server says while it runs: lines for people, or JSON lines for programs."""

import logging
import sys
from collections.abc import Callable
from typing import Literal

import typer
from pythonjsonlogger.core import RESERVED_ATTRS
from pythonjsonlogger.json import JsonFormatter

OURS = ("server", "web", "workers")  # other libraries warn, no more
Format = Literal["text", "json"]
Level = Literal["DEBUG", "INFO", "WARNING", "ERROR"]
logger = logging.getLogger(__name__)


class TextFormatter(logging.Formatter):
    """Time, level, sentence, then its facts."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line, before any traceback."""
        facts = [f"{k}={v}" for k, v in vars(record).items() if k not in RESERVED_ATTRS]
        return " ".join([super().formatMessage(record), *facts])


def json_formatter() -> logging.Formatter:
    """Time (RFC 3339, UTC), level, logger, message, facts and, of an exception, `exc_info`."""
    return JsonFormatter(
        ("levelname", "name", "message"),
        rename_fields={"levelname": "level", "name": "logger"},
        timestamp="time",
    )


def configure(form: Format, level: Level | None) -> Callable[[str], None]:
    """Begins to say things on standard error; gives what announces the server's address.

    Args:
        form: of the lines.
        level: from which on; default: INFO as JSON, for people WARNING.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(json_formatter() if form == "json" else TextFormatter())
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    for name in OURS:
        logging.getLogger(name).setLevel(level or ("INFO" if form == "json" else "WARNING"))
    return _announce_json if form == "json" else _announce


def _announce(url: str) -> None:
    typer.echo(f"HIDE-SEEK: {url} (Ctrl-C stops)", err=True)


def _announce_json(url: str) -> None:
    logger.info("The server answers", extra={"url": url})
