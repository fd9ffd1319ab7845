"""`hide submit`, `hide watch`, `hide export`: a server that runs somewhere, by its REST API.

HIDE_URL says where it is and HIDE_TOKEN lets in; a token has no option, for others would see it
in the list of processes.
"""

import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from server.arguments import BadUsage, chosen_tasks, episode_count

if TYPE_CHECKING:
    from server.client import Client

SUFFIX = ".safetensors"
FAILED = 1  # exit status of what is not completed
Server = Annotated[
    str | None, Option("--server", metavar="URL", help="Default: HIDE_URL, or this machine's.")
]
AsJson = Annotated[bool, Option("--json", help="Print JSON.")]


class Format(StrEnum):
    json = "json"
    csv = "csv"
    jsonl = "jsonl"
    latex = "latex"
    zip = "zip"


def submit(
    policy: Annotated[
        str,
        Argument(
            metavar="POLICY",
            help="A checkpoint, path/to/file.safetensors, which is uploaded; ws://host:port, where "
            "one is served; or the name of a policy that the server knows.",
        ),
    ],
    name: Annotated[
        str | None, Option(help="Of the policy on the server. Default: the file's.")
    ] = None,
    description: Annotated[str, Option(help="For people.")] = "",
    tasks: Annotated[str, Option(help="Task names with commas between; default: all.")] = "",
    suite: Annotated[
        str | None, Option(metavar="NAME", help="hide, hide-hard or real4; default: hide.")
    ] = None,
    category: Annotated[str | None, Option(help="Only tasks of this kind: RC, HSR, EPT.")] = None,
    split: Annotated[str, Option(help="train, val, test or test100.")] = "test",
    episodes: Annotated[int | None, Option(help="Per task, the first so many.")] = None,
    maps: Annotated[
        Path | None, Option(metavar="FILE", help="For ws://…: what the policy sees, how it acts.")
    ] = None,
    wait: Annotated[bool, Option("--wait", help="Watch it to its end.")] = False,
    as_json: AsJson = False,
    server: Server = None,
) -> None:
    """Ask a server for an evaluation, uploading the checkpoint first; prints the evaluation's id.

    A broken upload goes on where it was when the same line is given again.
    """
    wanted: dict[str, Any] = {"split": split, "episodes": _count(episodes, split)}
    if tasks or category or suite:
        wanted["tasks"] = list(chosen_tasks(tasks, category, suite))
    if policy.endswith(SUFFIX):
        _require_fit(Path(policy), wanted.get("tasks") or chosen_tasks("", None, None))
    with connected(server) as client:
        version = _handed_in(client, policy, name, description, maps)
        evaluation = client.evaluate(version, **wanted)
        if wait:
            typer.echo(evaluation.id, err=True)
            _follow(client, evaluation.id, as_json)
        else:
            typer.echo(evaluation.model_dump_json(indent=1) if as_json else evaluation.id)


def watch(
    evaluation: Annotated[str, Argument(metavar="ID", help="Of the evaluation: ev_…")],
    as_json: AsJson = False,
    server: Server = None,
) -> None:
    """Follow an evaluation to its end and print its rates; exit status 1 unless it completes."""
    with connected(server) as client:
        _follow(client, evaluation, as_json)


def export(
    what: Annotated[str, Argument(metavar="WHAT", help="leaderboard, or an evaluation's id: ev_…")],
    format: Annotated[
        Format,
        Option(
            help="latex: rows of the paper's table. Of an evaluation also jsonl: a document per "
            "episode with its decisions; zip: everything."
        ),
    ] = Format.csv,
    suite: Annotated[
        str | None, Option(metavar="NAME", help="Of the leaderboard. Default: hide.")
    ] = None,
    out: Annotated[Path | None, Option(help="A file. Default: standard output.")] = None,
    server: Server = None,
) -> None:
    """Write the leaderboard or an evaluation as JSON, CSV or LaTeX, or all of it as a zip."""
    if format is Format.zip and (out is None and sys.stdout.isatty()):
        raise BadUsage("--format zip: give --out FILE; a terminal cannot show it.")
    if what == "leaderboard" and format in (Format.zip, Format.jsonl):
        raise BadUsage(f"--format {format}: is of an evaluation; give json, csv or latex.")
    if what != "leaderboard" and suite is not None:
        raise BadUsage(f"--suite {suite}: is of the leaderboard; an evaluation has its own.")
    path = "/leaderboard" if what == "leaderboard" else f"/evaluations/{what}"
    query = {"format": format.value, "suite": suite}
    with connected(server) as client:
        if out is not None:
            client.save(f"/api/v1{path}/export", out, **query)
            typer.echo(out, err=True)
        else:
            for piece in client.pieces(f"/api/v1{path}/export", **query):
                sys.stdout.buffer.write(piece)
            sys.stdout.buffer.flush()


@contextmanager
def connected(server: str | None) -> Iterator["Client"]:
    """A client of the server that the user means.

    Raises:
        BadUsage: it said no.
    """
    from server.client import LOCAL, Client, ServerProblem, Unreachable

    try:
        client = Client(server or os.environ.get("HIDE_URL") or LOCAL, _token())
    except ValueError as error:
        raise BadUsage(str(error)) from None
    try:
        with client:
            yield client
    except Unreachable as error:
        raise ConnectionError(error.detail) from None
    except ServerProblem as error:
        hint = "" if error.status != 401 else " Set HIDE_TOKEN to a token of yours."
        raise BadUsage(f"{error.detail}{hint}") from None


def _token() -> str | None:
    token = os.environ.get("HIDE_TOKEN", "").strip() or None
    if token and not (token.isascii() and token.isprintable()):
        raise BadUsage("HIDE_TOKEN is no token of a server; they are like hide_….")
    return token


def _count(episodes: int | None, split: str) -> int | None:
    from hide_tasks.suite import SPLITS

    if split not in SPLITS:
        raise BadUsage(f"--split {split}: is not one of {', '.join(SPLITS)}.")
    return episode_count(episodes, split)


def _handed_in(
    client: "Client", policy: str, name: str | None, description: str, maps: Path | None
) -> str:
    """The id of the policy's version on the server, which is made if it is not there yet."""
    if "://" in policy:
        from workers.policies import BadPolicy, read_remote

        if name is None:
            raise BadUsage(f"--name: {policy} needs a name on the server.")
        try:
            spec = read_remote(policy, maps=maps).spec
        except BadPolicy as error:
            raise BadUsage(str(error)) from None
        return client.register(name, spec, description).id
    if maps is not None:
        raise BadUsage(f"--maps {maps}: is for ws://host:port; {policy} is none.")
    if policy.endswith(SUFFIX):
        return _uploaded(client, Path(policy), name or _name_of(Path(policy)), description)
    return client.policy(policy).id


def _require_fit(file: Path, tasks: Sequence[str]) -> None:
    """Raises BadUsage, before anything is uploaded, if the weights are of another suite."""
    from seek_model.checkpoint_header import BadCheckpoint, read_header
    from workers.fitness import is_of_another_suite

    if not file.is_file():
        raise BadUsage(f"No checkpoint {file}.")
    try:
        trained_on = read_header(file).provenance.suite
    except BadCheckpoint as error:
        raise BadUsage(f"{file} is no checkpoint: {error}.") from None
    if reason := is_of_another_suite(file.stem, trained_on, tasks):
        raise BadUsage(reason)


def _uploaded(client: "Client", file: Path, name: str, description: str) -> str:
    shown = -1

    def told(come: int, size: int) -> None:
        nonlocal shown
        if (percent := 100 * come // max(size, 1)) >= shown + 10 or come == size:
            shown = percent
            typer.echo(f"{file.name}: {come / 1e6:.1f} of {size / 1e6:.1f} MB", err=True)

    version = client.upload(file, name, description, told=told)
    typer.echo(f"{version.policy}@{version.version} is {version.id}", err=True)
    return version.id


def _name_of(file: Path) -> str:
    return re.sub(r"[^A-Za-z0-9 _.:+-]+", "-", file.stem).lstrip(" _.:+-")[:80] or "checkpoint"


def _follow(client: "Client", evaluation: str, as_json: bool) -> None:
    from server.client_screen import following, rates

    with following() as screen:
        done = client.wait(evaluation, screen)
    if as_json:
        typer.echo(done.model_dump_json(indent=1))
    else:
        from server.tables import screen as terminal

        terminal().print(rates(done, list(client.episodes(evaluation, state="final"))))
    if done.state != "completed":
        why = f": {done.reason}" if done.reason else ""
        typer.echo(f"{evaluation} is {done.state}{why}", err=True)
        raise typer.Exit(FAILED)
