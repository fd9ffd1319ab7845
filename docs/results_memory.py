"""The sections of the results page about memory: ablations, the clock, the paper's order."""

from docs.results_computed import LAID_OUT, policy_of
from docs.results_documents import Documents
from docs.results_words import ELSEWHERE, NAMES, NONE, Figures, chance, difference, markdown, short
from server.ablation_rows import GROUPS


def ablations(documents: Documents) -> str:
    parts = [
        "One seed each, but for SEEK and its twin (none). In brackets the difference from SEEK in "
        "points and its p-value, Holm's correction over the ablations of the column. *The paper's "
        f"figures, below each line, are of {ELSEWHERE}.*"
    ]
    for block in LAID_OUT:
        rows = []
        for line in block.rows:
            policy = policy_of(line.key)
            tests = documents.results["success"]["ablated"].get(policy, {})
            rates = documents.rates(policy)
            rows.append([line.label, *(_cell(rates.get(g), tests.get(g)) for g in GROUPS)])
            if line.published:
                rows.append(["*paper*", *(f"*{line.published[g]:.1f}*" for g in GROUPS)])
        head = [f"{block.title}; success, %", "overall", "RC", "HSR", "EPT"]
        parts.append(markdown(head, rows))
    return "\n\n".join(parts)


def _cell(one: Figures | None, test: Figures | None) -> str:
    if not one or not test:
        return short(one)
    return f"{short(one)} ({100 * test['difference']:+.1f}, p {chance(test['p_holm'])})"


def clock(documents: Documents) -> str:
    clocked = documents.results["success"]["clocked"]
    rows = []
    for policy, base in clocked["against"].items():
        tests = clocked["differences"].get(policy, {})
        label = f"{NAMES[base]} with the clock"
        rows.append([label, *(short(documents.rates(policy).get(group)) for group in GROUPS)])
        rows.append(["minus without", *(_tested(tests.get(group)) for group in GROUPS)])
    head = ["success, %", "overall", "RC", "HSR", "EPT"]
    return (
        "The published codebases tell every policy how many decisions it has made, which is a "
        "counter in disguise; here that is a row of its own.\n\n" + markdown(head, rows)
    )


def _tested(test: Figures | None) -> str:
    return f"{difference(test)}, p {chance(test['p'])}" if test else NONE


def orderings(documents: Documents) -> str:
    rows = []
    for one in documents.results["success"]["orderings"]:
        there = len(one["measured"])
        verdict = _verdict(one) if there == one["pairs"] else f"{there} of {one['pairs']} measured"
        rows.append([one["text"], one["pairs"], one["as_published"] if there else NONE,
                     one["shown"] if there else NONE, one["reversed"] if there else NONE,
                     verdict])  # fmt: skip
    head = ["the paper says", "comparisons", "so here", "shown", "opposite shown", ""]
    said = markdown(head, rows)
    gained = [
        [one["step"], *(f"{100 * one['added'][kind]:+.1f}" for kind in GROUPS[1:]), one["most"],
         f"*{one['published']}*"]
        for one in documents.results["success"]["gains"]
    ]  # fmt: skip
    head = ["points that a step adds", "RC", "HSR", "EPT", "most", "*paper: most*"]
    return (
        "A sentence holds if all of its comparisons are so here; one is shown if its p-value, with "
        f"Holm's correction over the sentence, is at most 0.05.\n\n{said}\n"
        + (markdown(head, gained) if gained else "")
    )


def _verdict(one: Figures) -> str:
    if one["as_published"] < one["pairs"]:
        return "contradicted" if one["reversed"] else "not in all; may be chance"
    return "holds, shown" if one["shown"] == one["pairs"] else "holds, not shown in all"
