"""Several policies on the same episodes, and as files."""

from typing import Annotated

from fastapi import Query
from fastapi.responses import StreamingResponse
from pydantic import StringConstraints

from hide_tasks.contract import Split
from server import comparison_exports, several
from server.access import Router, Scope, needs
from server.board_exports import LeaderboardFormat
from server.comparison_schemas import SeveralComparison
from server.deps import Reading
from server.revalidation import Revalidate
from server.routes.exports import file_of, of_formats
from server.schemas import Verdict

router = Router(tags=["catalogue"])

SEVERAL = "/comparisons/several"
Named = Annotated[str, StringConstraints(min_length=1, max_length=100)]
Policies = Annotated[
    list[Named],
    Query(
        min_length=several.FEWEST,
        max_length=several.MOST,
        description="Evaluations' ids, or policies: name, name@version. Once for each.",
    ),
]
OnSplit = Annotated[Split, Query(description="Of policies: where they are compared.")]


@router.get(SEVERAL)
@needs(Scope.READ)
def compare_several(
    session: Reading,
    revalidate: Revalidate,
    policy: Policies,
    split: OnSplit = "test",
    verdict: Verdict = "success",
) -> SeveralComparison:
    """Two to six policies on the episodes that all of them played.

    Rates and rank sets together and per category, every pair's difference with its interval and
    p-value (McNemar's mid-p, Holm's correction over the pairs), and what each made of each episode.
    """
    ones = several.found(session, policy, split)
    revalidate.unless(*((one.id, one.state) for one in ones), verdict)
    return several.compare(session, ones, verdict=verdict)


@router.get(
    SEVERAL + "/export", response_class=StreamingResponse, responses=of_formats(LeaderboardFormat)
)
@needs(Scope.READ)
def export_comparison(
    session: Reading,
    policy: Policies,
    format: LeaderboardFormat = LeaderboardFormat.CSV,
    split: OnSplit = "test",
    verdict: Verdict = "success",
) -> StreamingResponse:
    """A comparison as a file: JSON, CSV with a line per episode, or LaTeX rows of the paper's
    table with every pair's test in comments."""
    compared = several.compare(session, several.found(session, policy, split), verdict=verdict)
    pieces = comparison_exports.of_comparison(compared, format)
    return file_of(pieces, f"comparison-{split}-{verdict}", format.value)
