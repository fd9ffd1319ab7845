"""The loop that makes the engine do what the ledger says, and the ledger know what became of it."""

import logging
import threading
from collections.abc import Callable
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import lifecycle
from server.bell import Bell
from server.db import Database
from server.growing import GrowingRecordings
from server.models import Attempt, Decision, Episode, Evaluation, Shard, now
from server.states import AttemptState, Desired
from workers.engines.engine import Ended, Engine
from workers.policy_process import LOAD_LIMIT
from workers.protocol import AssignedEpisode, PythonPolicy, ReplayPolicy, ShardJob

logger = logging.getLogger(__name__)
EVERY = 2.0  # s between two looks, unless something happens


class Reconciler:
    """Compares ledger and engine, again and again.

    Args:
        server: address under which workers reach this server.
        slots: shards that run at a time; as many again are kept at hand.
        episode_limit: seconds of wall time for one episode, the policy's own answers apart.
        may_hand_out: asked before work is handed out; false while the disk is full.
    """

    def __init__(
        self,
        database: Database,
        engine: Engine,
        recordings: GrowingRecordings,
        bell: Bell,
        *,
        server: str,
        slots: int,
        episode_limit: float,
        may_hand_out: Callable[[], bool] = lambda: True,
    ):
        self.database = database
        self.engine = engine
        self.recordings = recordings
        self.bell = bell
        self.server = server
        self.slots = slots
        self.episode_limit = episode_limit
        self.may_hand_out = may_hand_out
        self._ended: dict[str, Ended] = {}
        self.fault: str | None = None  # why the last look failed, if it did
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="reconciler", daemon=True)

    def start(self) -> None:
        """Begins to look."""
        self._thread.start()

    def stop(self) -> None:
        """Ends after the look under way."""
        self._stopping.set()
        self.bell.reconciler.set()
        if self._thread.is_alive():
            self._thread.join(timeout=30)

    def _run(self) -> None:
        while not self._stopping.is_set():
            self.bell.reconciler.clear()
            try:
                self.look()
                self.fault = None
            except Exception as error:  # a full disk or a locked file must not end the loop
                self.fault = f"{type(error).__name__}: {error}"
                logger.exception("The reconciler failed; it tries again")
            self.bell.reconciler.wait(EVERY)

    def look(self) -> None:
        """One comparison; afterwards both sides agree."""
        present = self.engine.inventory()  # before ended(): what ends in between is in both
        self._ended |= {one.key: one for one in self.engine.ended()}
        self._end(present, self._ended)
        self._stop_unwanted(present - self._ended.keys())
        self._ended.clear()  # not before the ledger knows
        self._hand_out()

    # --- what became of attempts ---

    def _end(self, present: set[str], ended: dict[str, Ended]) -> None:
        with self.database.reading() as session:
            open_ones = session.scalars(
                select(Attempt.id).where(Attempt.state == AttemptState.OPEN)
            ).all()
        over = [key for key in open_ones if key in ended or key not in present]
        if not over:
            return
        with self.database.writing() as session:
            for key in over:
                attempt = session.get_one(Attempt, key)
                for episode in lifecycle.open_episodes(attempt.shard):
                    self.recordings.forget(episode.id)
                reason = ended[key].reason if key in ended else "its worker disappeared"
                lifecycle.end_attempt(session, attempt, reason)
                if attempt.state == AttemptState.LOST:
                    logger.warning("Attempt lost", extra={"attempt": key, "reason": reason})

    def _stop_unwanted(self, present: set[str]) -> None:
        """Stops what is cancelled, late, or unknown to the ledger."""
        with self.database.reading() as session:
            wanted = set(
                session.scalars(
                    select(Attempt.id)
                    .join(Shard)
                    .join(Evaluation)
                    .where(
                        Attempt.state == AttemptState.OPEN,
                        Attempt.deadline > now(),
                        Evaluation.desired == Desired.FINISHED,
                    )
                )
            )
        for key in present - wanted:
            self.engine.cancel(key)

    # --- what is next ---

    def _hand_out(self) -> None:
        while len(self.engine.inventory()) < 2 * self.slots and not self._stopping.is_set():
            if not self._waiting() or not self.may_hand_out():
                return
            with self.database.writing() as session:
                shard = lifecycle.next_shard(session)
                if shard is None:
                    return
                job = self._leased(session, shard)
            self.engine.submit(job.attempt, job, job.limit)

    def _waiting(self) -> bool:
        with self.database.reading() as session:
            return lifecycle.next_shard(session) is not None

    def _leased(self, session: Session, shard: Shard) -> ShardJob:
        evaluation = shard.evaluation
        version = evaluation.policy_version
        episodes = lifecycle.open_episodes(shard)
        assigned = tuple(self._assigned(session, version.spec, one) for one in episodes)
        job: dict[str, Any] = {
            "server": self.server,
            "policy": version.spec,
            "policy_name": f"{version.policy.name}@{version.number}",
            "rules": evaluation.rules,
            "recordings": evaluation.recordings,
            "episode_limit": self._limit(version.spec, episodes),
            "episodes": assigned,
        }
        draft = ShardJob.model_validate(job | {"attempt": "", "token": ""})
        attempt, token = lifecycle.lease(session, shard, engine="local", limit=draft.limit)
        return draft.model_copy(update={"attempt": attempt.id, "token": token})

    def _assigned(
        self, session: Session, spec: dict[str, Any], episode: Episode
    ) -> AssignedEpisode:
        actions = replayed(session, spec, episode) if spec["kind"] == "replay" else None
        return AssignedEpisode(id=episode.id, spec=lifecycle.spec_of(episode), actions=actions)

    def _limit(self, spec: dict[str, Any], episodes: list[Episode]) -> float:
        """Seconds after which an episode hangs; a slow policy is not to blame for that."""
        if spec["kind"] != "python":
            return self.episode_limit
        from server.episodes import budget

        answers = max(budget(episode) for episode in episodes) + 1  # and the reset
        timeout = PythonPolicy.model_validate(spec).timeout
        return self.episode_limit + LOAD_LIMIT + answers * timeout


def replayed(session: Session, spec: dict[str, Any], episode: Episode) -> tuple[Any, ...]:
    """The actions that were recorded of the same episode in the evaluation that is replayed."""
    source = ReplayPolicy.model_validate(spec).evaluation
    return tuple(
        session.scalars(
            select(Decision.action)
            .join(Episode, Decision.episode_id == Episode.id)
            .where(
                Episode.evaluation_id == source,
                Episode.task == episode.task,
                Episode.split == episode.split,
                Episode.index == episode.index,
            )
            .order_by(Decision.number)
        )
    )
