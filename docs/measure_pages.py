"""Measures pages of a ledger with a million episodes, in SQLite and in PostgreSQL.

Run it with: .venv/bin/python docs/measure_pages.py [EPISODES] [sqlite|postgresql] [READERS]
A worker plays meanwhile, so that results come in. The readers' requests cost this machine's
processor too. A ledger of a million wants about 10 GB of disk and some minutes to be made.
"""

import asyncio
import os
import random
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median, quantiles
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[1]))

import httpx
from sqlalchemy import Connection, select, text, update
from sqlalchemy.orm import Session

from hide_tasks.contract import EpisodeSpec, Failure
from server import policies
from server.blobs import Blobs
from server.db import Database, is_postgres
from server.models import Base, Evaluation, Policy, PolicyVersion, new_id
from server.settings import LEDGER
from tests.server import ledgers, postgres
from tests.server.running import RunningServer
from workers.protocol import PythonPolicy

POLICIES = 250
TEMPLATES = 6  # evaluations that are played through; the others are copies of them
SECONDS = 40.0  # of each measurement
PAUSE = 2.0  # s that a reader looks at a page, on average
COPIED = (  # what an evaluation is made of
    ("evaluations", "e.id = :id", ""),
    ("shards", "evaluation_id = :id", ""),
    ("attempts", "s.evaluation_id = :id", "JOIN shards s ON s.id = e.shard_id"),
    ("episodes", "evaluation_id = :id", ""),
    ("decisions", "p.evaluation_id = :id", "JOIN episodes p ON p.id = e.episode_id"),
    ("hidden_changes", "p.evaluation_id = :id", "JOIN episodes p ON p.id = e.episode_id"),
    ("hidden_spans", "p.evaluation_id = :id", "JOIN episodes p ON p.id = e.episode_id"),
    ("events", "evaluation_id = :id", ""),
)
RENAMED = {"evaluation_id", "shard_id", "episode_id", "attempt_id"}
SERIES = (
    "WITH RECURSIVE n(n) AS "
    "(SELECT cast(:low as integer) UNION ALL SELECT n + 1 FROM n WHERE n < :high)"
)


def filled(database: Database, store: Blobs, episodes: int) -> None:
    """Makes a ledger of so many episodes: some evaluations by the server's own code, and copies."""
    with database.writing() as session:
        versions = [_version(session, n) for n in range(POLICIES)]
    chance = random.Random(7)

    def outcome(_: EpisodeSpec) -> Failure | None:
        return None if chance.random() < 0.5 else chance.choice(list(Failure))

    templates = [
        ledgers.evaluated(database, store, f"model-{n:03}", outcome) for n in range(TEMPLATES)
    ]
    copies = episodes // 375 // TEMPLATES
    for n, template in enumerate(templates):
        with _unguarded(database) as connection:
            for low in range(n * copies, (n + 1) * copies, 20):
                _copy(connection, template, low, min(low + 20, (n + 1) * copies) - 1)
            _spread(connection, versions)
    with database.engine.connect() as connection:
        connection.execute(text("ANALYZE"))
        connection.commit()


@contextmanager
def _unguarded(database: Database) -> Iterator[Connection]:
    """A transaction whose inserts the ledger's triggers do not see: they refuse finished rows."""
    with database.engine.execution_options(writes=True).begin() as connection:
        if is_postgres(database.engine):
            connection.execute(text("SET LOCAL session_replication_role = replica"))
            yield connection
            return
        found = select(text("name, sql FROM sqlite_master WHERE type = 'trigger'"))
        triggers = connection.execute(found).all()
        for name, _ in triggers:
            connection.exec_driver_sql(f"DROP TRIGGER {name}")
        yield connection
        for _, made in triggers:
            connection.exec_driver_sql(made)


def _version(session: Session, n: int) -> str:
    policy = Policy(id=new_id("po"), name=f"model-{n:03}")
    spec = PythonPolicy(target="tests.workers.some_policies:Stays").model_dump(mode="json")
    version = PolicyVersion(id=new_id("pv"), policy=policy, number=1, spec=spec)
    session.add(version)
    session.flush()
    return version.id


def _copy(connection: Connection, template: str, low: int, high: int) -> None:
    for name, where, joined in COPIED:
        columns = [c.name for c in Base.metadata.tables[name].columns if c.name != "seq"]
        values = [_renamed(f'e."{c}"') if _is_id(name, c) else f'e."{c}"' for c in columns]
        if name == "events":  # they name episodes
            values[columns.index("payload")] = _payload(connection)
        into = ", ".join(f'"{c}"' for c in columns)
        connection.execute(
            text(
                f"INSERT INTO {name} ({into}) {SERIES} SELECT {', '.join(values)} "
                f"FROM n CROSS JOIN {name} e {joined} WHERE {where}"
            ),
            {"id": template, "low": low, "high": high},
        )


def _payload(connection: Connection) -> str:
    """With the copy's episodes; the time in their identifiers begins as the evaluation's."""
    number = "substr(cast(10000000 + n.n as text), 4)"
    named = f"""'"ep_' || substr(:id, 4, 5), '"ep_' || {number}"""
    said = f"replace(cast(e.payload as text), {named})"
    return f"cast({said} as json)" if connection.dialect.name == "postgresql" else said


def _is_id(table: str, column: str) -> bool:
    return column in RENAMED or (column == "id" and table != "events")


def _renamed(value: str) -> str:
    """Another number in place of the time in an identifier."""
    return f"substr({value}, 1, 3) || substr(cast(10000000 + n.n as text), 4) || substr({value}, 9)"


def _spread(connection: Connection, versions: list[str]) -> None:
    """Gives the evaluations to the policies in turn."""
    ids = connection.scalars(select(Evaluation.id).order_by(Evaluation.id)).all()
    for n, id in enumerate(ids):
        version = versions[n % len(versions)]
        moved = update(Evaluation).where(Evaluation.id == id)
        connection.execute(moved.values(policy_version_id=version))


def pages(server: RunningServer) -> dict[str, list[str]]:
    """Addresses of each kind of page."""
    listed = server.get("/evaluations", limit=200, state="completed")["items"]
    ids = [one["id"] for one in listed]
    return {
        "leaderboard": ["/", "/?verdict=exact"],
        "evaluation": [f"/evaluations/{id}" for id in ids],
        "failures": [f"/evaluations/{id}/failures" for id in ids],
        "failures, filtered": [f"/evaluations/{id}/failures?category=RC" for id in ids],
        "failures of all": ["/failures", "/failures?task=push_button_times"],
        "evaluations": ["/evaluations", "/evaluations?policy=model-007"],
    }


async def read(server: RunningServer, readers: int, pause: float) -> dict[str, list[float]]:
    """Seconds that each answer took, by kind of page; every reader goes from page to page."""
    taken: dict[str, list[float]] = {}
    kinds, end = pages(server), time.monotonic() + SECONDS
    limits = httpx.Limits(max_connections=readers, max_keepalive_connections=readers)
    async with httpx.AsyncClient(
        base_url=server.url, limits=limits, timeout=60, trust_env=False
    ) as client:

        async def reader(seed: int) -> None:
            chance = random.Random(seed)
            await asyncio.sleep(chance.uniform(0, pause))
            while time.monotonic() < end:
                kind = chance.choice(list(kinds))
                began = time.perf_counter()
                answer = await client.get(chance.choice(kinds[kind]))
                answer.raise_for_status()
                taken.setdefault(kind, []).append(time.perf_counter() - began)
                await asyncio.sleep(chance.expovariate(1 / pause) if pause else 0)

        await asyncio.gather(*map(reader, range(readers)))
    return taken


def told(title: str, taken: dict[str, list[float]], results: int) -> None:
    """Prints a table."""
    count = sum(map(len, taken.values()))
    pace, added = count / SECONDS, 60 * results / SECONDS
    print(f"{title}: {pace:.1f} pages a second, {added:.0f} results a minute")
    for kind, times in taken.items():
        p50, p99 = 1000 * median(times), 1000 * quantiles(times, n=100)[98]
        print(f"  {kind:20} p50 {p50:6.0f} ms   p99 {p99:6.0f} ms   of {len(times)}", flush=True)


def measure(folder: Path, options: list[str], readers: int) -> None:
    """A server on the ledger, read by nobody else, then by people, then as fast as it can."""
    began = time.perf_counter()
    with RunningServer(folder, "--no-references", *options, workers=1) as server:
        print(f"start {time.perf_counter() - began:.1f} s")
        for path in ("/", "/", "/?verdict=exact"):
            began = time.perf_counter()
            server.client.get(path).raise_for_status()
            print(f"  {path} {1000 * (time.perf_counter() - began):.0f} ms")
        id = server.post("/evaluations", {"policy": "noop"})["id"]
        time.sleep(20)  # until its worker plays
        for title, count, pause in (
            ("one reader", 1, 0.0),
            (f"{readers} readers, {PAUSE:g} s a page", readers, PAUSE),
            (f"{readers} readers without a pause", readers, 0.0),
        ):
            before = server.final(id)
            taken = asyncio.run(read(server, count, pause))
            told(title, taken, server.final(id) - before)


def kinds_of(kind: str, folder: Path) -> Iterator[tuple[str, Path | str]]:
    """The ledgers' names and places."""
    if kind in ("", "sqlite"):
        yield "SQLite", folder / "data" / LEDGER
    if kind in ("", "postgresql"):
        yield "PostgreSQL", postgres.create("pages")


def main(episodes: int = 1_000_000, kind: str = "", readers: int = 50) -> None:
    """Prints what was measured of each."""
    print(f"{os.cpu_count()} processors")
    with TemporaryDirectory(prefix="hide-pages-") as temporary:
        for name, place in kinds_of(kind, Path(temporary)):
            data = Path(temporary) / "data"
            data.mkdir(exist_ok=True)
            began = time.perf_counter()
            database = Database(place)
            with database.writing() as session:
                policies.register_builtin(session)
            filled(database, Blobs(data / "blobs"), episodes)
            database.close()
            print(f"{name}: made in {time.perf_counter() - began:.0f} s")
            measure(data, [] if isinstance(place, Path) else ["--database", place], readers)
            shutil.rmtree(data)


if __name__ == "__main__":
    given = dict(enumerate(sys.argv))
    main(int(given.get(1, "1000000")), given.get(2, ""), int(given.get(3, "50")))
