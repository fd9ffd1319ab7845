"""The leaderboard as a page: what of it is shown, in which view, and where each link leads.

Lines of its table are rendered once for a leaderboard that the server keeps: sorted and filtered,
they stand in another order and are the same.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from threading import Lock
from typing import Annotated, Any, Literal

from markupsafe import Markup
from pydantic import Field

from hide_tasks.suite import SUITE
from server import standings
from server.problems import invalid
from server.published import published
from server.schemas.leaderboard import Leaderboard, LeaderboardRow
from server.standings import BoardQuery, Text
from server.suites import without_version
from web import board_charts
from web.templating import part, query

MOST_CHARTED = 8
USUALLY_CHARTED = 6  # the first ones that are shown; the expert beside them
LINES = 100  # of the table, unless all are asked for
MOST_KEPT = 16  # leaderboards and sets of columns: of 250 policies 3 MB each

View = Literal["table", "bars", "radar", "tasks"]
VIEWS: dict[View, str] = {
    "table": "Table",
    "bars": "Categories",
    "radar": "Radar",
    "tasks": "Tasks",
}


class PageQuery(BoardQuery):
    """What of a leaderboard a page shows, and how."""

    view: View = "table"
    published: Literal["yes", "no"] = "yes"  # the paper's figures
    rows: Literal["some", "all"] = "some"
    # name@version, in charts
    policy: Annotated[list[Text], Field(max_length=MOST_CHARTED, default_factory=list)]


class Shown:
    """A leaderboard on a page.

    Args:
        key: stands for `whole` as long as it does not change.
        here: the page's path.
    """

    def __init__(self, whole: Leaderboard, wanted: PageQuery, key: Hashable, here: str = "/"):
        self.whole, self.wanted, self.key, self.here = whole, wanted, key, here
        self.suite = without_version(whole.suite)
        self.board = standings.shown(whole, wanted)
        self.ranked, self.references = standings.apart(self.board.rows)

    def address(self, **changed: object) -> str:
        """The address of this page with something different; None or the usual is left out."""
        return self.here + fields(self.wanted.model_copy(update=changed))

    def export(self, format: str, **more: object) -> str:
        """Where what is shown is given out as a file."""
        only = set(BoardQuery.model_fields)
        found = fields(self.wanted, only, format=format, **more)
        return f"/api/v1/leaderboard/export{found}"

    def sorting(self, column: str) -> str:
        """The address that sorts by a column, or the other way round if it is sorted by it."""
        usual = self.wanted.model_copy(update={"sort": column, "order": None})
        if self.wanted.sort != column or self.wanted.ascending != usual.ascending:
            return self.address(sort=column, order=None)
        return self.address(order="desc" if usual.ascending else "asc")

    def sorted_by(self, *columns: str) -> str | None:
        """How the rows are sorted, in the words of ARIA; None if by none of these columns."""
        if self.wanted.sort not in columns:
            return None
        return "ascending" if self.wanted.ascending else "descending"

    @property
    def hidden_inputs(self) -> list[tuple[str, str]]:
        """What a form with the filters keeps of the address."""
        kept = ("suite", "split", "verdict", "sort", "order", "view", "rows", "policy")
        return _pairs(self.wanted.model_dump(mode="json", include={*kept}, exclude_defaults=True))

    @property
    def choices(self) -> dict[str, list[str]]:
        """What there is to be chosen from in the filters."""
        memories = {row.facts.memory for row in self.whole.rows if row.facts}
        owners = {row.owner for row in self.whole.rows if row.owner}
        chosen = {"memory": memories, "owner": owners}
        for name, found in chosen.items():
            found |= {getattr(self.wanted, name)} - {None}
        return {name: sorted(found, key=str.casefold) for name, found in chosen.items()}

    @property
    def filtered(self) -> bool:
        """True when something is left out on demand."""
        return bool(self.wanted.filters) or self.wanted.category is not None

    @property
    def papers(self) -> bool:
        """True of the suite whose figures the paper printed: they and its table stand here."""
        return self.suite == SUITE

    def drawn(self) -> Markup:
        """The view that is asked for."""
        if self.wanted.view != "table":
            return self._charts()
        ranked = self.ranked if self.wanted.rows == "all" else self.ranked[:LINES]
        lines = self._lines([*ranked, *self.references])
        shown = {
            "page": self,
            "board": self.board,
            "groups": standings.by_category(self.board.columns),
            "ranked": [lines[row.evaluation] for row in ranked],
            "references": [lines[row.evaluation] for row in self.references],
            "more": len(self.ranked) - len(ranked),
            "published": published() if self.papers and self.wanted.published == "yes" else None,
        }
        return part("board.html", shown)

    def _lines(self, rows: Sequence[LeaderboardRow]) -> dict[str, Markup]:
        known = kept_lines((self.key, self.whole.verdict, self.wanted.category))
        groups = standings.by_category(self.board.columns)
        other = "exact" if self.whole.verdict == "success" else "success"
        for row in rows:
            if row.evaluation not in known:
                shown = {"row": row, "board": self.whole, "groups": groups, "other": other}
                known[row.evaluation] = part("board_line.html", shown)
        return known

    def _charts(self) -> Markup:
        shown = {
            "page": self,
            "board": self.board,
            "charted": board_charts.numbered(self._charted()),
            "charts": board_charts,
            "chosen": set(self.wanted.policy),
            "most": MOST_CHARTED,
        }
        return part("board_charts.html", shown)

    def _charted(self) -> list[LeaderboardRow]:
        """The rows that a chart shows.

        Raises:
            Problem: 422, a policy that is asked for does not stand here.
        """
        if self.wanted.policy:
            there = {name_of(row): row for row in self.whole.rows}
            return [_found(there, name) for name in dict.fromkeys(self.wanted.policy)]
        first = self.board.rows[:USUALLY_CHARTED]
        if self.wanted.view == "radar":
            return [row for row in first if not row.reference] or list(first)
        experts = [row for row in self.references if row.policy == "expert" and row not in first]
        return [*first, *experts]


def name_of(row: LeaderboardRow) -> str:
    """A policy's version as addresses say it."""
    return f"{row.policy}@{row.version}"


def _found(there: Mapping[str, LeaderboardRow], name: str) -> LeaderboardRow:
    if name in there:
        return there[name]
    raise invalid("policy", f"'{name}' does not stand on this leaderboard")


def fields(wanted: BoardQuery, only: set[str] | None = None, **more: object) -> str:
    """A query string of all that is not as usual."""
    dumped = wanted.model_dump(mode="json", include=only, exclude_defaults=True)
    return query(**{**dumped, **more})


def _pairs(dumped: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        (name, str(one))
        for name, value in dumped.items()
        for one in (value if isinstance(value, list) else [value])
        if one is not None
    ]


_lines_of: dict[Hashable, dict[str, Markup]] = {}
_keeping = Lock()


def kept_lines(key: Hashable) -> dict[str, Markup]:
    """Lines that were rendered, by evaluation; whoever misses one adds it."""
    with _keeping:
        if key not in _lines_of and len(_lines_of) >= MOST_KEPT:
            _lines_of.pop(next(iter(_lines_of)))
        return _lines_of.setdefault(key, {})


def tabs(wanted: PageQuery, suites: Iterable[str]) -> list[tuple[str, str, bool]]:
    """Each suite with a leaderboard: its name, its address, and whether it is shown."""
    usual = PageQuery(split=wanted.split, verdict=wanted.verdict, view=wanted.view, policy=[])
    return [
        (name, "/" + fields(usual.model_copy(update={"suite": name})), name == wanted.suite)
        for name in suites
    ]
