"""Orders of episodes, each total, so that any episode says where a list goes on."""

from enum import StrEnum
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, UnaryExpression, and_, func, or_

from server.models import Episode
from server.paging import Place


class Sort(StrEnum):
    """How episodes are ordered."""

    NEWEST = "newest"  # those of the newest evaluation first, by task and index
    TASK = "task"  # by task and index: the same episode of all evaluations in a row
    FEWEST = "decisions"  # fewest decisions first
    MOST = "-decisions"  # most decisions first


class Key(NamedTuple):
    """One column of an order."""

    name: str
    kind: type
    falls: bool = False

    @property
    def column(self) -> ColumnElement[Any]:
        """What is compared; an episode that is not final has taken no decision."""
        column: ColumnElement[Any] = getattr(Episode, self.name)
        return func.coalesce(column, 0) if self.name == "decisions" else column


NEWEST = (Key("evaluation_id", str, falls=True), Key("task", str), Key("index", int))
ORDERS = {
    Sort.NEWEST: NEWEST,
    Sort.TASK: (Key("task", str), Key("index", int), Key("evaluation_id", str, falls=True)),
    Sort.FEWEST: (Key("decisions", int), *NEWEST),
    Sort.MOST: (Key("decisions", int, falls=True), *NEWEST),
}


def kinds(sort: Sort) -> list[type]:
    """Of the values of a place."""
    return [key.kind for key in ORDERS[sort]]


def place(episode: Episode, sort: Sort) -> Place:
    """Where an episode stands."""
    return [getattr(episode, key.name) or key.kind() for key in ORDERS[sort]]


def ordered(sort: Sort, *, back: bool = False) -> list[UnaryExpression[Any]]:
    """What to order by; `back`: the other way round."""
    return [key.column.desc() if key.falls != back else key.column.asc() for key in ORDERS[sort]]


def beyond(sort: Sort, at: Place, *, back: bool = False) -> ColumnElement[bool]:
    """True for what comes after a place; `back`: before it."""
    steps: list[ColumnElement[bool]] = []
    same: list[ColumnElement[bool]] = []
    for key, value in zip(ORDERS[sort], at, strict=True):
        further = key.column < value if key.falls != back else key.column > value
        steps.append(and_(*same, further))
        same.append(key.column == value)
    return or_(*steps)
