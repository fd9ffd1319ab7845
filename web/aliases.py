"""Which alias pair is shown first: two moments that look the same and need different actions."""

from collections.abc import Sequence

from server import tasks
from server.schemas.tasks import AliasPublic

EXPLAINS = "push_button_times"  # the task whose alias pair explains the project


def clearest(aliases: Sequence[AliasPublic]) -> int | None:
    """The number of the pair that is understood at once: the fewest pixels differ, late in it."""
    if not aliases:
        return None
    exact = [n for n, one in enumerate(aliases, 1) if max(one.pixels.values()) == 0]
    return exact[len(exact) // 2] if exact else 1


def explaining() -> tuple[str, AliasPublic] | None:
    """A task's name and its alias pair that explain the project."""
    found = tasks.task(EXPLAINS).aliases
    number = clearest(found)
    return (EXPLAINS, found[number - 1]) if number else None
