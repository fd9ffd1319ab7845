"""Several policies on the same episodes, and the ablations; both as files."""

from typing import Annotated

from fastapi import Depends, Query
from fastapi.responses import StreamingResponse
from pydantic import StringConstraints

from hide_tasks.contract import Split
from server import ablation_exports, ablations, comparison_exports, several
from server.ablation_rows import Size
from server.ablations import Asked
from server.access import Router, Scope, needs
from server.deps import Reading, ThePlace
from server.exports import TableFormat, require_papers
from server.revalidation import Revalidate
from server.routes.exports import file_of, named, of_formats
from server.schemas.ablations import Ablations
from server.schemas.common import Verdict
from server.schemas.several import SeveralComparison

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
ABLATIONS = "/ablations"


@router.get(SEVERAL)
@needs(Scope.READ)
def compare_several(
    session: Reading,
    revalidate: Revalidate,
    policy: Policies,
    place: ThePlace,
    verdict: Verdict = "success",
) -> SeveralComparison:
    """Two to six policies on the episodes that all of them played.

    Rates and rank sets together and per category, every pair's difference with its interval and
    p-value (McNemar's mid-p, Holm's correction over the pairs), and what each made of each episode.
    """
    ones = several.found(session, policy, place)
    revalidate.unless(*((one.id, one.state) for one in ones), verdict)
    return several.compare(session, ones, verdict=verdict)


@router.get(
    SEVERAL + "/export", response_class=StreamingResponse, responses=of_formats(TableFormat)
)
@needs(Scope.READ)
def export_comparison(
    session: Reading,
    policy: Policies,
    place: ThePlace,
    format: TableFormat = TableFormat.CSV,
    verdict: Verdict = "success",
) -> StreamingResponse:
    """A comparison as a file: JSON, CSV with a line per episode, or LaTeX rows of the paper's
    table, of suite `hide` alone, with every pair's test in comments."""
    ones = several.found(session, policy, place)
    require_papers(format, ones[0].suite)
    pieces = comparison_exports.of_comparison(
        several.compare(session, ones, verdict=verdict), format
    )
    name = named("comparison", ones[0].suite, ones[0].split, verdict)
    return file_of(pieces, name, format.value)


def _ablations_asked(
    split: Split = "test",
    verdict: Verdict = "success",
    size: Annotated[Size, Query(description="Of the presets: on two cores, or as published.")] = (
        "small"
    ),
    clock: Annotated[
        bool, Query(description="Policies that are told the number of the decision.")
    ] = False,
) -> Asked:
    return Asked(split, verdict, size, clock)


WhichAblations = Annotated[Asked, Depends(_ablations_asked)]


@router.get(ABLATIONS)
@needs(Scope.READ)
def get_ablations(session: Reading, revalidate: Revalidate, asked: WhichAblations) -> Ablations:
    """Memory's content, length and components, as in the paper's table and figure.

    A checkpoint stands in the cell that its configuration says, with its latest whole evaluation;
    of several versions in one cell the mean is given, and each. Neighbours are tested on the same
    episodes, with Holm's correction in each block. The paper's figures are of another simulator.
    """
    revalidate.unless(*asked, *ablations.standing(session, asked.split))
    return ablations.ablations(session, asked)


@router.get(
    ABLATIONS + "/export", response_class=StreamingResponse, responses=of_formats(TableFormat)
)
@needs(Scope.READ)
def export_ablations(
    session: Reading,
    asked: WhichAblations,
    format: TableFormat = TableFormat.CSV,
) -> StreamingResponse:
    """The ablations as a file: JSON, CSV with a line per row, LaTeX rows of the paper's table."""
    found = ablations.ablations(session, asked)
    pieces = ablation_exports.of_ablations(found, format)
    return file_of(pieces, f"ablations-{asked.size}-{asked.split}-{asked.verdict}", format.value)
