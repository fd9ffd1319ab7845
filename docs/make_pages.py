"""Writes the pages of docs/tasks from the tasks themselves and what is committed of them.

Run it with: .venv/bin/python docs/make_pages.py
"""

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from hide_tasks import ALL_TASKS, SUITES, load, suite
from hide_tasks.catalogue import suite_of
from hide_tasks.certificates import committed
from hide_tasks.contract import CONTROL_HZ, Category, Failure, Value
from web.wording import ABOUT_SUITES, CATEGORIES, FAILURES

FOLDER = Path(__file__).parent / "tasks"
PICTURES = "../../web/static/tasks"
# The paper's mean frames and mean keyframes of a demonstration (its table of task statistics), of
# the tasks that are its own.
PAPER = {
    "push_button_times": (144.3, 7.8),
    "stack_blocks": (372.8, 16.1),
    "change_channel_times": (244.5, 12.2),
    "stack_cups_new": (208.8, 8.4),
    "stack_blocks_new": (283.5, 11.8),
    "weighing_on_off": (199.0, 11.0),
    "pour_put_back": (330.0, 7.5),
    "reopen_drawer": (320.2, 10.0),
    "wipe_desk_rubbish": (272.9, 9.0),
    "light_bulb_in_out": (335.9, 10.8),
    "search_drawer": (393.8, 15.7),
    "search_boxes": (629.1, 19.0),
    "search_cup_from_cabinet": (245.5, 9.9),
    "lift_and_check": (277.3, 14.3),
    "swap_square_pegs": (321.3, 18.0),
}
EVERYWHERE = (
    Failure.UNREACHABLE_POSE,
    Failure.POLICY_ERROR,
    Failure.POLICY_INVALID,
    Failure.POLICY_TIMEOUT,
)


def pages() -> dict[str, str]:
    """The text of every page by the name of its file."""
    return {"README.md": index(), **{f"{name}.md": page(name) for name in ALL_TASKS}}


# --- one page a task ----------------------------------------------------------------------------


def page(name: str) -> str:
    """All that the suite knows of a task."""
    task = load(name)
    parts = [
        f"# {name}",
        f"*{CATEGORIES[task.category]} ({task.category}); suite {suite_of(name)}*",
        f"![The start of an episode]({PICTURES}/{name}.webp)",
        (sys.modules[task.__module__].__doc__ or "").strip(),
        "## Language\n\n" + bullets(f"“{text}”" for text in task.instructions),
        "## Variations\n\n" + variations(name),
        "## Hidden state\n\n" + hidden(name),
        "## Certificate\n\n" + certificate(name),
        "## Alias pairs\n\n" + aliases(name),
        "## Expert\n\n" + expert(name),
        "## Failures\n\n" + failures(name),
    ]
    return "\n\n".join(parts) + "\n"


def variations(name: str) -> str:
    """The axes and their values."""
    task = load(name)
    count = len(task.variations)
    papers = ", as in the paper" if name in PAPER else ""
    said = f"{count} variation{'s' * (count != 1)}{papers}."
    if task.variations.axes:
        said += "\n\n" + bullets(axes(task.variations.axes))
    if task.histories.axes:
        said += "\n\nBeside it an episode draws its history:\n\n" + bullets(
            axes(task.histories.axes)
        )
    return said


def axes(found: Mapping[str, Sequence[Value]]) -> Iterable[str]:
    """One line an axis."""
    return (
        f"`{axis}`: {', '.join(str(value).replace('_', ' ') for value in values)}"
        for axis, values in found.items()
    )


def hidden(name: str) -> str:
    """What is to be remembered, and which axes the instruction does not name."""
    task = load(name)
    said = f"To remember: {task.remembers}."
    if task.hidden_axes():
        drawn = ", ".join(f"`{axis}`" for axis in task.hidden_axes())
        said += f" Neither the instruction nor the picture at a decision tells {drawn}."
    return said


def certificate(name: str) -> str:
    """The verdict, the ceilings, what was measured."""
    proof = committed(name)
    if not proof:
        return "This task has no certificate yet."
    measured = {"amnesiac": proof["amnesiac"], **proof["adversaries"]}
    rows = [["computed ceiling", *(percent(proof["ceilings"][v]) for v in ("success", "exact"))]]
    rows += [
        [f"`{who}` played", *(interval(found[v]) for v in ("success", "exact"))]
        for who, found in measured.items()
    ]
    return "\n\n".join(
        [
            f"**{proof['verdict'].capitalize()}.** {proof['reason']}",
            table(["without memory", "success", "exact"], rows),
            probe(proof["probe"]),
        ]
    )


def probe(found: Mapping[str, Any]) -> str:
    """What the classifiers reached at the alias points."""
    if not found["samples"]:
        return "There is nothing that a classifier could be asked to tell apart."
    said = ", ".join(
        f"{kind} {percent(found[kind]['accuracy'])} "
        f"[{percent(found[kind]['low'])}, {percent(found[kind]['high'])}]"
        for kind in ("nearest", "linear")
    )
    return (
        f"Probe, the next stage from the picture at {found['samples']} alias points: {said}; "
        f"chance {percent(found['chance'])}."
    )


def aliases(name: str) -> str:
    """The declared pairs with their distances, and a picture of either side."""
    found = committed(name).get("aliases", [])
    if not found:
        return "None: no two moments that call for different actions look the same."
    rows = []
    for number, alias in enumerate(found, start=1):
        sides = [f"![]({PICTURES}/{name}-alias-{number}-{side}.webp)" for side in "ab"]
        cells = [
            f"{picture}<br>{pairs(state)}<br>next: **{one['stage']}**"
            for picture, state, one in zip(sides, alias["hidden"], alias["next"], strict=True)
        ]
        differ = ", ".join(f"{100 * alias['pixels'][view]:.2g} %" for view in alias["pixels"])
        rows.append([*cells, f"{alias['why']}; pixels that differ: {differ}"])
    views = ", ".join(view.replace("_", " ") for view in found[0]["pixels"])
    note = f"Pixels that differ visibly, at most, over {found[0]['episodes']} layouts: {views}."
    return table(["one history", "another", "why"], rows) + "\n\n" + note


def expert(name: str) -> str:
    """How often, how long, how many keyframes."""
    splits = suite.committed(name).get("splits")
    if not splits:
        return "Its episodes have not been gated yet."
    frames, keyframes = lengths(name)
    episodes = ", ".join(f"{len(found['draws'])} {split}" for split, found in splits.items())
    counts = sorted(load(name).keyframes)
    return (
        f"Exact in all of its {episodes} episodes. Keyframes: {', '.join(map(str, counts))}, on "
        f"average {keyframes:.1f}{beside(name, 1)}; frames at {CONTROL_HZ} Hz on average "
        f"{frames:.0f}{beside(name, 0, ', in another simulator')}. Budget of a policy: "
        f"{load(name).budget()} decisions."
    )


def beside(name: str, which: int, more: str = "") -> str:
    """The paper's figure of a task in brackets, if the task is its own: frames, keyframes."""
    return f" (the paper's {PAPER[name][which]:.{which}f}{more})" if name in PAPER else ""


def failures(name: str) -> str:
    """How each comes about here."""
    rows = [
        [f"`{failure}`", how, "ends the episode" if failure in load(name).spoils else ""]
        for failure, how in load(name).failures.items()
    ]
    return table(["", "how it comes about here", ""], rows)


# --- the index ----------------------------------------------------------------------------------


def index() -> str:
    """All tasks in tables, suite by suite."""
    parts = ["# The tasks"]
    for one in SUITES:
        parts += [
            f"## Suite {one}: {ABOUT_SUITES[one]}",
            f"![Start, middle and end of an episode of every task](../pictures/{sheet(one)})",
            "*Start, middle and end of an expert's episode.*",
            overview(one),
            sizes(one),
        ]
    parts += [
        "## What can go wrong where\n\n" + failure_table(),
        "In every task also:\n\n"
        + bullets(f"`{failure}`: {FAILURES[failure]}" for failure in EVERYWHERE),
        "An episode whose budget runs out is named after what is missing then, and says so.",
    ]
    return "\n\n".join(parts) + "\n"


def sheet(of: str) -> str:
    """The name of the picture of a suite's tasks."""
    return "tasks.png" if of == suite.SUITE else f"tasks-{of}.png"


def by_category(of: Iterable[str]) -> list[str]:
    """Tasks, category by category."""
    return sorted(of, key=lambda name: (list(Category).index(load(name).category), name))


def overview(of: str) -> str:
    """Category, hidden state, verdict and ceilings of a suite's tasks."""
    rows = []
    for name in by_category(SUITES[of]):
        task, proof = load(name), committed(name)
        ceilings = [percent(proof["ceilings"][v]) if proof else "" for v in ("success", "exact")]
        verdict = proof.get("verdict", "not certified")
        rows.append(
            [f"[{name}]({name}.md)", str(task.category), task.remembers, verdict, *ceilings]
        )
    heads = ["task", "", "to remember", "certificate", "ceiling, success", "exact"]
    return table(heads, rows)


def sizes(of: str) -> str:
    """Variations, keyframes, frames of a suite's tasks."""
    rows = []
    for name in by_category(SUITES[of]):
        ours = lengths(name) if suite.committed(name) else None
        frames, keyframes = (f"{value:.1f}" for value in ours) if ours else ("", "")
        papers = [f" ({value})" for value in PAPER.get(name, ())] or ["", ""]
        rows.append(
            [name, str(len(load(name).variations)), keyframes + papers[1], frames + papers[0]]
        )
    papers_too = "; in brackets the paper's, from another simulator" if of == suite.SUITE else ""
    episodes = sum(suite.SPLITS.values())
    head = f"Means of the expert's {episodes} episodes{papers_too}:\n\n"
    return head + table(["task", "variations", "keyframes", "frames"], rows)


def failure_table() -> str:
    """Which failure can occur in which task."""
    names = [f for f in Failure if any(f in load(name).failures for name in ALL_TASKS)]
    rows = [
        [f"[{name}]({name}.md)", *("✓" if f in load(name).failures else "" for f in names)]
        for name in by_category(ALL_TASKS)
    ]
    return table(["", *(f"`{f}`" for f in names)], rows)


def lengths(name: str) -> tuple[float, float]:
    """Mean frames and mean keyframes of the expert's gated episodes."""
    splits = suite.committed(name)["splits"].values()
    seconds = [value for split in splits for value in split["seconds"]]
    keyframes = [value for split in splits for value in split["keyframes"]]
    return CONTROL_HZ * mean(seconds), mean(keyframes)


# --- markdown -----------------------------------------------------------------------------------


def bullets(lines: Iterable[str]) -> str:
    """A list."""
    return "\n".join(f"- {line}" for line in lines)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(share: float) -> str:
    """A share with a decimal."""
    return f"{100 * share:.1f} %"


def interval(found: Mapping[str, float]) -> str:
    """A rate with its interval."""
    return f"{percent(found['rate'])} [{percent(found['low'])}, {percent(found['high'])}]"


def pairs(values: Mapping[str, Any]) -> str:
    """Named values in a line."""

    def shown(value: Any) -> str:
        if isinstance(value, list):
            return ", ".join(map(str, value)) or "none"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return str(value)

    return ", ".join(f"{name.replace('_', ' ')}: {shown(value)}" for name, value in values.items())


def main() -> None:
    """Write every page, and remove those of tasks that are no more."""
    FOLDER.mkdir(exist_ok=True)
    found = pages()
    for old in FOLDER.glob("*.md"):
        if old.name not in found:
            old.unlink()
    for name, text in found.items():
        (FOLDER / name).write_text(text)


if __name__ == "__main__":
    main()
