"""What the paper says is better than what, and whether that is so here.

Each sentence is split into comparisons of two policies in one group of tasks. The p-values of a
sentence are corrected together, so that one that is wholly shown is shown at 5 %.

Source: Shi et al., sections Q1 to Q3: tables `tab:main_results` and `tab:memory_design`, figures
`fig:module_bar` and `fig:module_radar`, and the sentences about them.
"""

from itertools import pairwise
from typing import NamedTuple

from docs.results_computed import Computed, Figures, policy_of, with_holm

KINDS = ("RC", "HSR", "EPT")
ALL = ("overall", *KINDS)
LENGTHS = ("length_0", "length_2", "length_4", "seek")
SINGLE = ("scm", "wcm", "pam")
STEPS = ("none", "scm", "scm_wcm", "seek")
LEADS = {"scm": "RC", "pam": "HSR", "wcm": "EPT"}  # a single component, and where it leads
GAINS = {"scm": "RC", "scm_wcm": "EPT", "seek": "HSR"}  # a step, and where it gains the most
SHOWN = 0.05


class Said(NamedTuple):
    """A sentence of the paper."""

    text: str
    pairs: tuple[tuple[str, str, str], ...]  # the better cell, the other, the group


def _in(groups: tuple[str, ...], *pairs: tuple[str, str]) -> tuple[tuple[str, str, str], ...]:
    return tuple((better, other, group) for group in groups for better, other in pairs)


SENTENCES = (
    Said("SEEK is above its memory-free backbone, overall and in each category",
         _in(ALL, ("seek", "none"))),
    Said("Remembering visual features is above proprioception, overall and in each category",
         _in(ALL, ("seek", "proprioception"))),
    Said("Average success rises with memory's length: 0, 2, 4, 6",
         _in(("overall",), *((b, a) for a, b in pairwise(LENGTHS)))),
    Said("Length 6 is the best in each category",
         _in(KINDS, *(("seek", one) for one in LENGTHS[:-1]))),
    Said("Adding SCM, then WCM, then PAM raises each category at each step",
         _in(KINDS, *((b, a) for a, b in pairwise(STEPS)))),
    Said("Alone, SCM leads on RC, PAM on HSR, WCM on EPT",
         tuple((one, other, group) for one, group in LEADS.items()
               for other in SINGLE if other != one)),
    Said("All three together lead each category",
         _in(KINDS, *(("seek", one) for one in SINGLE))),
)  # fmt: skip


def orderings(computed: Computed) -> list[Figures]:
    """Every sentence with its comparisons; None stands for those that lack a run."""
    return [_ordering(computed, one) for one in SENTENCES]


def _ordering(computed: Computed, said: Said) -> Figures:
    found = []
    for better, other, group in said.pairs:
        policies = policy_of(better), policy_of(other)
        if all(policy in computed.played for policy in policies):
            measured = computed.difference(*policies, group)
            found.append({"better": better, "other": other, "group": group, **measured})
    with_holm(found)
    return {
        "text": said.text,
        "pairs": len(said.pairs),
        "measured": found,
        "as_published": sum(one["difference"] > 0 for one in found),
        "shown": sum(one["difference"] > 0 and one["p_holm"] <= SHOWN for one in found),
        "reversed": sum(one["difference"] < 0 and one["p_holm"] <= SHOWN for one in found),
    }


def gains(computed: Computed) -> list[Figures]:
    """What each step adds in each category, and where the paper says that it adds the most."""
    found = []
    for before, after in pairwise(STEPS):
        policies = policy_of(after), policy_of(before)
        if all(policy in computed.played for policy in policies):
            added = {kind: computed.difference(*policies, kind)["difference"] for kind in KINDS}
            most = max(added, key=lambda kind: added[kind])
            found.append({"step": after, "added": added, "most": most, "published": GAINS[after]})
    return found
