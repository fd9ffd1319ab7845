"""The track of what a policy counted under what was true: where they differ is hatched."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from server.schemas.episodes import BeliefCheck, BeliefsPublic
from web.lanes import Lane, Span

NAME = "stages done"
STATES = {True: "right", False: "wrong", None: "unknown"}


def lanes(beliefs: BeliefsPublic, moments: Sequence[float]) -> Iterator[Lane]:
    """Truth, and right under it the belief; none if the policy counts no stages.

    Args:
        moments: at which each decision was chosen, and the end; simulated seconds.
    """
    if not beliefs.stated:
        return
    true = [(one.decision, numbers(one.true), "") for one in beliefs.decisions]
    yield Lane("truth", NAME, list(_joined(true, moments)))
    held = [(one.decision, said(one), STATES[one.right]) for one in beliefs.decisions]
    yield Lane("count", NAME, list(_joined(held, moments)))


def numbers(true: Sequence[int]) -> str:
    """What may be true, e.g. '1-2'; a dash where nothing is known."""
    if not true:
        return "–"
    whole = len(true) > 1 and [*true] == [*range(true[0], true[-1] + 1)]
    return f"{true[0]}–{true[-1]}" if whole else " or ".join(map(str, true))


def said(one: BeliefCheck) -> str:
    """What was believed, with a sign if it is wrong."""
    return f"≠ {one.believed}" if one.right is False else str(one.believed)


def summary(beliefs: BeliefsPublic) -> str:
    """A sentence, with its n."""
    if not beliefs.checked:
        return "Nothing is known to compare its count with."
    told = f"Belief right at {beliefs.right} of {beliefs.checked} decisions"
    rest = beliefs.stated - beliefs.checked
    return f"{told}; off the experts' ways at {rest} more." if rest else f"{told}."


def _joined(found: Sequence[tuple[int, str, str]], moments: Sequence[float]) -> Iterator[Span]:
    """Neighbours that say the same become one span."""
    numbered = enumerate(found)
    for (_, value, state), run in groupby(
        numbered, key=lambda one: (one[1][0] - one[0], *one[1][1:])
    ):
        decisions = [one[0] for _, one in run]
        yield Span(value, moments[decisions[0]], moments[decisions[-1] + 1], state)
