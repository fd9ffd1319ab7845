"""The `hide` command. It starts light: the simulator is imported by the commands that simulate.

A user's mistake is one line on standard error and exit status 2; what failed on its own is 1.
"""

import json
import sys
from collections.abc import Sequence
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from server import client_commands, cluster_commands, data_commands, people_commands
from server.arguments import (
    BadUsage,
    chosen_tasks,
    episode_count,
    episode_indices,
    new_folder,
    settings_of,
)

BAD_USAGE = 2
INTERRUPTED = 130  # as shells count: 128 and the signal's number

app = typer.Typer(
    help="HIDE: robot tasks whose next action depends on what was seen and done before.",
    add_completion=False,
    pretty_exceptions_enable=False,
)


class SplitName(StrEnum):
    train = "train"
    val = "val"
    test = "test"
    test100 = "test100"


class RulesName(StrEnum):
    hide = "hide"
    parity = "parity"


class AuthName(StrEnum):
    local = "local"
    users = "users"


class WireName(StrEnum):
    openpi = "openpi"
    vla_eval = "vla_eval"
    act = "act"
    gr00t = "gr00t"


class DemosFormat(StrEnum):
    hide = "hide"
    lerobot = "lerobot"


class CategoryName(StrEnum):
    RC = "RC"
    HSR = "HSR"
    EPT = "EPT"


Tasks = Annotated[str, Option(help="Task names with commas between; default: all of the suite.")]
Suite = Annotated[
    str | None, Option(metavar="NAME", help="hide, hide-hard or real4; default: hide.")
]
Workers = Annotated[
    int | None, Option(min=1, help="Episodes at a time; default: one per processor.")
]
SandboxOption = Annotated[
    str | None,
    Option(
        metavar="NAME",
        help="Around the process of your own class or checkpoint: bubblewrap, landlock, none, or "
        "best, which this machine has of them; default: best. hide doctor lists them.",
    ),
]
AsJson = Annotated[bool, Option("--json", help="Print JSON instead of a table.")]


app.add_typer(people_commands.user, name="user")
app.add_typer(people_commands.token, name="token")
for of_a_server in (client_commands.submit, client_commands.watch, client_commands.export):
    app.command()(of_a_server)
app.command()(cluster_commands.worker)
app.command()(cluster_commands.scheduler)


@app.callback(invoke_without_command=True)
def _start(
    context: typer.Context,
    show_version: Annotated[bool, Option("--version", help="Print the version.")] = False,
) -> None:
    if show_version:
        typer.echo(_version())
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def tasks(suite: Suite = None, as_json: AsJson = False) -> None:
    """List the tasks: language, variations, keyframes, hidden state, certificate."""
    from server import tables

    entries = tables.catalogue(chosen_tasks("", suite=suite))
    show({"tasks": entries} if as_json else tables.catalogue_table(entries))


@app.command("eval")
def evaluate(
    policy: Annotated[
        str,
        Argument(
            metavar="POLICY",
            help="expert, amnesiac, random, noop; expert-joint-position or expert-ee-delta, the "
            "expert's motion in rows at 20 Hz; seek-small or sam2act-small, trained "
            "checkpoints that come along; replay:DIR, the actions of another run, or "
            "replay:FILE.json, those of an episode; a checkpoint, path/to/file.safetensors; your "
            "own class, python:module:Class or "
            "python:path/to/file.py:Class; or a policy that is served, ws://host:port, "
            "http://host:port/act or tcp://host:port.",
        ),
    ],
    tasks: Tasks = "",
    suite: Suite = None,
    category: Annotated[CategoryName | None, Option(help="Only tasks of this kind.")] = None,
    split: Annotated[SplitName, Option(help="Which episodes.")] = SplitName.test,
    episodes: Annotated[
        int | None, Option(help="Per task, the first so many of the split; default: all.")
    ] = None,
    index: Annotated[
        list[int] | None,
        Option(
            metavar="N",
            help="Instead: this episode of each task, counted from 0; may be repeated.",
        ),
    ] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None,
        Option(help="The run's folder; a run that is there is resumed. Default: runs/…"),
    ] = None,
    as_json: AsJson = False,
    rules: Annotated[
        RulesName, Option(help="parity: 25 decisions, and success ends the episode.")
    ] = RulesName.hide,
    recordings: Annotated[
        bool, Option("--recordings/--no-recordings", help="Record each episode for the viewer.")
    ] = True,
    policy_timeout: Annotated[
        float,
        Option(
            min=0.001, metavar="SECONDS", help="For one answer of your own class or checkpoint."
        ),
    ] = 60.0,
    sandbox: SandboxOption = None,
    maps: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="For a policy that is served: a TOML file with its wire, what it sees, how it "
            "acts, its time limits.",
        ),
    ] = None,
) -> None:
    """Evaluate a policy without a server; with --out, an interrupted run resumes."""
    from hide_tasks.catalogue import suite_of
    from server.run import run
    from server.tables import results_table
    from workers.evaluation import Evaluation, missing

    evaluation = Evaluation(
        policy=policy,
        tasks=chosen_tasks(tasks, category, suite),
        split=split.value,
        episodes=episode_count(episodes, split.value),
        indices=episode_indices(index, episodes, split.value),
        rules=rules.value,
        recordings=recordings,
        policy_timeout=policy_timeout,
        sandbox=sandbox,
        maps=maps,
    )
    results = run(evaluation, out or new_folder(policy, suite_of(evaluation.tasks[0])), workers)
    show(results.model_dump(mode="json") if as_json else results_table(results))
    if missing(evaluation, results):
        raise typer.Exit(1)


@app.command()
def certify(
    tasks: Tasks = "", suite: Suite = None, workers: Workers = None, as_json: AsJson = False
) -> None:
    """Recompute the proofs that tasks need memory; takes minutes a task."""
    from server import tables
    from server.run import recertify

    names = chosen_tasks(tasks, suite=suite)
    certificates = recertify(names, workers)
    entries = tables.catalogue(names)
    show({"certificates": certificates} if as_json else tables.catalogue_table(entries))


@app.command()
def demos(
    out: Annotated[
        Path, Option(help="The folder of demonstrations; what is recorded there already stays.")
    ],
    tasks: Tasks = "",
    suite: Suite = None,
    split: Annotated[SplitName, Option(help="Which episodes.")] = SplitName.train,
    episodes: Annotated[
        int | None, Option(help="Per task, the first so many of the split; default: all.")
    ] = None,
    workers: Workers = None,
    form: Annotated[
        DemosFormat,
        Option(
            "--format",
            help="hide: keyframes, for hide train; lerobot: a LeRobotDataset v3.0 of the expert's "
            "dense motion at 20 Hz, one folder for one such command.",
        ),
    ] = DemosFormat.hide,
) -> None:
    """Record the expert for training: images, keyframes, stages, hidden state; resumes."""
    from server.run import demonstrate, export_lerobot

    names, count = chosen_tasks(tasks, suite=suite), episode_count(episodes, split.value)
    record = export_lerobot if form is DemosFormat.lerobot else demonstrate
    if record(names, out, split=split.value, episodes=count, workers=workers):
        raise typer.Exit(1)


@app.command()
def train(
    recipe: Annotated[
        str,
        Argument(
            metavar="CONFIG",
            help="A preset, such as seek-small, or a TOML file that changes one.",
        ),
    ],
    data: Annotated[
        Path,
        Option(help="A folder of hide demos; its keyframe store is made inside it, once."),
    ] = Path("demos"),
    out: Annotated[
        Path | None, Option(help="The training's folder. Default: runs/train-… with its seed.")
    ] = None,
    seed: Annotated[
        int | None,
        Option(min=0, help="Of weights, batches, noise. Default: the configuration's."),
    ] = None,
    start: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Leave the first phase out; go on from this policy without memory.",
        ),
    ] = None,
    resume: Annotated[
        bool,
        Option("--resume/--no-resume", help="Go on with the training in the folder, if any."),
    ] = True,
    steps_scale: Annotated[
        float, Option(min=0.0001, help="Times the steps, horizon and warm-up of both phases.")
    ] = 1.0,
) -> None:
    """Train a policy on recorded demonstrations; an interrupted training goes on."""
    from server.training import TrainingFailed
    from server.training import train as run

    try:
        checkpoint = run(
            recipe, data, out, resume=resume, steps_scale=steps_scale, seed=seed, start=start
        )
    except TrainingFailed as error:
        _fail(str(error), 1)
    else:
        typer.echo(checkpoint)


@app.command()
def serve(
    data: Annotated[
        Path | None, Option(help="The folder of ledger, recordings and logs. Default: data")
    ] = None,
    database: Annotated[
        str | None,
        Option(
            metavar="URL",
            help="postgresql+psycopg://user@host/name: the ledger is there, not in the folder. "
            "With a password in it, say it as HIDE_SERVER_DATABASE.",
        ),
    ] = None,
    host: Annotated[str | None, Option(help="An address of this machine.")] = None,
    port: Annotated[
        int | None, Option(min=0, max=65535, help="Default: 8000; 0: any that is free.")
    ] = None,
    workers: Annotated[
        int | None, Option(min=0, max=256, help="Shards at a time; default: one per processor.")
    ] = None,
    auth: Annotated[
        AuthName | None,
        Option(help="local: everything is done as one owner; users: everybody signs in."),
    ] = None,
    token: Annotated[
        bool | None,
        Option(
            "--token/--no-token",
            help="In local mode, ask for the token that is printed at start; default: when others "
            "than this machine's users may reach the server.",
        ),
    ] = None,
    public_url: Annotated[
        str | None,
        Option(help="The address that people use, such as https://evaluation.example.org."),
    ] = None,
    allow_python: Annotated[
        bool | None,
        Option(
            "--allow-python",
            help="Let clients name Python classes of this machine as policies: whoever has an "
            "account here then runs code as you.",
        ),
    ] = None,
    allow_remote: Annotated[
        list[str] | None,
        Option(
            metavar="HOST",
            help="Let remote policies be there as well: a host, host:port or network that is not "
            "public, or speaks no TLS; may be repeated.",
        ),
    ] = None,
    references: Annotated[
        bool | None,
        Option(
            "--references/--no-references",
            help="Evaluate the built-in and the trained policies on first start; default: yes.",
        ),
    ] = None,
    smoke: Annotated[
        bool | None,
        Option(
            "--smoke/--no-smoke",
            help="Try a new checkpoint at once, in one episode of each category; default: yes.",
        ),
    ] = None,
    sandbox: SandboxOption = None,
    scheduler: Annotated[
        str | None,
        Option(
            metavar="URL",
            help="tls://host:port, where hide scheduler runs: hide workers of other machines "
            "play, and none of this one.",
        ),
    ] = None,
) -> None:
    """Run the evaluation server: pages, API and workers. HIDE_SERVER_… variables are read too."""
    from server import logs
    from server.serve import serve as run_server

    given: dict[str, Any] = {
        "data": data,
        "database": database,
        "host": host,
        "port": port,
        "workers": workers,
        "auth": auth and auth.value,
        "token": token,
        "public_url": public_url,
        "allow_python": allow_python,
        "allow_remote": allow_remote or None,
        "references": references,
        "smoke": smoke,
        "sandbox": sandbox,
        "scheduler": scheduler,
    }
    settings = settings_of(given)
    run_server(settings, logs.configure(settings.log_format, settings.log_level))


@app.command("serve-policy")
def serve_policy(
    policy: Annotated[
        str,
        Argument(
            metavar="CHECKPOINT",
            help="path/to/file.safetensors, seek-small or sam2act-small, or your own class as for "
            "hide eval.",
        ),
    ],
    host: Annotated[
        str, Option(help="An address of this machine; other machines need HIDE_POLICY_KEY set.")
    ] = "127.0.0.1",
    port: Annotated[int, Option(min=0, max=65535, help="0: any that is free.")] = 8001,
    sessions: Annotated[
        int, Option(min=1, max=64, help="Episodes at a time; each has a process to itself.")
    ] = 1,
    policy_timeout: Annotated[
        float, Option(min=0.001, max=3600, metavar="SECONDS", help="For one answer.")
    ] = 60.0,
    wire: Annotated[
        WireName, Option(help="The protocol; act knows no episodes, gr00t one session.")
    ] = WireName.openpi,
    write_maps: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Write what clients of another wire than openpi declare: hide eval … --maps FILE.",
        ),
    ] = None,
) -> None:
    """Serve a policy to hide eval ws://…, to any openpi client, or over another wire."""
    from server.serve_policy import serve_policy as run_server

    run_server(
        policy,
        host=host,
        port=port,
        sessions=sessions,
        timeout=policy_timeout,
        wire=wire.value,
        maps=write_maps,
        serving=lambda url: typer.echo(f"{policy}: {url} (Ctrl-C stops)", err=True),
    )


@app.command()
def doctor() -> None:
    """Check this machine for what an evaluation needs."""
    from server.doctor import findings

    found = findings()
    for finding in found:
        mark, remedy = ("ok ", "") if finding.good else ("BAD", f"; {finding.remedy}")
        typer.echo(f"{mark} {finding.what}: {finding.found}{remedy}")
    if not all(finding.good for finding in found):
        raise typer.Exit(1)


data_commands.add_to(app)


def show(content: object) -> None:
    """A document as JSON, anything else as rich draws it, on standard output."""
    from server.tables import screen

    if isinstance(content, dict):
        typer.echo(json.dumps(content, indent=1))
    else:
        screen().print(content)


def _version() -> str:
    try:
        return version("hide-seek")
    except PackageNotFoundError:
        return "not installed"


def main(arguments: Sequence[str] | None = None) -> None:
    """The entry point: runs a command and exits with its status."""
    try:
        status = app(args=arguments, prog_name="hide", standalone_mode=False)
    except BadUsage as error:
        _fail(str(error), BAD_USAGE)
    except typer.TyperException as error:
        _fail(f"{error.format_message().rstrip('.')}. See hide --help.", BAD_USAGE)
    except BrokenPipeError:  # `hide tasks | head` has read enough
        sys.stderr.close()
        sys.exit(1)
    except OSError as error:
        _fail(f"{error.strerror}: {error.filename}" if error.filename else str(error), 1)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(message: str, status: int) -> None:
    typer.echo(f"hide: {' '.join(message.split())}", err=True)
    sys.exit(status)


if __name__ == "__main__":
    main()
