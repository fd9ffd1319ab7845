"""An engine that a test plays by hand, and the reports of what it runs, which may come any way."""

from dataclasses import dataclass, field
from typing import NamedTuple

from hide_tasks.contract import Failure
from tests.server import ledgers
from workers.engines.engine import Ended
from workers.protocol import INTERNAL, EpisodeCommit, ShardJob


class HandEngine:
    """Jobs run until a test says that they are over, or their time on its clock is."""

    name = "local"

    def __init__(self) -> None:
        self.clock = 0.0  # s
        self.jobs: dict[str, ShardJob] = {}
        self._deadlines: dict[str, float] = {}
        self._ended: list[Ended] = []

    def submit(self, key: str, job: ShardJob, limit: float) -> None:
        if key not in self.jobs:
            self.jobs[key] = job
            self._deadlines[key] = self.clock + limit

    def cancel(self, key: str) -> None:
        if key in self.jobs:
            self.end(key, "cancelled", cancelled=True)

    def inventory(self) -> set[str]:
        return set(self.jobs)

    def ended(self) -> list[Ended]:
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        self.jobs.clear()

    # --- by hand ---

    def end(self, key: str, reason: str | None, *, cancelled: bool = False) -> None:
        """A job is over."""
        if self.jobs.pop(key, None):
            self._ended.append(Ended(key, reason, cancelled))

    def forget(self, key: str) -> None:
        """A job vanishes without a word."""
        self.jobs.pop(key, None)

    def wait(self, seconds: float) -> None:
        """Time passes; what is late is killed, as engines do."""
        self.clock += seconds
        for key in [key for key in self.jobs if self._deadlines[key] <= self.clock]:
            self.end(key, "took longer than it may")


class Letter(NamedTuple):
    """A report on its way; it may arrive late, out of turn, and more than once."""

    attempt: str
    episode: str
    headers: dict[str, str]
    what: EpisodeCommit

    @property
    def path(self) -> str:
        """Where it goes."""
        return f"{INTERNAL}/attempts/{self.attempt}/episodes/{self.episode}/result"


@dataclass
class Player:
    """Who plays a job: it has the attempt's token."""

    job: ShardJob
    headers: dict[str, str] = field(init=False)

    def __post_init__(self) -> None:
        self.headers = {"Authorization": f"Bearer {self.job.token}"}

    def episode(self, place: int) -> str:
        """The id of an episode of the job."""
        return self.job.episodes[place % len(self.job.episodes)].id

    def path(self, episode: str, what: str) -> str:
        """Where something of an episode is reported."""
        return f"{INTERNAL}/attempts/{self.job.attempt}/episodes/{episode}/{what}"

    def result(self, episode: str, failure: Failure | None = None) -> Letter:
        """What it would send of an episode; without a failure, what every attempt sends."""
        [spec] = [one.spec for one in self.job.episodes if one.id == episode]
        what = ledgers.result_of(spec, failure)
        return Letter(self.job.attempt, episode, self.headers, what)
