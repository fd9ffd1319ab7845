"""Which of several policies managed which episode: a line per task, a cell per episode.

A cell has a stripe per policy, the first on top: full if it managed the episode.
"""

from collections.abc import Callable, Sequence

from markupsafe import Markup

from server.schemas.several import SeveralEpisode
from web.charts import element
from web.templating import query

PITCH, WIDTH = 24, 20  # px from cell to cell, and of a cell
LETTERS = "ABCDEF"
Shown = Callable[[SeveralEpisode], bool]


def stripe(count: int) -> int:
    """The height of a stripe in px, of as many policies."""
    return 10 if count == 2 else 6


def beside(one: SeveralEpisode) -> str:
    """The page of two runs of an episode: one that failed, one that managed, if there are both."""
    first = one.managed.index(False) if False in one.managed else 0
    other = one.managed.index(True) if True in one.managed else 1
    other = other if other != first else 1
    return f"/episodes/{one.episodes[first]}{query(beside=one.episodes[other])}"


def who(one: SeveralEpisode) -> str:
    """Which policies managed an episode, in words."""
    named = [LETTERS[place] for place, good in enumerate(one.managed) if good]
    if len(named) == len(one.managed):
        return "both managed it" if len(named) == 2 else "all managed it"
    return f"{', '.join(named)} managed it" if named else "none managed it"


def task_line(ones: Sequence[SeveralEpisode], shown: Shown) -> Markup:
    """The cells of a task; an episode that is not shown leaves a dot."""
    height = _height(len(ones[0].managed))
    width = (max(one.index for one in ones) + 1) * PITCH
    cells = [_cell(one) if shown(one) else _dot(one, height) for one in ones]
    name = f"episode-grid {ones[0].category.value}"
    return element("svg", *cells, class_=name, width=width, height=height)


def indices(last: int) -> Markup:
    """The head of the grid: the number of every fifth episode."""
    marks = [
        element("text", str(index), x=index * PITCH + WIDTH / 2, y=11, text_anchor="middle")
        for index in range(0, last + 1, 5)
    ]
    size = {"width": (last + 1) * PITCH, "height": 14}
    return element("svg", *marks, class_="episode-numbers", aria_hidden="true", **size)


def _height(count: int) -> int:
    return count * stripe(count) + 2


def _cell(one: SeveralEpisode) -> Markup:
    high = stripe(len(one.managed))
    x, height = one.index * PITCH, _height(len(one.managed))
    full = "".join(
        f"M{x + 1} {1 + place * high}h{WIDTH - 2}v{high - 1}h-{WIDTH - 2}z"
        for place, good in enumerate(one.managed)
        if good
    )
    said = f"{one.task} {one.index}: {who(one)}"
    back = element("rect", x=x, width=WIDTH, height=height - 1, rx=1)
    marks = [back, element("path", d=full)] if full else [back]
    return element("a", element("title", said), *marks, href=beside(one))


def _dot(one: SeveralEpisode, height: int) -> Markup:
    middle = one.index * PITCH + WIDTH / 2
    return element("circle", cx=middle, cy=height / 2, r=1.5)
