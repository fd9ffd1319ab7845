"""Ranks, and the ranks that chance leaves open."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from server import statistics
from server.outcomes import Outcomes
from server.schemas.common import Verdict
from server.schemas.leaderboard import LeaderboardRow


def numbered(rows: Iterable[LeaderboardRow], verdict: Verdict) -> Iterable[LeaderboardRow]:
    """Numbers the rows that are ranked; equal rates share a rank."""
    last, rank = None, 0
    for place, row in enumerate(rows, start=1):
        if row.reference:
            yield row
            continue
        value = getattr(row.overall, verdict).value
        rank = rank if value == last else place
        last = value
        yield row.model_copy(update={"rank": rank})


def with_sets(
    rows: Sequence[LeaderboardRow], played: Mapping[str, Outcomes], verdict: Verdict
) -> list[LeaderboardRow]:
    """The rows with the ranks that chance leaves open; every policy played the same episodes."""
    ranked = [row for row in rows if not row.reference]
    if not ranked:
        return list(rows)
    good = [np.frombuffer(getattr(played[row.evaluation], verdict), dtype=bool) for row in ranked]
    sets = statistics.rank_sets(np.stack(good))
    told = [
        row.model_copy(update={"rank_best": best, "rank_worst": worst})
        for row, (best, worst) in zip(ranked, sets, strict=True)
    ]
    return told + [row for row in rows if row.reference]
