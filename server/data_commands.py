"""`hide verify`, and what keeps a server's data: said on the machine that has the data folder."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from server.arguments import BadUsage, settings_of

if TYPE_CHECKING:
    from server.backup import Copied
    from server.retention import Doomed, Orphan, Rule
    from server.verification.findings import Findings

TOLD = 100  # mismatches that are printed; --json has all
Data = Annotated[Path | None, Option(help="The server's folder. Default: data")]
AsJson = Annotated[bool, Option("--json", help="Print JSON instead of lines.")]
Workers = Annotated[
    int | None, Option(min=1, help="Episodes at a time; default: one per processor.")
]


def add_to(app: typer.Typer) -> None:
    """The commands become some of `hide`'s."""
    for command in (verify, backup, restore, prune):
        app.command(command.__name__)(command)


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


def backup(
    folder: Annotated[Path, Argument(metavar="DIR", help="New, or an earlier backup.")],
    data: Data = None,
) -> None:
    """Copy a server's ledger and files, whether it runs or not; again: what is new since."""
    from server.backup import BackupError, back_up
    from server.data_folder import DataFolderError
    from server.db import LedgerError
    from server.read_only import ReadOnlyFolder

    try:
        with ReadOnlyFolder.opened(settings_of({"data": data}).data) as opened:
            copied = back_up(opened, folder, _say)
    except (BackupError, DataFolderError, LedgerError) as error:
        raise BadUsage(str(error)) from None
    _tell_copied(folder, copied)


def restore(
    folder: Annotated[Path, Argument(metavar="DIR", help="Of hide backup.")],
    data: Data = None,
) -> None:
    """Make a server's folder of a backup; a server that is started on it goes on from there."""
    from server import backup as backups

    target = settings_of({"data": data}).data
    try:
        copied = backups.restore(folder, target, _say)
    except backups.BackupError as error:
        raise BadUsage(str(error)) from None
    _tell_copied(target, copied)


def _tell_copied(folder: Path, copied: "Copied") -> None:
    typer.echo(
        f"{folder}: the ledger of {copied.created} (revision {copied.revision}) and "
        f"{copied.files} files"
    )
    for fault in copied.faults:
        typer.echo(f"left out: {fault}", err=True)
    if copied.faults:
        raise typer.Exit(1)


def prune(
    older_than: Annotated[
        float | None, Option(min=0, metavar="DAYS", help="Remove recordings that are older.")
    ] = None,
    above: Annotated[
        float | None,
        Option(min=0, metavar="GIB", help="Remove the oldest until no more than that is left."),
    ] = None,
    orphans: Annotated[
        bool, Option("--orphans", help="Remove files that nothing names and that are a day old.")
    ] = False,
    dry_run: Annotated[bool, Option("--dry-run", help="Only say what would go.")] = False,
    data: Data = None,
) -> None:
    """Remove recordings to make room, never results; without options, as the settings say.

    Lists orphans: recordings of attempts that came to nothing, say.
    """
    from server import retention
    from server.blobs import Blobs
    from server.db import Database, LedgerError
    from server.settings import LEDGER

    settings = settings_of({"data": data})
    rule = _rule(older_than, above, (settings.keep_days, settings.keep_bytes))
    if not (settings.data / LEDGER).is_file():
        raise BadUsage(f"{settings.data} is no data folder of a server: it has no {LEDGER}.")
    store = Blobs(settings.data / "blobs")
    try:
        database = Database(settings.data / LEDGER)
    except LedgerError as error:
        raise BadUsage(str(error)) from None
    try:
        with database.reading() as session:
            found, unnamed = retention.doomed(session, rule), retention.orphans(session, store)
        if not dry_run:
            found = retention.prune(database, store, rule)
        if orphans and not dry_run:
            unnamed = retention.prune_orphans(database, store)
        with database.reading() as session:
            left = retention.kept(session)
    finally:
        database.close()
    for line in _pruned(found, unnamed, left, gone=not dry_run, orphans_gone=orphans):
        typer.echo(line)


def _rule(
    days: float | None, gib: float | None, settings: tuple[float | None, int | None]
) -> "Rule":
    from server.retention import Rule

    if days is None and gib is None:
        return Rule(*settings)
    return Rule(days, None if gib is None else round(gib * 2**30))


def _pruned(
    found: "list[Doomed]",
    unnamed: "list[Orphan]",
    left: tuple[int, int],
    *,
    gone: bool,
    orphans_gone: bool,
) -> list[str]:
    removed = "removed" if gone else "would be removed"
    swept = "removed" if gone and orphans_gone else "orphans; --orphans removes them"
    lines = [f"orphan {one.path} {one.size} bytes" for one in unnamed]
    return [
        *lines,
        f"{len(found)} recordings {removed}, {sum(one.size for one in found)} bytes",
        f"{len(unnamed)} files that nothing names, {sum(one.size for one in unnamed)} bytes: "
        f"{swept}",
        f"{left[0]} recordings are kept, {left[1]} bytes",
    ]
