"""The whole application over a real ledger with evaluations in every state, for tests of pages."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fastapi import FastAPI
from sqlalchemy.orm import Session

from hide_tasks.contract import Attention, Belief, EpisodeSpec, Failure
from server import batches, lifecycle, snapshots, webhooks
from server.commit import commit
from server.hub import Hub
from server.models import Attempt, Evaluation, Shard, now
from server.problems import invalid
from server.settings import Settings
from server.states import WebhookEvent
from server.webhooks import Outcome
from tests import viewer_files
from tests.server import ledgers
from web.app import create_app
from workers.hidden_trace import HiddenTrace
from workers.policies import BuiltIn
from workers.preflight import Check
from workers.protocol import EpisodeCommit, measured_digest
from workers.simulator import EpisodeJob, play_once

KILLED = "The worker's process was killed (SIGKILL)."
NASTY = "<script>alert('detail')</script>"
EVERY_SUITE = ("full", "hide-hard", "real4")  # by the names that ask for the whole of each
SMALL = {"policy": "mine", "tasks": ["search_drawer"], "episodes": 2}
TRIED = (
    Check(name="header", outcome="passed", seconds=0.0, detail="seek-small, 214 tensors"),
    Check(name="load", outcome="passed", seconds=3.42),
    Check(name="repetition", outcome="noted", seconds=0.2, detail=NASTY),
)


@dataclass(frozen=True)
class Site:
    """An application and what is in its ledger."""

    app: FastAPI
    completed: str  # every kind of failure, both verdicts
    running: str
    queued: str
    incomplete: str
    cancelled: str
    recorded: str  # one episode, played by the expert, with its recording
    checkpoint: str  # a policy's version
    batch: str  # one evaluation, one refusal, and one item that is not dealt with
    webhook: str

    @property
    def hub(self) -> Hub:
        """Its ledger and its files."""
        hub: Hub = self.app.state.hub
        return hub

    def episodes(self, evaluation: str, **fields: object) -> list[str]:
        """Ids of an evaluation's episodes whose fields have these values."""
        with self.hub.database.reading() as session:
            return [
                one.id
                for one in ledgers.episodes_of(session, evaluation)
                if all(getattr(one, name) == value for name, value in fields.items())
            ]


def empty(data: Path) -> FastAPI:
    """The application over a ledger without evaluations; nothing is handed out."""
    data.mkdir(parents=True, exist_ok=True)
    ledgers.opened(data).close()
    viewer_files.lay(data)
    quiet = {"workers": 0, "references": False, "smoke": False}
    return create_app(Settings(data=data, trained=data / "no-trained", **quiet))


def of_every_suite(data: Path) -> FastAPI:
    """The application over whole evaluations of two policies, of each suite."""
    app = empty(data)
    hub: Hub = app.state.hub
    ledgers.registered(hub.database, "mine")
    for suite in EVERY_SUITE:
        ledgers.evaluated(hub.database, hub.blobs, "expert", suite=suite)
        ledgers.evaluated(hub.database, hub.blobs, "mine", every_outcome(), suite=suite)
    return app


def filled(app: FastAPI, recordings: Path) -> Site:
    """The application after its ledger got evaluations in every state."""
    hub: Hub = app.state.hub
    database, store = hub.database, hub.blobs
    ledgers.evaluated(database, store, "expert")
    for name in ("mine", "slow", "broken", "late"):
        ledgers.registered(database, name)
    checkpoint = ledgers.uploaded(database, store, "seek", b"weights", TRIED)
    completed = ledgers.evaluated(database, store, "mine", every_outcome())
    recorded = recorded_run(hub, recordings)
    cancelled = _begun(hub, "slow")
    with database.writing() as session:
        lifecycle.cancel(session, session.get_one(Evaluation, cancelled))
    incomplete = _begun(hub, "broken", tasks=["search_drawer"], episodes=5)
    while _lost(hub):
        pass
    running = _begun(hub, "late")
    with database.writing() as session:
        attempt, shard = taken(session)
        lifecycle.begin(session, attempt, lifecycle.open_episodes(shard)[0])
        queued = ledgers.created(session, "mine").id
    states = (completed, running, queued, incomplete, cancelled, recorded)
    return Site(app, *states, checkpoint, *_asked_for(hub))


def _asked_for(hub: Hub) -> tuple[str, str]:
    """A batch and a webhook with a failed delivery, both the owner's; and a snapshot."""
    owner = hub.owner.user
    with hub.database.writing() as session:
        snapshots.keep(session, snapshots.content(session, "test"), "test", note=NASTY)
        items = [SMALL, {"policy": NASTY}, SMALL]
        batch = batches.begun(session, items, None, owner)
        batches.accept(batch, ledgers.created(session, **SMALL))
        batches.refuse(batch, invalid("policy", f"no policy '{NASTY}'"))
        hook = webhooks.create(
            session,
            owner,
            url="https://lab.example.org/hide",
            events=list(WebhookEvent),
            everybodys=False,
            description=NASTY,
        )
        failed = webhooks.add(session, hook, WebhookEvent.TRIAL, {"said": NASTY}, time=now())
        session.flush()
        webhooks.note(failed, Outcome(status=410), now())
        return batch.id, hook.id


def taken(session: Session) -> tuple[Attempt, Shard]:
    """The next attempt."""
    found = ledgers.leased(session)
    assert found
    return found


def every_outcome() -> Callable[[EpisodeSpec], ledgers.Outcome]:
    """Exact and every failure in turn."""
    outcomes = itertools.cycle([None, *Failure])
    return lambda _: next(outcomes)


def _begun(hub: Hub, policy: str, **wanted: object) -> str:
    """An evaluation of which the first episode is final and the first attempt lost."""
    with hub.database.writing() as session:
        evaluation = ledgers.created(session, policy, **wanted).id
        attempt, shard = taken(session)
        episode = lifecycle.open_episodes(shard)[0]
        lifecycle.begin(session, attempt, episode)
        spec = lifecycle.spec_of(episode)
        what = ledgers.result_of(spec, Failure.POLICY_ERROR, detail=NASTY)
        commit(session, hub.blobs, attempt, episode, what)
        session.flush()
        lifecycle.end_attempt(session, attempt, KILLED)
        return evaluation


def _lost(hub: Hub) -> bool:
    """Loses the next attempt; False if none waits."""
    with hub.database.writing() as session:
        found = ledgers.leased(session)
        if found:
            lifecycle.end_attempt(session, found[0], KILLED)
        return found is not None


def recorded_run(hub: Hub, folder: Path, policy: str = "expert") -> str:
    """An evaluation of one episode that was played and recorded."""
    with hub.database.writing() as session:
        wanted = {"tasks": ["push_button_times"], "episodes": 1, "split": "val"}
        evaluation = ledgers.created(session, policy, priority=100, **wanted).id
        attempt, shard = taken(session)
        [episode] = lifecycle.open_episodes(shard)
        lifecycle.begin(session, attempt, episode)
        what, file = played(lifecycle.spec_of(episode), folder, policy)
        recording = hub.blobs.put(file.read_bytes())
        what = what.model_copy(update={"recording": recording})
        commit(session, hub.blobs, attempt, episode, what)
        session.flush()
        lifecycle.end_attempt(session, attempt, None)
        return evaluation


def played(spec: EpisodeSpec, folder: Path, policy: str = "expert") -> tuple[EpisodeCommit, Path]:
    """A built-in policy's episode that also has beliefs, and its recording."""
    trace = HiddenTrace()
    job = EpisodeJob(spec, BuiltIn(policy), policy, recordings=folder)
    episode = play_once(job, trace)
    decisions = tuple(
        one.model_copy(update={"belief": believed(one.decision)}) for one in episode.decisions
    )
    result = episode.result.model_copy(update={"recording": None})
    measured = (result, trace.start, decisions, tuple(trace.changes))
    what = EpisodeCommit(
        result=measured[0],
        start=measured[1],
        decisions=measured[2],
        changes=measured[3],
        thumbnail=trace.thumbnail,
        digest=measured_digest(*measured),
    )
    return what, folder / f"{spec.name}.rrd"


def believed(decision: int) -> Belief:
    """As a policy with every kind of memory says it; from decision 5 on it counts two too few."""
    window = tuple(range(max(0, decision - 4), decision))
    older = decision > 4
    slots = [f"window {age + 1}" for age in range(len(window))] + ["anchor"] * older + ["stage"]
    weights = {slot: (2.0 if slot == "anchor" else 1.0) / (len(slots) + older) for slot in slots}
    return Belief(
        stage_count=(decision + 1) // 2 - 2 * older,
        boundary=0.08 if decision % 2 else 0.93,
        window=window,
        anchor_index=0 if older else None,
        anchor_similarity=0.83 if older else None,
        attention=tuple(
            Attention(view=view, slot=slot, weight=round(weight, 3))
            for view in ("front", "left", "top")
            for slot, weight in weights.items()
        ),
    )
