"""What the arguments of a command mean, checked before anything is done."""

import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hide_tasks.contract import Split
    from server.settings import Settings


class BadUsage(Exception):
    """What was asked for cannot be; the message is the one line that the user reads."""


def settings_of(given: Mapping[str, Any]) -> "Settings":
    """The server's settings: what is given, else the environment's, else the defaults.

    Raises:
        BadUsage: one is out of range.
    """
    from pydantic import ValidationError

    from server.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        fault = error.errors()[0]
        name = f"HIDE_SERVER_{fault['loc'][0]}".upper()
        raise BadUsage(f"{name}={fault['input']}: {fault['msg']}.") from None


def chosen_tasks(
    names: str, category: str | None = None, suite: str | None = None
) -> tuple[str, ...]:
    """The tasks that are named with commas between, or those of a suite, or of a category of it.

    In order, all of one suite; `hide` where none is named.

    Raises:
        BadUsage: there is no such task, category or suite, names and a category were given, or
            tasks of another suite.
    """
    from hide_tasks import SUITES, UnknownTask, load
    from hide_tasks.catalogue import suite_of
    from hide_tasks.contract import Category

    if suite not in (None, *SUITES):
        raise BadUsage(f"--suite {suite}: no such suite; there are {', '.join(SUITES)}.")
    if category not in (None, *Category):
        raise BadUsage(f"--category {category}: no such category; there are {', '.join(Category)}.")
    if names and category:
        raise BadUsage("--tasks and --category exclude each other; give one of them.")
    named = [name.strip() for name in names.split(",") if name.strip()]
    if names and not named:
        raise BadUsage(f"--tasks {names}: names no task; leave it out for all, or name some.")
    wanted = named or SUITES[suite or "hide"]
    try:
        categories = {name: load(name).category for name in wanted}
        found = sorted({suite_of(name) for name in wanted} | ({suite} if suite else set()))
    except UnknownTask as error:
        raise BadUsage(str(error)) from None
    if len(found) > 1:
        raise BadUsage(
            f"--tasks {names}: these and what else is asked for are of suites "
            f"{' and '.join(found)}; give tasks of one."
        )
    return _in_order(name for name in categories if category in (None, categories[name]))


def _in_order(names: Iterable[str]) -> tuple[str, ...]:
    from workers.results import in_order

    return tuple(in_order(names))


def episode_count(episodes: int | None, split: "Split") -> int | None:
    """The number of episodes per task; None for all.

    Raises:
        BadUsage: the split does not have so many.
    """
    from hide_tasks.suite import SPLITS

    most = SPLITS[split]
    if episodes is not None and not 1 <= episodes <= most:
        raise BadUsage(f"--episodes {episodes}: {split} has {most} a task; give 1 to {most}.")
    return episodes


def episode_indices(
    indices: Iterable[int] | None, episodes: int | None, split: "Split"
) -> tuple[int, ...]:
    """The episodes that are named, each once, in order; none: they are counted instead.

    Raises:
        BadUsage: the split does not have one of them, or they are counted as well.
    """
    from hide_tasks.suite import SPLITS

    named, most = sorted(set(indices or ())), SPLITS[split] - 1
    if named and episodes is not None:
        raise BadUsage("--index and --episodes exclude each other; give one of them.")
    for index in named:
        if not 0 <= index <= most:
            raise BadUsage(f"--index {index}: {split} has none; give 0 to {most}.")
    return tuple(named)


def new_folder(policy: str, suite: str) -> Path:
    """A folder under runs/ that is not there yet, named after policy, suite and time."""
    name = re.sub(r"[^\w.]+", "-", policy).strip("-.")
    stem = f"{name}-{suite}-{datetime.now():%Y%m%d-%H%M%S}"
    names = [stem, *(f"{stem}-{number}" for number in range(2, 100))]
    return next(path for path in (Path("runs", name) for name in names) if not path.exists())
