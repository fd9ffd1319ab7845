"""What is taken out of a server: an evaluation or the leaderboard, as files, piece by piece.

Nothing is held as a whole, and no session stays open while somebody reads slowly.
"""

import csv
import io
import json
import zipfile
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import Any, TypeVar

from pydantic import BaseModel

from hide_tasks import ALL_TASKS
from hide_tasks.suite import SUITE
from server import episodes, evaluations, latex
from server.db import Database
from server.paging import MOST
from server.problems import invalid
from server.schemas.common import Verdict, Verdicts
from server.schemas.episodes import EpisodePublic
from server.schemas.evaluations import EvaluationPublic
from server.states import EpisodeState
from server.suites import without_version

FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would calculate
NOTE = "Measured in PyBullet; not comparable with the paper's table, measured in another simulator."
EPISODE_COLUMNS = [
    "evaluation",
    "policy",
    "task",
    "category",
    "split",
    "index",
    "variation",
    "state",
    "instruction",
    "success",
    "exact",
    "failure",
    "detail",
    "decisions",
    "stage",
    "scene_hash",
    "final_state_hash",
    "sandbox",
    "committed",
    "id",
]


class EvaluationFormat(StrEnum):
    """How an evaluation is given out."""

    JSON = "json"  # the evaluation, its rates per task, its episodes
    CSV = "csv"  # a line per episode
    JSONL = "jsonl"  # a document per final episode, with all decisions
    LATEX = "latex"  # the row of the paper's table; of its suite alone
    ZIP = "zip"  # all of these


class TableFormat(StrEnum):
    """How a table is given out: a leaderboard, a comparison, ablations."""

    JSON = "json"
    CSV = "csv"
    LATEX = "latex"


class EpisodesFormat(StrEnum):
    """How episodes of a filter are given out."""

    CSV = "csv"
    JSONL = "jsonl"


MEDIA_TYPES = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "jsonl": "application/jsonl",
    "latex": "application/x-latex",
    "zip": "application/zip",
}
SUFFIXES = {"latex": "tex"}  # where it is not the format's name
ZIPPED = {
    EvaluationFormat.JSON: "evaluation.json",
    EvaluationFormat.CSV: "episodes.csv",
    EvaluationFormat.JSONL: "episodes.jsonl",
    EvaluationFormat.LATEX: "row.tex",
}


def require_papers(format: EvaluationFormat | TableFormat, suite: str) -> None:
    """Does nothing unless the paper's table is asked for of a suite that it does not have.

    Raises:
        Problem: 422, it is; it names the formats that there are.
    """
    if format == "latex" and suite != SUITE:
        others = ", ".join(one.value for one in type(format) if one != format)
        table = f"is the paper's table, of suite '{SUITE}' alone"
        raise invalid("format", f"'{format.value}' {table}; of '{suite}' there are {others}")


class Exported:
    """One evaluation on its way out.

    Args:
        verdict: by which the LaTeX row is made.
    """

    def __init__(self, database: Database, evaluation: EvaluationPublic, verdict: Verdict):
        self.database, self.evaluation, self.verdict = database, evaluation, verdict

    def pieces(self, format: EvaluationFormat) -> Iterator[bytes]:
        """The file, as it is made."""
        if format is EvaluationFormat.ZIP:
            return zipped({name: make() for name, make in self._files().items()})
        return self._makers()[format]()

    def _makers(self) -> dict[EvaluationFormat, Callable[[], Iterator[bytes]]]:
        return {
            EvaluationFormat.JSON: self._json,
            EvaluationFormat.CSV: self._csv,
            EvaluationFormat.JSONL: self._jsonl,
            EvaluationFormat.LATEX: self._latex,
        }

    def _files(self) -> dict[str, Callable[[], Iterator[bytes]]]:
        makers = self._makers()
        if without_version(self.evaluation.suite) != SUITE:
            del makers[EvaluationFormat.LATEX]
        folder = self.evaluation.id
        return {f"{folder}/{ZIPPED[format]}": make for format, make in makers.items()}

    def _pages(self, **wanted: Any) -> Iterator[list[EpisodePublic]]:
        return pages_of(self.database, evaluation=self.evaluation.id, **wanted)

    def _tasks(self) -> dict[str, Verdicts]:
        with self.database.reading() as session:
            counted = evaluations.counts_by_task(session, self.evaluation.id)
        order = [name for name in ALL_TASKS if name in counted]
        return {name: evaluations.verdicts(counted[name]) for name in order}

    def _json(self) -> Iterator[bytes]:
        tasks = {name: one.model_dump(mode="json") for name, one in self._tasks().items()}
        head = f'{{"evaluation":{self.evaluation.model_dump_json()},"tasks":{json.dumps(tasks)},'
        yield f'{head}"episodes":['.encode()
        before = ""
        for page in self._pages():
            for one in page:
                yield f"{before}\n{one.model_dump_json()}".encode()
                before = ","
        yield b"\n]}\n"

    def _csv(self) -> Iterator[bytes]:
        return _episodes_csv(self._pages())

    def _jsonl(self) -> Iterator[bytes]:
        for page in self._pages(state=EpisodeState.FINAL):
            for one in page:
                with self.database.reading() as session:
                    found = episodes.get(session, one.id).model_dump(mode="json")
                    made = episodes.decisions(session, one.id)
                found["decisions"] = [decision.model_dump(mode="json") for decision in made]
                yield json.dumps(found, ensure_ascii=False).encode() + b"\n"

    def _latex(self) -> Iterator[bytes]:
        one = self.evaluation
        rate = getattr(one.verdicts, self.verdict)
        remarks = (
            f"{one.policy}@{one.version} on {one.suite}, {one.split}: {one.id}, {one.state}.",
            f"{self.verdict} in percent over {rate.episodes} episodes. {NOTE}",
        )
        name = f"{one.policy}@{one.version}"
        yield latex.of_evaluation(name, self._tasks(), self.verdict, remarks).encode()


# --- episodes of a filter ---


def pages_of(database: Database, **wanted: Any) -> Iterator[list[EpisodePublic]]:
    """The episodes that are wanted, page after page; no session stays open between them."""
    cursor = None
    while True:
        with database.reading() as session:
            page = episodes.listed(session, limit=MOST, cursor=cursor, **wanted)
        yield page.items
        if (cursor := page.next) is None:
            return


def of_episodes(database: Database, format: EpisodesFormat, **wanted: Any) -> Iterator[bytes]:
    """The episodes that are wanted, a line each."""
    pages = pages_of(database, **wanted)
    if format is EpisodesFormat.CSV:
        return _episodes_csv(pages)
    return (one.model_dump_json().encode() + b"\n" for page in pages for one in page)


def _episodes_csv(pages: Iterable[list[EpisodePublic]]) -> Iterator[bytes]:
    yield line_of(EPISODE_COLUMNS)
    for page in pages:
        for one in page:
            document = one.model_dump(mode="json")
            yield line_of(document[name] for name in EPISODE_COLUMNS)


# --- tables ---

Document = TypeVar("Document", bound=BaseModel)


def written(
    found: Document,
    format: TableFormat,
    as_csv: Callable[[Document], Iterator[bytes]],
    as_latex: Callable[[Document], str],
) -> Iterator[bytes]:
    """A document of the API as it is, or as it is written in a format."""
    if format is TableFormat.JSON:
        yield found.model_dump_json(indent=1).encode() + b"\n"
    elif format is TableFormat.CSV:
        yield from as_csv(found)
    else:
        yield as_latex(found).encode()


# --- files ---


def line_of(cells: Iterable[Any]) -> bytes:
    """A line of CSV; what a spreadsheet would take for a formula begins with an apostrophe."""
    text = io.StringIO()
    csv.writer(text).writerow([_cell(one) for one in cells])
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, dict | list):
        value = json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str) and value.startswith(FORMULAS):
        return f"'{value}"
    return value


class _Outlet(io.RawIOBase):
    """What a zip is written to: it only grows, and is emptied all the time."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def writable(self) -> bool:
        """It is."""
        return True

    def write(self, piece: Any) -> int:
        """Keeps what is written until it is taken."""
        self._pieces.append(bytes(piece))
        return len(piece)

    def taken(self) -> bytes:
        """What was written since the last time."""
        pieces, self._pieces = self._pieces, []
        return b"".join(pieces)


def zipped(files: dict[str, Iterator[bytes]]) -> Iterator[bytes]:
    """A zip of files that are made while it is read."""
    outlet = _Outlet()
    with zipfile.ZipFile(outlet, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, pieces in files.items():
            with archive.open(name, "w") as entry:
                for piece in pieces:
                    entry.write(piece)
                    if ready := outlet.taken():
                        yield ready
    yield outlet.taken()
