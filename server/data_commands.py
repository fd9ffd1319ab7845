"""`hide verify`, and what keeps a server's data: said on the machine that has the data folder."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from server.arguments import BadUsage, settings_of

if TYPE_CHECKING:
    from server.verification.findings import Findings

TOLD = 100  # mismatches that are printed; --json has all
Data = Annotated[Path | None, Option(help="The server's folder. Default: data")]
AsJson = Annotated[bool, Option("--json", help="Print JSON instead of lines.")]
Workers = Annotated[
    int | None, Option(min=1, help="Episodes at a time; default: one per processor.")
]


def add_to(app: typer.Typer) -> None:
    """The commands become some of `hide`'s."""
    app.command("verify")(verify)


def verify(
    evaluation: Annotated[
        str | None,
        Argument(
            metavar="[EVALUATION]",
            help="ev_…, one evaluation of the server's; or the folder of a run of hide eval. "
            "Default: everything that the server keeps.",
        ),
    ] = None,
    data: Data = None,
    sample: Annotated[
        str,
        Option(metavar="N|all", help="Episodes of each task of an evaluation to play again."),
    ] = "2",
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Recompute scores, verdicts, digests and hashes, and play a sample of episodes again.

    Changes nothing, whether the server runs or not. Exit status 1 if something does not agree.
    """
    most = _sample(sample)
    found = _verified(evaluation, data, most, workers)
    if as_json:
        typer.echo(json.dumps(found.document, indent=1))
    else:
        for line in _lines(found):
            typer.echo(line)
    if found.mismatches:
        raise typer.Exit(1)


def _sample(text: str) -> int | None:
    if text == "all":
        return None
    if not text.isdecimal():
        raise BadUsage(f"--sample {text}: give a number of episodes of each task, or all.")
    return int(text)


def _verified(
    what: str | None, data: Path | None, sample: int | None, workers: int | None
) -> "Findings":
    from server.data_folder import DataFolderError
    from server.db import LedgerError
    from server.read_only import ReadOnlyFolder
    from server.verification.ledger import NoEvaluation, Verifier
    from server.verification.runs import verify_run
    from workers.evaluation import count_cpus
    from workers.run_folder import FolderError

    workers = workers or count_cpus()
    try:
        if what is not None and not what.startswith("ev_"):
            return verify_run(Path(what), sample=sample, workers=workers, say=_say)
        with ReadOnlyFolder.opened(settings_of({"data": data}).data) as folder:
            return Verifier(folder, sample, workers, _say).verify(what)
    except (DataFolderError, LedgerError, NoEvaluation, FolderError) as error:
        raise BadUsage(str(error)) from None


def _say(line: str) -> None:
    typer.echo(line, err=True)


def _lines(found: "Findings") -> list[str]:
    """What a reader wants to know, the worst last."""
    scores = [
        f"{name}: success {one.success} of {one.final}, exact {one.exact} of {one.final}"
        for name, one in found.scores.items()
    ]
    bitwise = f"{found.bitwise} of them to the last bit" if found.simulated else ""
    looked = (
        f"{found.evaluations} evaluations, {found.episodes} episodes, {found.files} files; "
        f"{found.simulated} episodes played again{', ' if bitwise else ''}{bitwise}"
    )
    if found.removed:
        looked += f"; {found.removed} recordings were removed before"
    unplayed = [f"not played again: {n} episodes, {why}" for why, n in found.unplayed.items()]
    wrong = [f"MISMATCH {one}" for one in found.mismatches[:TOLD]]
    if len(found.mismatches) > TOLD:
        wrong.append(f"and {len(found.mismatches) - TOLD} more; --json has them all")
    verdict = f"{len(found.mismatches)} mismatches" if found.mismatches else "Everything agrees."
    return [*scores, looked, *unplayed, *wrong, verdict]
