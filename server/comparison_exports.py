"""Comparisons as files."""

from collections.abc import Iterator, Sequence
from typing import Any

from server import latex
from server.exports import NOTE, TableFormat, line_of, written
from server.schemas.common import RatePublic, Verdicts
from server.schemas.several import PairComparison, SeveralComparison


def of_comparison(found: SeveralComparison, format: TableFormat) -> Iterator[bytes]:
    """A comparison as a file."""
    return written(found, format, _csv, _latex)


def names(found: SeveralComparison) -> list[str]:
    """What the policies are called; with the evaluation where a name would stand twice."""
    told = [f"{one.policy}@{one.version}" for one in found.policies]
    twice = len(set(told)) < len(told)
    if not twice:
        return told
    return [f"{name} {one.evaluation}" for name, one in zip(told, found.policies, strict=True)]


def _csv(found: SeveralComparison) -> Iterator[bytes]:
    head = ["task", "category", "index"]
    for name in names(found):
        head += [f"{found.verdict} {name}", f"failure {name}", f"episode {name}"]
    yield line_of(head)
    for one in found.episodes:
        cells: list[Any] = [one.task, one.category.value, one.index]
        for told in zip(one.managed, one.failures, one.episodes, strict=True):
            cells += told
        yield line_of(cells)


def _latex(found: SeveralComparison) -> str:
    called = names(found)
    remarks = [f"{found.suite}, {found.split}, {found.verdict} in percent. {NOTE}"]
    remarks += [_remark(called, pair) for pair in found.overall.pairs]
    rows = [
        latex.row(name, latex.cells(_rates(found, place), found.verdict))
        for place, name in enumerate(called)
    ]
    return "".join(f"% {remark}\n" for remark in remarks) + "".join(rows)


def _rates(found: SeveralComparison, place: int) -> dict[str, Verdicts]:
    """What `latex` takes; it reads the comparison's verdict alone."""
    return {one.task: _both(one.rates, place) for one in found.tasks}


def _both(rates: Sequence[RatePublic], place: int) -> Verdicts:
    return Verdicts(success=rates[place], exact=rates[place])


def _remark(called: Sequence[str], pair: PairComparison) -> str:
    told = [f"{100 * value:+.1f}" for value in (pair.difference, pair.low, pair.high)]
    which = f"{called[pair.first]} less {called[pair.second]}"
    chances = f"p {_chance(pair.p)}, by Holm {_chance(pair.p_holm)}"
    alone = f"{pair.table.only_a} against {pair.table.only_b} episodes"
    return f"{which}: {told[0]} points [{told[1]}, {told[2]}], {chances}; {alone}."


def _chance(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"
