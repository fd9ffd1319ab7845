"""What of a score took memory: 0 is the most that is possible without, 1 is all.

Over the tasks whose certificate is strong and whose ceiling leaves room: their rate and the mean
of their ceilings, as (rate - ceiling) / (1 - ceiling). So a task counts by the room that it
leaves, and one whose ceiling is high does not blow up chance.
"""

from collections.abc import Mapping, Sequence
from statistics import fmean

from server.schemas.common import RatePublic, Verdict, Verdicts
from server.schemas.leaderboard import LeaderboardColumn, NormalisedPublic


def counting(columns: Sequence[LeaderboardColumn], verdict: Verdict) -> dict[str, float]:
    """The tasks that count, with their ceilings."""
    return {
        column.task: ceiling
        for column in columns
        if (proof := column.certificate) and proof.verdict == "strong"
        if (ceiling := getattr(proof, f"ceiling_{verdict}")) < 1
    }


def normalised(
    tasks: Mapping[str, Verdicts], ceilings: Mapping[str, float], verdict: Verdict
) -> NormalisedPublic | None:
    """The score over tasks of equally many episodes; None where none of them counts."""
    rates = [getattr(tasks[name], verdict) for name in ceilings if name in tasks]
    if not rates or len(rates) < len(ceilings):
        return None
    rate = RatePublic.of(sum(r.successes for r in rates), sum(r.episodes for r in rates))
    if rate.value is None:
        return None
    ceiling = fmean(ceilings.values())
    value, low, high = (
        (one - ceiling) / (1 - ceiling) for one in (rate.value, rate.low, rate.high)
    )
    return NormalisedPublic(
        value=value, low=low, high=high, tasks=list(ceilings), episodes=rate.episodes
    )
