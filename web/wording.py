"""How pages say things: numbers, dates, actions, failures. Everything here gives plain text."""

import datetime
from collections.abc import Mapping, Sequence

from hide_tasks.contract import Action, Category, Failure, Keyframe, MotionOutcome, Stop

THIN = "\N{NARROW NO-BREAK SPACE}"

ABOUT_SUITES = {
    "hide": "the paper's fifteen tasks",
    "hide-hard": "tasks of the paper whose pictures tell what is hidden, with that leak closed",
    "real4": "the paper's four real-robot tasks in simulation, seen by one camera",
}
CATEGORIES = {
    Category.REPETITION_COUNTING: "repetition counting",
    Category.HISTORICAL_STATE_RECALL: "historical-state recall",
    Category.EXECUTION_PROGRESS: "execution-progress tracking",
}

FAILURES = {
    Failure.UNDERCOUNT: "It stopped, or ran out of decisions, before the requested count.",
    Failure.OVERCOUNT: "It did one repetition too many, which cannot be undone.",
    Failure.WRONG_RECALL: "It acted on another place than the one it had seen before.",
    Failure.REPEATED_STEP: "It did again what had been done.",
    Failure.SKIPPED_STEP: "It left out a step, or came to it too early.",
    Failure.UNFINISHED: "Nothing was wrong so far, but not everything was done.",
    Failure.WRONG_OBJECT: "It handled a distractor.",
    Failure.DROPPED_OBJECT: "The object left the workspace or fell.",
    Failure.NOT_PLACED: "The object never reached its goal.",
    Failure.NOT_WITHDRAWN: "The arm stayed at the object.",
    Failure.UNREACHABLE_POSE: "The last pose it asked for has no joint configuration or no path.",
    Failure.POLICY_ERROR: "The policy raised an error, or its process died.",
    Failure.POLICY_INVALID: "The policy's answer was not an action.",
    Failure.POLICY_TIMEOUT: "The policy did not answer in time.",
}

VERDICTS = {
    "inexact": "not exact",
    "failed": "failed",
    "success": "success, not exact",
    "exact": "exact",
    "all": "all",
}

CHECKS = {  # of workers.preflight.Check, and what the page of an upload adds
    "hash": "SHA-256 of what came is the sender's",
    "conversion": "converted from a file of torch.save",
    "header": "header of the file: sizes, types, offsets",
    "load": "loaded in the sandbox: names, shapes, numbers",
    "decision": "asked for a decision",
    "repetition": "asked the same again",
}

WIRES = {  # of workers.remote.wires
    "openpi": "openpi (and ours)",
    "vla_eval": "vla-eval",
    "act": "POST /act (OpenVLA)",
    "gr00t": "GR00T",
}

OUTCOMES = {
    MotionOutcome.ARRIVED: "arrived",
    MotionOutcome.BLOCKED: "blocked on the way",
    MotionOutcome.OUT_OF_REACH: "out of reach, did not move",
    MotionOutcome.GOAL_IN_COLLISION: "goal in collision, did not move",
    MotionOutcome.NO_PATH: "no path, did not move",
    MotionOutcome.NONE: "no motion",
}


def percent(value: float | None) -> str:
    """A share as whole percent, or a dash without episodes."""
    return "–" if value is None else f"{100 * value:.0f}{THIN}%"


def number(value: float | None) -> str:
    """A share as a whole number of percent, for tables whose head says so."""
    return "–" if value is None else f"{100 * value:.0f}"


def signed(value: float) -> str:
    """A share as a whole number of percent that may be below 0."""
    return f"{round(100 * value)}".replace("-", "−")


def words(name: str) -> str:
    """A name of the code as words, e.g. 'policy error'."""
    return name.replace("_", " ")


def value(shown: object) -> str:
    """A hidden value as pages and recordings show it."""
    if isinstance(shown, bool):
        return "yes" if shown else "no"
    if shown is None or shown == []:
        return "–"
    if isinstance(shown, Sequence) and not isinstance(shown, str):
        return ", ".join(value(item) for item in shown)
    return f"{shown:g}" if isinstance(shown, float) else str(shown)


def pairs(values: Mapping[str, object]) -> str:
    """Named values in a line, e.g. 'count 3, color red'."""
    return ", ".join(f"{words(name)} {value(shown)}" for name, shown in values.items())


def moment(time: datetime.datetime) -> str:
    """A date and time in UTC."""
    return f"{time.astimezone(datetime.UTC):%d %b %Y, %H:%M}".lstrip("0")


def day(time: datetime.datetime) -> str:
    """A date in UTC."""
    return f"{time.astimezone(datetime.UTC):%d %b %Y}".lstrip("0")


def seconds(time: float) -> str:
    """Simulated seconds."""
    return f"{time:.2f}{THIN}s"


def duration(time: float) -> str:
    """Wall time, as coarse as one plans with it."""
    if time < 60:
        return f"{time:.0f}{THIN}s"
    minutes, rest = divmod(round(time), 60)
    if minutes < 10:
        return f"{minutes}{THIN}min {rest:02}{THIN}s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours}{THIN}h {minutes:02}{THIN}min" if hours else f"{minutes}{THIN}min"


def action(taken: Action) -> str:
    """An action in words: where to, with which fingers, and whether it ends the episode."""
    if isinstance(taken, Stop):
        return "stop"
    if isinstance(taken, Keyframe):
        place = ", ".join(f"{part:.3f}".replace("-", "−") for part in taken.position)
        fingers = "open" if taken.opening >= 0.5 else "closed"
        said = [f"go to ({place})", fingers]
        said += ["may touch"] * taken.ignore_collisions
    else:
        said = [f"{len(taken.chunk)} steps of {words(taken.kind)}"]
    return ", ".join(said + ["then stop"] * taken.stop)


def size(count: int) -> str:
    """A number of bytes, e.g. '48 MB'."""
    for unit, bytes_of in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= bytes_of:
            return f"{count / bytes_of:.3g}{THIN}{unit}"
    return f"{count}{THIN}bytes"


def ordinal(place: int) -> str:
    """A place in a queue, e.g. '2nd'."""
    ends = {1: "st", 2: "nd", 3: "rd"}
    return f"{place}{'th' if place % 100 in (11, 12, 13) else ends.get(place % 10, 'th')}"


def verdict(success: bool | None, exact: bool | None) -> str:
    """Both verdicts of a final episode in a word or two."""
    if exact:
        return "exact"
    return "success, not exact" if success else "failed"
