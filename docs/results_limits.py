"""The sections of the results page about what limits a policy."""

from collections import Counter
from collections.abc import Iterable, Sequence

from docs.results_computed import SEEK, TWIN
from docs.results_documents import Documents
from docs.results_words import NONE, interval, markdown, percent
from hide_tasks.statistics import wilson

MOST_FAILURES = 3  # of a task
OF_KEYFRAMES = {
    "frames": "keyframes", "keyframe": "right as a whole", "position_near": "under 2 cm",
    "coarse_near": "coarse look under 2 cm", "own_count": "own count right",
    "own_keyframe": "right, own count", "stop": "stop right",
}  # fmt: skip


def keyframes(documents: Documents) -> str:
    if not documents.keyframes:
        return "Not measured yet: `docs/measure_keyframes.py` writes docs/study/keyframes.json."
    found = documents.keyframes
    rows = []
    for policy, values in found.items():
        of_all = values["overall"]
        cells = [of_all.get("frames"), *(percent(of_all.get(n)) for n in list(OF_KEYFRAMES)[1:])]
        rows.append([policy, *cells])
    head = ["%, split val", *OF_KEYFRAMES.values()]
    measure = (
        "keyframe" if any("keyframe" in v["overall"] for v in found.values()) else "position_near"
    )
    by_task = [
        [task, *(percent(v["tasks"].get(task, {}).get(measure)) for v in found.values())]
        for task in documents.results["tasks"]
    ]
    title = f"{OF_KEYFRAMES[measure]}, %"
    return (
        "The demonstration is followed, whatever the policy says; what is left is perception and "
        f"recall.\n\n{markdown(head, rows)}\n{markdown([title, *found], by_task)}"
    )


def oracles(documents: Documents) -> str:
    if not documents.oracles:
        return "Not measured yet: `docs/measure_oracles.py` writes docs/study/oracles.json."
    found = documents.oracles
    kinds = list(dict.fromkeys(kind for of in found.values() for kind in of))
    head = ["success, %", *(kind.replace("_", " ") for kind in kinds)]
    rows = [
        [policy, *(_of_pair(of.get(kind, {}).get("overall")) for kind in kinds)]
        for policy, of in found.items()
    ]
    parts = [markdown(head, rows)]
    for policy, of in found.items():
        by_task = [
            [task, *(_of_pair(of.get(kind, {}).get("tasks", {}).get(task)) for kind in kinds)]
            for task in documents.results["tasks"]
        ]
        parts.append(markdown([policy, *head[1:]], by_task))
    splits = {one["of"]["split"] for of in found.values() for one in of.values() if "of" in one}
    where = f" on split {' and '.join(sorted(splits))}" if splits else ""
    return (
        f"Played outside of the ledger{where}: as it is (own), with a counter that is right, with "
        "an anchor that is right. What it then still fails is not memory's fault.\n\n"
        + "\n".join(parts)
    )


def _of_pair(pair: Sequence[int] | None) -> str:
    if not pair or not pair[1]:
        return NONE
    good, count = pair
    return f"{percent(good / count)} {interval(wilson(good, count))}"


def beliefs(documents: Documents) -> str:
    rows = []
    for name, record in documents.results["runs"].items():
        if said := record["belief"]:
            right = f"{percent(said['value'])} {interval((said['low'], said['high']))}"
            rows.append([name, right, f"{said['right']} of {said['decisions']}", said["episodes"]])
    head = ["stages counted", "right, %", "decisions", "episodes"]
    return (
        "How often the number of stages that a policy holds to be done is the true one, where the "
        "truth is known; decisions of one episode are not taken for independent.\n\n"
        + markdown(head, rows or [[NONE] * 4])
    )


def failures(documents: Documents) -> str:
    rows = []
    for task in documents.results["tasks"]:
        rows.append([task, *(_most(documents, policy, task) for policy in (SEEK, TWIN))])
    tasks = documents.results["tasks"]
    ours, twin = (_failed(documents, policy, tasks) for policy in (SEEK, TWIN))
    kinds = [[name, ours[name], twin[name]] for name, _ in (ours + twin).most_common()]
    head = ["why an episode is not exact", "SEEK", "twin"]
    return "Episodes of all seeds together; by task the most frequent.\n\n" + "\n".join(
        markdown(head, found or [[NONE] * 3]) for found in (kinds, rows)
    )


def _failed(documents: Documents, policy: str, tasks: Iterable[str]) -> Counter[str]:
    """How many episodes of some tasks failed in which way, over a policy's seeds."""
    total: Counter[str] = Counter()
    for name, record in documents.results["runs"].items():
        if name.rpartition("-s")[0] == policy:
            for task in tasks:
                total.update(record["failures"].get(task, {}))
    return total


def _most(documents: Documents, policy: str, task: str) -> str:
    found = _failed(documents, policy, [task]).most_common(MOST_FAILURES)
    return ", ".join(f"{name} {count}" for name, count in found) or NONE
