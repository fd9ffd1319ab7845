"""Small charts as SVG, made on the server. Colours and strokes come from the style sheet."""

from markupsafe import Markup, escape

from server.schemas.common import RatePublic, Verdicts
from server.schemas.episodes import EpisodePublic, PartingPublic
from server.schemas.evaluations import Progress


def element(name: str, *children: str | Markup, **attributes: object) -> Markup:
    """One element, everything escaped; `class_` is class, `aria_label` is aria-label."""
    named = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(_text(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = "".join(str(escape(child)) for child in children)
    return Markup(f"<{name}{named}>{inside}</{name}>")  # Markup.format takes twenty times as long


def rate_bar(rate: RatePublic, ceiling: float | None = None) -> Markup:
    """A rate as a bar with its interval as a whisker, and a tick at the best without memory."""
    marks = [element("rect", class_="track", width="100%", height="100%")]
    if rate.value is not None:
        marks += [
            element("rect", class_="bar", width=_share(rate.value), height="100%"),
            element("line", class_="whisker", **_along(rate.low, rate.high, 4)),
        ]
    if ceiling is not None:
        at = _share(min(max(ceiling, 0.005), 0.995))
        marks.append(element("line", class_="ceiling", x1=at, x2=at, y1=-2, y2=10))
    return element("svg", *marks, class_="rate-bar", height=8, aria_hidden="true")


def progress_bar(progress: Progress, verdicts: Verdicts) -> Markup:
    """How far an evaluation is: exact, success alone, failed, running, in one bar."""
    exact, success = verdicts.exact.successes, verdicts.success.successes
    parts = {
        "exact": exact,
        "success": success - exact,
        "failed": verdicts.success.episodes - success,
        "running": progress.running,
    }
    marks, at = [element("rect", class_="track", width="100%", height="100%")], 0
    for name, episodes in parts.items():
        place = {"x": _share(at / (progress.expected or 1))}
        width = _share(episodes / (progress.expected or 1))
        marks.append(element("rect", class_=name, width=width, height="100%", **place))
        at += episodes
    label = f"{progress.final} of {progress.expected} episodes"
    return element("svg", *marks, class_="progress-bar", height=10, role="img", aria_label=label)


def _along(low: float, high: float, y: float) -> dict[str, object]:
    return {"x1": _share(low), "x2": _share(high), "y1": y, "y2": y}


def _share(value: float) -> str:
    return f"{100 * value:.2f}".rstrip("0").rstrip(".") + "%"


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def budget_bar(episode: EpisodePublic, parts: PartingPublic | None) -> Markup:
    """Decisions used of the budget, and a tick where the episode parts from another run."""
    marks = [element("rect", class_="track", width="100%", height="100%")]
    used = min((episode.decisions or 0) / episode.budget, 1.0)
    marks.append(element("rect", class_="bar", width=_share(used), height="100%"))
    if parts and parts.decision is not None:
        at = _share(min(parts.decision / episode.budget, 1.0))
        marks.append(element("line", class_="parts", x1=at, x2=at, y1=-2, y2=8))
    return element("svg", *marks, class_="budget-bar", height=6, aria_hidden="true")
