"""The results as Markdown: a page, and the README's table; no number is from anywhere but files."""

from docs import results_limits, results_memory, results_trainings
from docs.results_computed import SEEK, TWIN
from docs.results_documents import Documents, ceilings, counted, single
from docs.results_words import (
    ELSEWHERE,
    NAMES,
    NONE,
    chance,
    difference,
    interval,
    markdown,
    percent,
    rate,
)
from seek_model.study import FULL, Study
from server.ablation_rows import GROUPS
from server.published import SIMULATOR, published
from server.schemas.leaderboard import PublishedRow


def paper(method: str) -> PublishedRow:
    """The paper's line of a method."""
    [found] = [one for one in published().rows if one.method == method]
    return found


# --- the README's table ---


def table(documents: Documents) -> str:
    """SEEK, its twin and what they are held against, in a few lines."""
    results = documents.results
    count = results["episodes"] * len(results["tasks"])
    head = [f"success, % of {count} test episodes", "overall", "RC", "HSR", "EPT", "exact"]
    rows = [_line(documents, policy) for policy in (SEEK, TWIN)]
    against, exact = (results[v]["against_twin"] or {} for v in ("success", "exact"))
    cells = [difference(against.get(group)) for group in GROUPS]
    rows.append(["difference, points", *cells, difference(exact.get("overall"))])
    best, best_exact = (ceilings(results, verdict) for verdict in ("success", "exact"))
    cells = [percent(best[group]) for group in GROUPS]
    rows.append(["the most without memory (computed)", *cells, percent(best_exact["overall"])])
    for method in ("SEEK", "SAM2Act"):
        rows.append([f"*the paper's {method}, {SIMULATOR}*", *_printed(paper(method)), NONE])
    return markdown(head, rows)


def _printed(one: PublishedRow) -> list[str]:
    """Overall and the categories."""
    return [f"*{n:.1f}*" for n in (one.overall, *(one.categories[kind] for kind in GROUPS[1:]))]


def _line(documents: Documents, policy: str) -> list[str]:
    rates, exact = documents.rates(policy), documents.rates(policy, "exact")
    seeds = rates["overall"]["seeds"] if rates else 0
    mean = f", mean of {seeds} seeds" if seeds > 1 else ""
    return [
        f"{NAMES[policy]}{mean}",
        *(rate(rates.get(group)) for group in GROUPS),
        rate(exact.get("overall")),
    ]


# --- the page ---


def page(documents: Documents, study: Study, beside: str = "") -> str:
    """Everything; `beside` leads from the page to the folder of numbers."""
    parts = [
        "# Results",
        _introduction(documents, study, beside),
        _missing(documents, study),
        "## SEEK and its memory-free twin\n\n" + table(documents),
        _exact(documents) + "\n" + _intervals(),
        "### By task\n\n" + _tasks(documents),
        "### By seed\n\n" + _seeds(documents, study),
        "## Ablations\n\n" + results_memory.ablations(documents),
        "### The logical clock\n\n" + results_memory.clock(documents),
        "### What the paper says is better\n\n" + results_memory.orderings(documents),
        "## What limits it\n\n### Keyframes\n\n" + results_limits.keyframes(documents),
        "### Told what it should remember\n\n" + results_limits.oracles(documents),
        "### What it believes\n\n" + results_limits.beliefs(documents),
        "### Failures\n\n" + results_limits.failures(documents),
        "## Trainings\n\n" + results_trainings.curves(documents, study, beside),
        "### What it costs\n\n" + results_trainings.cost(documents, study),
        "## The paper's figures\n\n" + _paper(),
        "## Where the numbers come from\n\n"
        + results_trainings.provenance(documents, study, beside),
    ]
    return "\n\n".join(part.strip() for part in parts if part) + "\n"


def _introduction(documents: Documents, study: Study, beside: str) -> str:
    results = documents.results
    tiny = "" if study is FULL else (
        f"**This is the study `{study.name}`, which only shows that the chain works: its policies "
        "have hardly been trained.**\n\n"
    )  # fmt: skip
    return (
        f"{tiny}Measured on {len(results['tasks'])} tasks of {results['suite']}, split "
        f"`{results['split']}`, {results['episodes']} episodes each, by the evaluation server. "
        "`make reproduce` repeats it. This page, the README's table and the plot are written by "
        f"`docs/make_results.py` from [results.json]({beside}results.json), which has every number."
    )


def _missing(documents: Documents, study: Study) -> str:
    lacking = [run.name for run in study.measured if run.name not in documents.results["runs"]]
    lacking += [] if documents.results["first"] else ["first"]
    if not lacking:
        return ""
    flags = " --publish" if study is FULL else f" --{study.name}"
    return (
        f"**Missing ({NONE} in the tables):** {', '.join(lacking)}. "
        f"`.venv/bin/python -m docs.reproduce{flags}` does what is missing; "
        "with `--only RUN,…` some of it."
    )


def _exact(documents: Documents) -> str:
    """The table's other verdict."""
    against = documents.results["exact"]["against_twin"] or {}
    best = ceilings(documents.results, "exact")
    rows = [
        [NAMES[policy], *(rate(documents.rates(policy, "exact").get(g)) for g in GROUPS)]
        for policy in (SEEK, TWIN)
    ]
    rows.append(["difference, points", *(difference(against.get(group)) for group in GROUPS)])
    rows.append(["the most without memory", *(percent(best[group]) for group in GROUPS)])
    return markdown(["exact, %", "overall", "RC", "HSR", "EPT"], rows)


def _intervals() -> str:
    return (
        "In brackets: 95 %. Overall: other seeds and other episodes of these tasks, drawn again "
        "10,000 times (three seeds say little of other seeds). Elsewhere: Wilson's interval of as "
        "many episodes as a seed plays, for differences Newcombe's of paired rates."
    )


def _tasks(documents: Documents) -> str:
    parts = []
    for verdict in ("success", "exact"):
        results = documents.results
        best, against = ceilings(results, verdict), results[verdict]["against_twin"] or {}
        ours, twin = (documents.rates(policy, verdict) for policy in (SEEK, TWIN))
        head = [f"{verdict}, %", "SEEK", "twin", "difference", "p (Holm)", "ceiling"]
        said = verdict == "success"
        head += ["*paper: SEEK*", "*SAM2Act*"] if said else []
        rows = []
        for task, about in results["tasks"].items():
            test = against.get(task)
            row = [f"{task} ({about['category']})", rate(ours.get(task)), rate(twin.get(task))]
            row += [difference(test), chance(test and test["p_holm"]), percent(best[task])]
            there = [f"*{paper(m).tasks[task]:.0f}*" for m in ("SEEK", "SAM2Act")] if said else []
            rows.append([*row, *there])
        parts.append(markdown(head, rows))
    return (
        "The ceiling is the most that a perfect policy without memory reaches, computed. p: signs "
        "of the episodes' differences flipped (of single runs McNemar's test), mid-p, Holm's "
        f"correction over the tasks. *The paper's figures are of {ELSEWHERE}.*\n\n"
        + "\n".join(parts)
    )


def _seeds(documents: Documents, study: Study) -> str:
    names = [run.name for run in study.measured if run.policy in (SEEK, TWIN)]
    names += documents.results["references"]
    parts = []
    for verdict in ("success", "exact"):
        rows = []
        for name in names:
            count = counted(documents, name, verdict, "overall")[1] or NONE
            rows.append([name, *(single(documents, name, verdict, g) for g in GROUPS), count])
        parts.append(markdown([f"{verdict}, %", "overall", "RC", "HSR", "EPT", "n"], rows))
    parts.append("The same episodes, success, seed by seed:\n")
    tested = []
    for one in documents.results["success"]["seed_by_seed"]:
        t = one["table"]
        split = f"{t['both']} / {t['only_a']} / {t['only_b']} / {t['neither']}"
        row = [f"{one['a']} − {one['b']}", split, difference(one), chance(one["p"])]
        tested.append([*row, interval(one["over_episodes"]), interval(one["over_tasks"])])
    head = ["runs", "both / first / second / neither", "points", "McNemar's p",
            "other episodes", "other tasks"]  # fmt: skip
    return "\n".join([*parts, markdown(head, tested or [[NONE] * len(head)])])


def _paper() -> str:
    rows = [[f"*{one.method}*", *_printed(one)] for one in published().rows]
    head = ["success, %, as printed", "overall", "RC", "HSR", "EPT"]
    return f"From {ELSEWHERE}.\n\n{markdown(head, rows)}"
