"""The leaderboard as somebody asks for it: some of its rows and columns, in another order.

Ranks stay those among all policies by the verdict that ranks. What is missing in a column that is
sorted by comes last, both ways; reference policies stay apart.
"""

from collections.abc import Callable, Sequence
from datetime import UTC, date
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, model_validator
from sqlalchemy.orm import Session

from hide_tasks.contract import Category, Split
from hide_tasks.suite import SUITE
from server import leaderboard
from server.schemas.common import Verdict
from server.schemas.leaderboard import Leaderboard, LeaderboardColumn, LeaderboardRow
from server.suites import BOARDS, BoardName

Order = Literal["asc", "desc"]
Value = float | str | None
RANK = "rank"
TEXTS = ("policy",)  # sorted from A to Z unless it is said otherwise
OF_ROW = ("overall", "normalised", "gap", "belief", "ended")
CATEGORIES = tuple(str(one) for one in Category)
SORTS = (
    RANK,
    *TEXTS,
    *OF_ROW,
    *CATEGORIES,
    *dict.fromkeys(task for tasks in BOARDS.values() for task in tasks),
)


def _known(column: str) -> str:
    if column not in SORTS:
        raise ValueError(f"is '{column}'; a board is sorted by one of {', '.join(SORTS)}")
    return column


Sort = Annotated[str, AfterValidator(_known), Field(description=f"One of: {', '.join(SORTS)}.")]
Text = Annotated[str, Field(max_length=80)]


class BoardQuery(BaseModel):
    """Which leaderboard, and what of it; it travels in the address."""

    suite: BoardName = SUITE
    split: Split = "test"
    verdict: Verdict = Field("success", description="Ranks by it.")
    category: Category | None = Field(None, description="Only its columns; ranks are overall.")
    search: Text | None = Field(None, description="Stands in the policy's name or version.")
    memory: Text | None = Field(None, description="As `facts.memory` says, e.g. SCM+WCM+PAM.")
    clock: Literal["yes", "no", "unknown"] | None = None
    privileged: Literal["show", "hide"] = Field("show", description="What is known to be so.")
    owner: Text | None = None
    since: date | None = Field(None, description="Evaluated on this day (UTC) or later.")
    sort: Sort = RANK
    order: Order | None = Field(None, description="Default: best, newest, or A first.")

    @model_validator(mode="before")
    @classmethod
    def _empty_is_none(cls, given: Any) -> Any:
        """A form sends what was not chosen as an empty text."""
        return {name: value for name, value in dict(given).items() if value not in ("", [""])}

    @property
    def ascending(self) -> bool:
        """Which way it is sorted."""
        usual: Order = "asc" if self.sort in (RANK, *TEXTS) else "desc"
        return (self.order or usual) == "asc"

    @property
    def filters(self) -> dict[str, Any]:
        """The filters that leave out rows and are set, as the address says them."""
        named = self.model_dump(mode="json", include=set(FILTERS), exclude_defaults=True)
        return {name: named[name] for name in FILTERS if name in named}


def of(session: Session, wanted: BoardQuery) -> Leaderboard:
    """The leaderboard that is asked for."""
    return shown(whole(session, wanted), wanted)


def whole(session: Session, wanted: BoardQuery) -> Leaderboard:
    """It with all of its rows and columns, in its own order."""
    return leaderboard.leaderboard(
        session, split=wanted.split, verdict=wanted.verdict, of=wanted.suite
    )


def shown(board: Leaderboard, wanted: BoardQuery) -> Leaderboard:
    """The leaderboard that is asked for; the same object if it is all of it in its own order."""
    rows = [row for row in board.rows if fits(row, wanted)]
    ranked, references = apart(rows)
    columns = [one for one in board.columns if wanted.category in (None, one.category)]
    found = [*ordered(ranked, wanted), *ordered(references, wanted)]
    if found == board.rows and len(columns) == len(board.columns):
        return board
    changes = {"rows": found, "columns": columns, "left_out": len(board.rows) - len(rows)}
    return board.model_copy(update=changes)


def apart(rows: Sequence[LeaderboardRow]) -> tuple[list[LeaderboardRow], list[LeaderboardRow]]:
    """Those that are ranked, and the reference policies."""
    return [one for one in rows if not one.reference], [one for one in rows if one.reference]


def fits(row: LeaderboardRow, wanted: BoardQuery) -> bool:
    """True unless a filter leaves the row out."""
    return all(FILTERS[name](row, getattr(wanted, name)) for name in wanted.filters)


def _named(row: LeaderboardRow, text: str) -> bool:
    return text.casefold() in f"{row.policy}@{row.version}".casefold()


def _ended_since(row: LeaderboardRow, day: date) -> bool:
    return row.ended.astimezone(UTC).date() >= day


def _owned(row: LeaderboardRow, owner: str) -> bool:
    return row.owner == owner


def _remembering(row: LeaderboardRow, memory: str) -> bool:
    return row.facts is not None and row.facts.memory == memory


def _with_clock(row: LeaderboardRow, clock: str) -> bool:
    return clock == clock_of(row)


def clock_of(row: LeaderboardRow) -> str:
    """Whether a policy is told the number of its decision: yes, no, or unknown."""
    told = row.facts.clock if row.facts else None
    return "unknown" if told is None else "yes" if told else "no"


def _unprivileged(row: LeaderboardRow, _: str) -> bool:
    return not (row.facts and row.facts.privileged)


FILTERS: dict[str, Callable[[LeaderboardRow, Any], bool]] = {
    "search": _named,
    "memory": _remembering,
    "clock": _with_clock,
    "privileged": _unprivileged,
    "owner": _owned,
    "since": _ended_since,
}


def ordered(rows: Sequence[LeaderboardRow], wanted: BoardQuery) -> list[LeaderboardRow]:
    """The rows by a column; equal ones as they were."""
    if wanted.sort == RANK:
        return list(rows) if wanted.ascending else list(reversed(rows))
    values = [(value_of(row, wanted.sort, wanted.verdict), row) for row in rows]
    known = [(value, row) for value, row in values if value is not None]
    known.sort(key=lambda pair: pair[0], reverse=not wanted.ascending)
    return [row for _, row in known] + [row for value, row in values if value is None]


def value_of(row: LeaderboardRow, column: str, verdict: Verdict) -> Value:
    """What a row is sorted by; None if it has nothing there."""
    if column == "policy":
        return f"{row.policy.casefold()}@{row.version:09}"
    if column == "ended":
        return row.ended.timestamp()
    if column in ("normalised", "gap", "belief"):
        found = getattr(row, column)
        return None if found is None else found.value
    rates = {"overall": row.overall, **row.categories, **row.tasks}.get(column)
    return getattr(rates, verdict).value if rates else None


def by_category(
    columns: Sequence[LeaderboardColumn],
) -> list[tuple[Category, list[LeaderboardColumn]]]:
    """The columns by category, in the paper's order."""
    found = ((kind, [column for column in columns if column.category is kind]) for kind in Category)
    return [(kind, tasks) for kind, tasks in found if tasks]
