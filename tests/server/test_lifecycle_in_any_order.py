"""Whatever happens to an evaluation, in whatever order: the laws of the ledger hold."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    consumes,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from hypothesis.strategies import booleans, integers, sampled_from
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from hide_tasks import suite
from hide_tasks.contract import EpisodeSpec, Failure
from server import lifecycle
from server.blobs import Blobs
from server.commit import commit
from server.db import Database
from server.evaluations import current_sources
from server.models import Attempt, Divergence, Episode, Evaluation, Shard
from server.problems import Problem
from server.states import ENDED, AttemptState, EpisodeState, ShardState
from tests.server import ledgers
from workers.protocol import EpisodeCommit

TASKS = ["reopen_drawer", "search_drawer"]
EPISODES = 6  # per task: two shards, of five and of one
OPEN = (ShardState.PENDING, ShardState.LEASED)


@cache
def result(task: str, index: int, failure: Failure | None) -> EpisodeCommit:
    return ledgers.result_of(suite.episode(task, "test", index), failure)


def result_of(spec: EpisodeSpec, failure: Failure | None = None) -> EpisodeCommit:
    return result(spec.task, spec.index, failure)


class Life(RuleBasedStateMachine):
    """One evaluation, and everything that may happen to it; attempts are kept when they ended."""

    database: Database
    store: Blobs
    attempts = Bundle("attempts")

    @initialize()
    def create(self) -> None:
        with self.database.writing() as session:
            lifecycle.recover(session, {})  # if the example before has failed
            evaluation = ledgers.created(session, tasks=TASKS, episodes=EPISODES)
            self.evaluation = evaluation.id
        self.final: dict[str, str] = {}  # digests by episode
        self.fences: dict[str, int] = {}  # by shard

    # --- what happens ---

    @rule(target=attempts)
    def lease(self) -> str:
        with self.database.writing() as session:
            shard = lifecycle.next_shard(session)
            if shard is None:
                return ""
            assert shard.evaluation_id == self.evaluation
            assert shard.evaluation.desired == "finished"
            attempt, _ = lifecycle.lease(session, shard, engine="local")
            assert attempt.fence > self.fences.get(shard.id, 0)
            self.fences[shard.id] = attempt.fence
            return attempt.id

    @rule(attempt=attempts, place=integers(0, 4))
    def begin(self, attempt: str, place: int) -> None:
        with self.database.writing() as session:
            if found := self.found(session, attempt, place):
                self.begun(session, *found)

    @rule(attempt=attempts, place=integers(0, 4), begun=booleans())
    def commit(self, attempt: str, place: int, begun: bool) -> None:
        """Also twice, and by an attempt that is stale or never began the episode."""
        with self.database.writing() as session:
            if found := self.found(session, attempt, place):
                if begun:
                    self.begun(session, *found)
                holder, episode = found
                plays = holder.state == "open" and holder.fence == episode.fence
                allowed = plays or episode.state == EpisodeState.FINAL
                self.tried(lambda: self.committed(session, *found), allowed)

    @rule(attempt=attempts)
    def play_all(self, attempt: str) -> None:
        with self.database.writing() as session:
            for place in range(5):
                found = self.found(session, attempt, place)
                if found and found[0].state == "open" and found[1].state != "final":
                    lifecycle.begin(session, *found)
                    self.committed(session, *found)

    @rule(attempt=attempts, place=integers(0, 4))
    def commit_something_else(self, attempt: str, place: int) -> None:
        with self.database.writing() as session:
            found = self.found(session, attempt, place)
            if found and found[1].state == EpisodeState.FINAL:
                before = session.scalar(select(func.count()).select_from(Divergence))
                other = result_of(lifecycle.spec_of(found[1]), Failure.OVERCOUNT)
                answer = commit(session, self.store, *found, other)
                session.flush()
                after = session.scalar(select(func.count()).select_from(Divergence))
                assert isinstance(answer, Problem) and answer.code == "diverged"
                assert after == (before or 0) + 1

    @rule(attempt=attempts, place=integers(0, 4))
    def put_back(self, attempt: str, place: int) -> None:
        with self.database.writing() as session:
            if found := self.found(session, attempt, place):
                allowed = found[0].state == AttemptState.OPEN
                self.tried(lambda: lifecycle.put_back(session, *found, "no room"), allowed)

    @rule(attempt=consumes(attempts), reason=sampled_from([None, "it crashed"]))
    def end(self, attempt: str, reason: str | None) -> None:
        with self.database.writing() as session:
            if attempt:
                lifecycle.end_attempt(session, session.get_one(Attempt, attempt), reason)

    @rule(attempt=attempts, place=integers(0, 4))
    def end_and_speak_later(self, attempt: str, place: int) -> None:
        with self.database.writing() as session:
            if found := self.found(session, attempt, place):
                self.begun(session, *found)
                lifecycle.end_attempt(session, found[0], "it hung")
                allowed = found[1].state == EpisodeState.FINAL
                self.tried(lambda: self.committed(session, *found), allowed)

    @precondition(lambda self: self.final)
    @rule()
    def cancel(self) -> None:
        self.asked(lifecycle.cancel, not self.stands("completed"))

    @rule()
    def resume(self) -> None:
        def resume(session: Session, evaluation: Evaluation) -> None:
            lifecycle.resume(session, evaluation, current_sources())

        self.asked(resume, self.stands("incomplete"))

    @rule()
    def recover(self) -> None:
        with self.database.writing() as session:
            lifecycle.recover(session, current_sources())
            assert not session.scalars(
                select(Attempt).where(Attempt.state == AttemptState.OPEN)
            ).all()

    # --- how ---

    def found(self, session: Session, attempt: str, place: int) -> tuple[Attempt, Episode] | None:
        if not attempt:
            return None
        found = session.get_one(Attempt, attempt)
        episodes = found.shard.episodes
        return found, episodes[place % len(episodes)]

    def committed(self, session: Session, attempt: Attempt, episode: Episode) -> None:
        was_final = episode.state == EpisodeState.FINAL
        answer = commit(
            session, self.store, attempt, episode, result_of(lifecycle.spec_of(episode))
        )
        assert not isinstance(answer, Problem)
        assert answer.already == was_final
        assert episode.digest is not None
        self.final.setdefault(episode.id, episode.digest)

    def play_what_waits(self, session: Session) -> None:
        while found := ledgers.leased(session):
            attempt, shard = found
            for episode in lifecycle.open_episodes(shard):
                lifecycle.begin(session, attempt, episode)
                self.committed(session, attempt, episode)
            session.flush()
            lifecycle.end_attempt(session, attempt, None)

    def begun(self, session: Session, attempt: Attempt, episode: Episode) -> None:
        allowed = attempt.state == "open" and episode.state != EpisodeState.FINAL
        self.tried(lambda: lifecycle.begin(session, attempt, episode), allowed)

    def tried(self, what: Callable[[], None], allowed: bool) -> None:
        """Does it exactly if it is allowed."""
        try:
            what()
        except Problem as problem:
            assert not allowed and problem.status == 409
        else:
            assert allowed

    def asked(self, what: Callable[[Session, Evaluation], None], allowed: bool) -> None:
        with self.database.writing() as session:
            evaluation = session.get_one(Evaluation, self.evaluation)
            self.tried(lambda: what(session, evaluation), allowed)

    def stands(self, state: str) -> bool:
        with self.database.reading() as session:
            return session.get_one(Evaluation, self.evaluation).state == state

    # --- what always holds ---

    @invariant()
    def a_final_episode_never_changes(self) -> None:
        with self.database.reading() as session:
            found = select(Episode.id, Episode.digest).where(
                Episode.evaluation_id == self.evaluation, Episode.state == EpisodeState.FINAL
            )
            assert dict(session.execute(found).all()) == self.final

    @invariant()
    def leased_shards_and_only_they_have_an_open_attempt(self) -> None:
        with self.database.reading() as session:
            leased = select(Shard.id).where(Shard.state == ShardState.LEASED)
            held = select(Attempt.shard_id).where(Attempt.state == AttemptState.OPEN)
            assert sorted(session.scalars(leased)) == sorted(session.scalars(held))

    @invariant()
    def running_episodes_belong_to_an_open_attempt(self) -> None:
        with self.database.reading() as session:
            running = select(Episode).where(Episode.state == EpisodeState.RUNNING)
            for episode in session.scalars(running):
                assert episode.shard.state == ShardState.LEASED
                assert episode.fence == episode.shard.fence

    @invariant()
    def the_evaluation_has_ended_exactly_if_no_shard_is_open(self) -> None:
        with self.database.reading() as session:
            evaluation = session.get_one(Evaluation, self.evaluation)
            states = select(Shard.state).where(Shard.evaluation_id == self.evaluation)
            is_open = any(state in OPEN for state in session.scalars(states))
            assert (evaluation.state in ENDED) == (not is_open)
            assert (evaluation.ended is not None) == (not is_open)
            whole = len(self.final) == len(TASKS) * EPISODES
            assert evaluation.state != "completed" or whole
            assert not whole or is_open or evaluation.state == "completed"

    def teardown(self) -> None:
        """Whatever happened, it can be driven to its end; and no other evaluation waits then."""
        if not hasattr(self, "evaluation"):
            return
        with self.database.writing() as session:
            evaluation = session.get_one(Evaluation, self.evaluation)
            lifecycle.recover(session, current_sources())
            self.play_what_waits(session)
            if evaluation.state == "incomplete":
                lifecycle.resume(session, evaluation, current_sources())
                self.play_what_waits(session)
            asked_to_stop = evaluation.desired == "cancelled"
            assert evaluation.state == "completed" or asked_to_stop
            assert evaluation.state in ENDED
        self.a_final_episode_never_changes()
        self.the_evaluation_has_ended_exactly_if_no_shard_is_open()


@pytest.mark.usefixtures("on_each_database")
def test_the_laws_hold_in_any_order(tmp_path: Path) -> None:
    Life.database, Life.store = ledgers.opened(tmp_path), Blobs(tmp_path / "blobs")

    # What fails is told as it was found: with a real ledger, making it shorter takes minutes.
    limits = settings(max_examples=15, stateful_step_count=25, phases=[Phase.generate])
    run_state_machine_as_test(Life, settings=limits)

    Life.database.close()
