"""Templates, with the words and charts that every page may use."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import jinja2
from fastapi import Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup, escape

from hide_tasks.machine import installed
from seek_model import trained
from server.suites import without_version
from web import aliases, belief_track, charts, wording

HERE = Path(__file__).parent
STATIC = HERE / "static"

ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(HERE / "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)


def page(
    request: Request,
    template: str,
    shown: Mapping[str, Any],
    *,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> HTMLResponse:
    """A rendered page; a browser asks again for it each time, for its numbers change."""
    me = getattr(request.state, "principal", None)
    text = ENVIRONMENT.get_template(template).render(path=request.url.path, me=me, **shown)
    return HTMLResponse(text, status, {"Cache-Control": "no-cache", **(headers or {})})


def part(template: str, shown: Mapping[str, Any]) -> Markup:
    """A rendered part of a page, which is the same for everybody."""
    return Markup(ENVIRONMENT.get_template(template).render(**shown))


def asset(name: str) -> str:
    """The address of a file in `static/`, which changes with the file's content."""
    return f"/static/{name}?v={fingerprint(name)}"


@cache
def fingerprint(name: str) -> str:
    """A short hash of a file in `static/`."""
    return hashlib.sha256((STATIC / name).read_bytes()).hexdigest()[:12]


def query(**fields: object) -> str:
    """A query string of the fields that are set, with its question mark, or nothing; of several
    values, each with the field's name."""
    several = {name: v if isinstance(v, list | tuple) else [v] for name, v in fields.items()}
    said = urlencode(
        [(name, str(v)) for name, values in several.items() for v in values if v not in (None, "")]
    )
    return f"?{said}" if said else ""


def breakable(name: str) -> Markup:
    """A name with underscores that may wrap after each."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


@cache
def release() -> str:
    """The version of this package."""
    return installed("hide-seek") or "from a folder"


ENVIRONMENT.globals.update(
    asset=asset,
    query=query,
    release=release,
    rate_bar=charts.rate_bar,
    progress_bar=charts.progress_bar,
    budget_bar=charts.budget_bar,
    ABOUT_SUITES=wording.ABOUT_SUITES,
    CATEGORIES=wording.CATEGORIES,
    CHECKS=wording.CHECKS,
    FAILURES=wording.FAILURES,
    OUTCOMES=wording.OUTCOMES,
    TRAINED=trained.POLICIES,
    verdict_of=wording.verdict,
    explaining=aliases.explaining,
    belief_summary=belief_track.summary,
    counts=belief_track.numbers,
)
ENVIRONMENT.filters.update(
    percent=wording.percent,
    number=wording.number,
    signed=wording.signed,
    day=wording.day,
    words=wording.words,
    ordinal=wording.ordinal,
    value=wording.value,
    pairs=wording.pairs,
    moment=wording.moment,
    seconds=wording.seconds,
    duration=wording.duration,
    size=wording.size,
    action=wording.action,
    breakable=breakable,
    suite=without_version,
)
