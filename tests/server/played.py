"""Ledgers whose episodes were really played, with recordings: each is short, and played once."""

import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from hide_tasks import suite
from hide_tasks.contract import EpisodeSpec
from server import lifecycle
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.models import Attempt, Shard
from server.settings import LEDGER
from tests.server import ledgers
from workers.hidden_trace import HiddenTrace
from workers.policies import BuiltIn
from workers.protocol import EpisodeCommit, measured_digest
from workers.simulator import EpisodeJob, play_once, recording_name

TASK = "push_button_times"
POLICIES = ("expert", "random")  # one that succeeds, one that does not


@cache
def _played(policy: str, index: int, task: str = TASK) -> tuple[EpisodeCommit, Path]:
    """What a worker sends of an episode, and its recording."""
    folder = Path(mkdtemp(prefix="hide-played-"))
    spec = suite.episode(task, "test", index)
    job = EpisodeJob(spec, BuiltIn(policy), f"{policy}@1", recordings=folder)
    trace = HiddenTrace()
    played = play_once(job, trace)
    result = played.result.model_copy(update={"recording": None})
    measured = (result, trace.start, tuple(played.decisions), tuple(trace.changes))
    told = EpisodeCommit(
        result=result,
        start=trace.start,
        decisions=measured[2],
        changes=measured[3],
        thumbnail=trace.thumbnail,
        digest=measured_digest(*measured),
    )
    return told, folder / recording_name(spec)


def evaluated(
    database: Database, store: Blobs, policy: str, episodes: int = 1, task: str = TASK
) -> str:
    """A completed evaluation's id, as real workers leave it."""
    with database.writing() as session:
        id = ledgers.created(session, policy, tasks=[task], episodes=episodes).id
        while found := ledgers.leased(session):
            _report(session, store, *found, policy)
        return id


def _report(session, store: Blobs, attempt: Attempt, shard: Shard, policy: str) -> None:
    for episode in lifecycle.open_episodes(shard):
        lifecycle.begin(session, attempt, episode)
        spec = lifecycle.spec_of(episode)
        told, recording = _played(policy, spec.index, spec.task)
        sha256 = store.put(recording.read_bytes())
        commit(session, store, attempt, episode, told.model_copy(update={"recording": sha256}))
    session.flush()
    lifecycle.end_attempt(session, attempt, None)


def data_folder(path: Path) -> dict[str, str]:
    """A data folder with an evaluation of each policy; their ids, by policy."""
    shutil.copytree(_filled()[0], path, dirs_exist_ok=True)
    return _filled()[1]


@cache
def _filled() -> tuple[Path, dict[str, str]]:
    folder = Path(mkdtemp(prefix="hide-data-"))
    database, store = ledgers.opened(folder), Blobs(folder / "blobs")
    ids = {policy: evaluated(database, store, policy) for policy in POLICIES}
    database.close()
    assert (folder / LEDGER).is_file()
    return folder, ids


def spec() -> EpisodeSpec:
    """The episode that is played."""
    return suite.episode(TASK, "test", 0)
