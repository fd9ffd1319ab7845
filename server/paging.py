"""Lists in pages: opaque cursors that say where the last page ended."""

import base64
import json
from collections.abc import Callable, Sequence
from typing import TypeVar

from server.problems import invalid
from server.schemas.common import Page

Row = TypeVar("Row")
Item = TypeVar("Item")
Place = list[str | int]
MOST = 200  # items of a page


def after(cursor: str | None, kinds: Sequence[type]) -> Place | None:
    """Where the last page ended; None for the first page.

    Raises:
        Problem: 422, the cursor was not given out by this list.
    """
    if cursor is None:
        return None
    try:
        place = json.loads(base64.urlsafe_b64decode(cursor.encode() + b"=="))
        if [type(part) for part in place] != list(kinds) or not all(map(_is_storable, place)):
            raise ValueError
    except (ValueError, TypeError):
        raise invalid("cursor", "was not given out by this list; leave it out to begin") from None
    return list(place)


def _is_storable(part: str | int) -> bool:
    """True for what a database can compare with."""
    return abs(part) < 2**63 if isinstance(part, int) else part.isprintable()


def page(
    rows: Sequence[Row], limit: int, place: Callable[[Row], Place], public: Callable[[Row], Item]
) -> Page[Item]:
    """The first `limit` of the rows, of which one more was asked for to know if there are more."""
    shown = rows[:limit]
    more = len(rows) > limit
    cursor = base64.urlsafe_b64encode(json.dumps(place(shown[-1])).encode()) if more else None
    items = [public(row) for row in shown]
    return Page(items=items, next=cursor.decode().rstrip("=") if cursor else None)
