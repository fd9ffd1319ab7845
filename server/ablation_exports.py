"""The ablations as files."""

from collections.abc import Iterator
from typing import Any

from server.ablation_rows import GROUPS
from server.exports import NOTE, TableFormat, line_of, written
from server.latex import NONE, escaped
from server.schemas.ablations import AblationBlock, AblationRow, Ablations

FIGURES = ("value", "low", "high")


def of_ablations(found: Ablations, format: TableFormat) -> Iterator[bytes]:
    """The ablations as a file."""
    return written(found, format, _csv, _latex)


def _csv(found: Ablations) -> Iterator[bytes]:
    head = ["block", "variant", "key", "preset", "versions", "evaluations"]
    for group in GROUPS:
        head += [f"{group}_{figure}" for figure in (*FIGURES, "episodes", "published")]
    yield line_of([*head, "against", "difference", "low", "high", "p", "p_holm"])
    for block in found.blocks:
        for row in block.rows:
            yield line_of([block.name, *_line(row)])


def _line(row: AblationRow) -> Iterator[Any]:
    yield from (row.label, row.key, row.preset, len(row.versions))
    yield " ".join(one.evaluation for one in row.versions)
    for group in GROUPS:
        rate = row.rates and row.rates[group]
        yield from (getattr(rate, name) if rate else None for name in (*FIGURES, "episodes"))
        yield row.published and row.published[group]
    yield row.against
    test = row.tests and row.tests["overall"]
    names = ("difference", "low", "high", "p", "p_holm")
    yield from (getattr(test, name) if test else None for name in names)


def _latex(found: Ablations) -> str:
    about = f"{found.suite}, {found.split}, {found.verdict} in percent, size {found.size}"
    lines = [f"% {about}{', with the clock' if found.clock else ''}. {NOTE}"]
    lines += ["% Variant & Avg. & RC & HSR & EPT; in comments: n, the paper's figures."]
    for block in found.blocks:
        lines += ["\\midrule", *_rows(block)]
    return "\n".join(lines) + "\n"


def _rows(block: AblationBlock) -> Iterator[str]:
    title = f"\\multirow{{{len(block.rows)}}}{{*}}{{{escaped(block.title)}}}"
    for place, row in enumerate(block.rows):
        cells = [f"{100 * row.rates[name].value:.1f}" if row.rates else NONE for name in GROUPS]
        line = " & ".join([title if place == 0 else "", escaped(row.label), *cells])
        yield f"{line} \\\\{_remark(row)}"


def _remark(row: AblationRow) -> str:
    said = []
    if row.rates:
        rate = row.rates["overall"]
        said.append(f"n {rate.episodes}, versions {rate.versions}")
    if row.published:
        said.append("paper " + " / ".join(f"{row.published[name]:.1f}" for name in GROUPS))
    return f" % {'; '.join(said)}" if said else ""
