"""The ledger behind its real server: reports in any order, dead engines, a clock that jumps.

What is asked goes over HTTP, what runs is compared by the real reconciler; the engine and the
network between are played by hand, so that they do everything that real ones may.
"""

from collections import Counter
from contextlib import ExitStack
from datetime import timedelta
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import Phase, settings
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    initialize,
    invariant,
    multiple,
    precondition,
    rule,
    run_state_machine_as_test,
)
from hypothesis.strategies import integers, sampled_from
from sqlalchemy import func, select

from hide_tasks.contract import Failure
from server import jobs, models
from server.lifecycle import spec_of
from server.models import Attempt, Divergence, Episode, Evaluation, Event, Shard, read_clock
from server.reconciler import Reconciler
from server.states import ENDED, MOVES, AttemptState, EpisodeState, EvaluationState, ShardState
from tests.server.clients import API, client, hub_of
from tests.server.hands import HandEngine, Letter, Player
from tests.server.ledgers import result_of
from workers.protocol import EPISODE_FINAL, EpisodeCommit

TASKS = ["reopen_drawer"]
EPISODES = 6  # two shards, of five and of one
MOST = 2  # evaluations at a time
RESTARTS = 2
TERMINAL = {
    Evaluation: (EvaluationState.COMPLETED, EvaluationState.CANCELLED),
    Shard: (ShardState.DONE, ShardState.CANCELLED),
    Attempt: (AttemptState.DONE, AttemptState.LOST, AttemptState.CANCELLED),
    Episode: (EpisodeState.FINAL,),
}


class Server(RuleBasedStateMachine):
    """A server, what it was asked for, and whatever may happen to it."""

    players = Bundle("players")  # of every job that was ever handed out
    letters = Bundle("letters")
    evaluations = Bundle("evaluations")

    @initialize()
    def start(self) -> None:
        self.stack = ExitStack()
        self.data = Path(self.stack.enter_context(TemporaryDirectory())) / "data"
        self.ahead = timedelta()  # of the machine's clock
        models.clock = lambda: read_clock() + self.ahead
        self.engine, self.restarts = HandEngine(), 0
        self.known: set[str] = set()  # keys that were ever handed out
        self.asked: list[str] = []
        self.kept: dict[str, tuple[Any, ...]] = {}  # final episodes, as they were committed
        self.over: dict[str, str] = {}  # terminal states, by id
        self.divergences = 0
        self.open()

    def open(self) -> None:
        """Starts the server on what is on the disk."""
        self.running = ExitStack()
        self.client = self.running.enter_context(client(self.data))
        hub = hub_of(self.client)
        self.database = hub.database
        draft = partial(
            jobs.draft,
            store=hub.blobs,
            server="http://127.0.0.1",
            episode_limit=60.0,
            allow_python=False,
        )
        self.reconciler = Reconciler(
            hub.database, self.engine, hub.recordings, hub.bell, slots=lambda: 1, draft=draft
        )

    # --- what people do ---

    @precondition(lambda self: len(self.asked) < MOST)
    @rule(target=evaluations, priority=integers(0, 1))
    def create(self, priority: int) -> str:
        wanted = {"policy": "noop", "tasks": TASKS, "episodes": EPISODES, "priority": priority}
        key = {"Idempotency-Key": f"key {len(self.asked)}"}
        answers = [self.client.post(f"{API}/evaluations", json=wanted, headers=key) for _ in "12"]
        assert answers[0].status_code == 202, answers[0].text
        [id] = {answer.json()["id"] for answer in answers}
        self.asked.append(id)
        return str(id)

    @rule(evaluation=evaluations)
    def cancel(self, evaluation: str) -> None:
        completed = self.state(Evaluation, evaluation) == EvaluationState.COMPLETED
        answer = self.client.post(f"{API}/evaluations/{evaluation}/cancellation")
        assert answer.status_code == (409 if completed else 202), answer.text

    @rule(evaluation=evaluations)
    def retry(self, evaluation: str) -> None:
        resumes = self.state(Evaluation, evaluation) == EvaluationState.INCOMPLETE
        answer = self.client.post(f"{API}/evaluations/{evaluation}/resumption")
        assert answer.status_code == (202 if resumes else 409), answer.text

    # --- what the server and its engine do ---

    @rule(target=players)
    def look(self) -> Any:
        self.reconciler.look()
        self.agree()
        new = self.engine.jobs.keys() - self.known
        self.known |= new
        return multiple(*[Player(self.engine.jobs[key]) for key in sorted(new)])

    @rule(player=players, reason=sampled_from([None, "it crashed"]))
    def end(self, player: Player, reason: str | None) -> None:
        self.engine.end(player.job.attempt, reason)

    @rule(player=players)
    def vanish(self, player: Player) -> None:
        self.engine.forget(player.job.attempt)

    @rule(seconds=sampled_from([10.0, 400.0, 4000.0]))
    def expire(self, seconds: float) -> None:
        self.engine.wait(seconds)

    @rule(days=sampled_from([-4000, -1, 1, 4000]))
    def jump(self, days: int) -> None:
        """The machine's clock is set; from then on it is so far off."""
        self.ahead = timedelta(days=days)

    @precondition(lambda self: self.restarts < RESTARTS)
    @rule()
    def restart(self) -> None:
        """The server stops, and with it all that it ran; another one finds its ledger."""
        self.restarts += 1
        self.engine = HandEngine()
        self.running.close()
        self.open()
        with self.database.reading() as session:
            assert not session.scalars(select(Attempt).filter_by(state=AttemptState.OPEN)).all()

    # --- what workers report ---

    @rule(player=players, place=integers(0, 4))
    def begin(self, player: Player, place: int) -> None:
        episode = player.episode(place)
        final = self.state(Episode, episode) == EpisodeState.FINAL
        answer = self.client.post(player.path(episode, "start"), headers=player.headers)
        if not self.is_open(player.job.attempt):
            assert (answer.status_code, answer.json()["code"]) == (409, "stale_attempt")
        elif final:
            assert (answer.status_code, answer.json()["code"]) == (409, EPISODE_FINAL)
        else:
            assert answer.status_code == 204

    @rule(target=letters, player=players, place=integers(0, 4))
    def finish(self, player: Player, place: int) -> Letter:
        """An episode is played; its result is on its way."""
        return player.result(player.episode(place))

    @rule(letter=letters)
    def arrive(self, letter: Letter) -> None:
        """A result arrives: the first time or again, in turn or not, of whatever attempt."""
        self.send(letter)

    @rule(player=players)
    def play_all(self, player: Player) -> None:
        for assigned in player.job.episodes:
            if self.is_open(player.job.attempt) and self.state(Episode, assigned.id) != "final":
                path = player.path(assigned.id, "start")
                assert self.client.post(path, headers=player.headers).status_code == 204
                self.send(player.result(assigned.id))

    @rule(player=players, place=integers(0, 4))
    def report_something_else(self, player: Player, place: int) -> None:
        """What is final is reported with another result."""
        episode = player.episode(place)
        if self.state(Episode, episode) == EpisodeState.FINAL:
            letter = player.result(episode, Failure.OVERCOUNT)
            answer = self.put(letter)
            assert (answer.status_code, answer.json()["code"]) == (409, "diverged")
            self.divergences += 1

    @rule(player=players, place=integers(0, 4))
    def fail(self, player: Player, place: int) -> None:
        path = player.path(player.episode(place), "fault")
        allowed = self.is_open(player.job.attempt)
        answer = self.client.post(path, json={"reason": "no room"}, headers=player.headers)
        assert answer.status_code == (204 if allowed else 409)

    # --- how ---

    def put(self, letter: Letter) -> Any:
        headers = letter.headers | {"Content-Type": "application/json"}
        return self.client.put(letter.path, content=letter.what.model_dump_json(), headers=headers)

    def send(self, letter: Letter) -> None:
        """Sends a result, and knows what is answered."""
        with self.database.reading() as session:
            episode = session.get_one(Episode, letter.episode)
            attempt = session.get_one(Attempt, letter.attempt)
            final = episode.state == EpisodeState.FINAL
            plays = attempt.state == AttemptState.OPEN and attempt.fence == episode.fence
        answer = self.put(letter)
        if final:
            assert (answer.status_code, answer.json()) == (200, {"already": True})
        elif plays:
            assert (answer.status_code, answer.json()) == (200, {"already": False})
        else:
            assert (answer.status_code, answer.json()["code"]) == (409, "stale_attempt")

    def state(self, table: type[Any], id: str) -> str:
        with self.database.reading() as session:
            return str(session.get_one(table, id).state)

    def is_open(self, attempt: str) -> bool:
        return self.state(Attempt, attempt) == AttemptState.OPEN

    def agree(self) -> None:
        """After a look, what the ledger has handed out and what runs are the same."""
        with self.database.reading() as session:
            wanted = set(session.scalars(select(Attempt.id).filter_by(state=AttemptState.OPEN)))
        # What was cancelled just now has ended, which the next look tells the ledger.
        assert self.engine.inventory() <= wanted
        stopped = {one.key for one in self.engine._ended if one.cancelled}
        assert wanted - stopped == self.engine.inventory()

    # --- what always holds ---

    @invariant()
    def what_is_committed_never_changes(self) -> None:
        columns = (Episode.digest, Episode.fence, Episode.committed, Episode.exact)
        with self.database.reading() as session:
            rows = session.execute(select(Episode.id, *columns).filter_by(state="final"))
            now = {id: tuple(rest) for id, *rest in rows}
        assert self.kept.items() <= now.items()
        self.kept = now

    @invariant()
    def what_is_over_stays_over(self) -> None:
        now: dict[str, str] = {}
        with self.database.reading() as session:
            for table, states in TERMINAL.items():
                rows = select(table.id, table.state).where(table.state.in_(states))
                now |= dict(session.execute(rows).all())
        assert self.over.items() <= now.items()
        self.over = now

    @invariant()
    def one_attempt_at_most_ends_a_shard(self) -> None:
        with self.database.reading() as session:
            shards = session.scalars(select(Shard)).all()
            attempts = session.scalars(select(Attempt)).all()
        by_state = Counter((one.shard_id, one.state) for one in attempts)
        fences = {shard.id: shard.fence for shard in shards}
        numbers = Counter(one.shard_id for one in attempts)
        for shard in shards:
            assert by_state[shard.id, "open"] == (shard.state == ShardState.LEASED)
            assert by_state[shard.id, "done"] == (shard.state == ShardState.DONE)
            assert fences[shard.id] == numbers[shard.id]

    @invariant()
    def the_counts_agree(self) -> None:
        for id in self.asked:
            told = self.client.get(f"{API}/evaluations/{id}").json()
            with self.database.reading() as session:
                rows = select(Episode.state, func.count()).filter_by(evaluation_id=id)
                counted = dict(session.execute(rows.group_by(Episode.state)).all())
            progress = told["progress"]
            assert progress["expected"] == sum(counted.values()) == EPISODES
            assert progress["final"] == counted.get("final", 0)
            assert progress["running"] == counted.get("running", 0)
            assert (told["state"] in ENDED) == (told["ended"] is not None)
            if progress["final"] == EPISODES:
                assert told["state"] in ("running", "completed")
            else:
                assert told["state"] != "completed"

    @invariant()
    def every_divergence_is_noted(self) -> None:
        with self.database.reading() as session:
            assert session.scalar(select(func.count(Divergence.id))) == self.divergences

    # --- and in the end ---

    def teardown(self) -> None:
        """Whatever happened, it comes to its end by itself, with the scores of a quiet run."""
        if not hasattr(self, "stack"):
            return
        with self.stack:
            try:
                self.come_to_an_end()
            finally:
                models.clock = read_clock
                self.running.close()

    def come_to_an_end(self) -> None:
        for _ in range(12):
            self.reconciler.look()
            for key, job in list(self.engine.jobs.items()):
                self.play_all(Player(job))
                self.engine.end(key, None)
            for id in self.asked:
                if self.state(Evaluation, id) == EvaluationState.INCOMPLETE:
                    self.retry(id)
        for law in (
            self.what_is_committed_never_changes,
            self.what_is_over_stays_over,
            self.one_attempt_at_most_ends_a_shard,
            self.the_counts_agree,
            self.events_tell_of_legal_moves,
        ):
            law()
        for id in self.asked:
            assert self.state(Evaluation, id) in (self.over.get(id), EvaluationState.COMPLETED)
            self.scores_are_those_of_a_quiet_run(id)

    def events_tell_of_legal_moves(self) -> None:
        with self.database.reading() as session:
            told = session.scalars(select(Event).filter_by(kind="evaluation").order_by(Event.seq))
            states: dict[str, list[str]] = {}
            for event in told:
                states.setdefault(event.evaluation_id, []).append(event.payload["state"])
        for seen in states.values():
            for before, after in pairwise(seen):
                assert after in MOVES[EvaluationState][before]

    def scores_are_those_of_a_quiet_run(self, evaluation: str) -> None:
        with self.database.reading() as session:
            for episode in session.scalars(select(Episode).filter_by(evaluation_id=evaluation)):
                if episode.state == EpisodeState.FINAL:
                    assert episode.digest == quiet(episode).digest


def quiet(episode: Episode) -> EpisodeCommit:
    """What is measured of an episode where nothing goes wrong."""
    return result_of(spec_of(episode))


@pytest.mark.slow
def test_the_laws_hold_behind_the_server() -> None:
    limits = settings(max_examples=10, stateful_step_count=30, phases=[Phase.generate])
    run_state_machine_as_test(Server, settings=limits)
