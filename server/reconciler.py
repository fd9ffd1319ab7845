"""The loop that makes the engine do what the ledger says, and the ledger know what became of it."""

import logging
import threading
from collections.abc import Callable

from sqlalchemy import select
from sqlalchemy.orm import Session

from server import lifecycle
from server.bell import Bell
from server.db import Database
from server.growing import GrowingRecordings
from server.models import Attempt, Evaluation, Shard
from server.states import AttemptState, Desired
from workers.engines.engine import Ended, Engine
from workers.protocol import ShardJob

logger = logging.getLogger(__name__)
EVERY = 2.0  # s between two looks, unless something happens


class Reconciler:
    """Compares ledger and engine, again and again.

    Args:
        slots: how many shards run at a time, now; as many again are kept at hand.
        draft: the job of a shard, attempt and token apart; raises ValueError if it has none.
        may_hand_out: asked before work is handed out; false while the disk is full.
    """

    def __init__(
        self,
        database: Database,
        engine: Engine,
        recordings: GrowingRecordings,
        bell: Bell,
        *,
        slots: Callable[[], int],
        draft: Callable[[Session, Shard], ShardJob],
        may_hand_out: Callable[[], bool] = lambda: True,
    ):
        self.database = database
        self.engine = engine
        self.recordings = recordings
        self.bell = bell
        self.slots = slots
        self.draft = draft
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
        self.database.claim()
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
        """Stops what is cancelled or unknown to the ledger; what is late is the engine's affair."""
        with self.database.reading() as session:
            wanted = set(
                session.scalars(
                    select(Attempt.id)
                    .join(Shard)
                    .join(Evaluation)
                    .where(
                        Attempt.state == AttemptState.OPEN,
                        Evaluation.desired == Desired.FINISHED,
                    )
                )
            )
        for key in present - wanted:
            self.engine.cancel(key)

    # --- what is next ---

    def _hand_out(self) -> None:
        while len(self.engine.inventory()) < 2 * self.slots() and not self._stopping.is_set():
            if not self._waiting() or not self.may_hand_out():
                return
            with self.database.writing() as session:
                shard = lifecycle.next_shard(session)
                if shard is None:
                    return
                job = self._lease(session, shard)
            if job:
                self.engine.submit(job.attempt, job, job.limit)

    def _waiting(self) -> bool:
        with self.database.reading() as session:
            return lifecycle.next_shard(session) is not None

    def _lease(self, session: Session, shard: Shard) -> ShardJob | None:
        """What the engine is to run; None if the shard cannot be played, which fails it."""
        try:
            draft = self.draft(session, shard)
        except ValueError as error:
            lifecycle.fail_shard(session, shard, str(error))
            return None
        attempt, token = lifecycle.lease(session, shard, engine=self.engine.name)
        return draft.model_copy(update={"attempt": attempt.id, "token": token})
