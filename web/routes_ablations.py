"""The ablations: the paper's table and figure, from this server's evaluations."""

from typing import Annotated, Any

from fastapi import Depends, Query, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup

from hide_tasks.contract import Split
from server import ablations
from server.ablation_rows import GROUPS, Size
from server.ablations import Asked, place_of
from server.access import Router, Scope, needs
from server.deps import Reading
from server.schemas.ablations import AblationBlock, AblationRow
from server.schemas.common import Verdict
from web.grouped_bars import Bar, grouped
from web.length_curve import Point, curve
from web.templating import page, query

router = Router(include_in_schema=False)

SPLITS: tuple[Split, ...] = ("test", "test100", "val", "train")
SIZES: tuple[Size, ...] = ("small", "paper")
SHORT = {"none": "none", "scm": "SCM", "wcm": "WCM", "pam": "PAM", "seek": "all"}
ADDED = {"none": "none", "scm": "SCM", "scm_wcm": "+WCM", "seek": "+PAM"}


def _asked(
    split: Annotated[Split, Query()] = "test",
    verdict: Annotated[Verdict, Query()] = "success",
    size: Annotated[Size, Query()] = "small",
    clock: Annotated[bool, Query()] = False,
) -> Asked:
    return Asked(split, verdict, size, clock)


@router.get("/ablations")
@needs(Scope.READ)
def show_ablations(
    request: Request, session: Reading, asked: Annotated[Asked, Depends(_asked)]
) -> HTMLResponse:
    """Memory's content, length and components, measured and published."""
    found = ablations.ablations(session, asked)
    blocks = {block.name: block for block in found.blocks}
    shown = {
        "found": found,
        "asked": asked,
        "blocks": blocks,
        "address": lambda **changed: _address(asked, "/ablations", **changed),
        "export": lambda format: _address(asked, "/api/v1/ablations/export", format=format),
        "splits": SPLITS,
        "places": [(size, clock, found.places.get(place_of(size, clock), 0))
                   for size in SIZES for clock in (False, True)],
        "labels": {block.name: _labels(block) for block in found.blocks},
        "curves": _curves(blocks["length"]),
        "progressive": _bars(blocks["progressive"], ADDED),
        "single": _bars(blocks["single"], SHORT),
        "together": _together,
    }  # fmt: skip
    return page(request, "ablations.html", shown)


def _labels(block: AblationBlock) -> dict[str, str]:
    """What the lines of a block are called outside their table."""
    before = "length " if block.name == "length" else ""
    return {row.key: f"{before}{row.label}" for row in block.rows}


def _address(asked: Asked, path: str, **changed: Any) -> str:
    fields = asked._asdict() | changed
    default = Asked()._asdict()
    given = {name: value for name, value in fields.items() if value != default.get(name)}
    return path + query(**{name: str(value).lower() for name, value in given.items()})


def _together(block: AblationBlock) -> str:
    """Where the versions of a block are compared, one of each line, six at most."""
    newest = [row.versions[-1].evaluation for row in block.rows if row.versions]
    return f"/comparisons{query(policy=newest[:6])}" if len(newest) > 1 else ""


def _curves(block: AblationBlock) -> list[tuple[str, Markup]]:
    return [(group, curve([_point(row, group) for row in block.rows], group, f"Success, {group}"))
            for group in GROUPS]  # fmt: skip


def _point(row: AblationRow, group: str) -> Point:
    return Point(int(row.label), row.rates[group] if row.rates else None, _published(row, group))


def _published(row: AblationRow, group: str) -> float | None:
    return row.published[group] / 100 if row.published else None


def _bars(block: AblationBlock, names: dict[str, str]) -> list[tuple[str, Markup]]:
    return [(group, grouped([_bar(row, names, group) for row in block.rows], group, group))
            for group in GROUPS]  # fmt: skip


def _bar(row: AblationRow, names: dict[str, str], group: str) -> Bar:
    rate = row.rates[group] if row.rates else None
    return Bar(names[row.key], row.label, rate, _published(row, group))
