"""What `results.json` holds: which run it is, and one result per finished episode."""

from collections.abc import Iterable
from datetime import UTC, datetime

from pydantic import BaseModel, ConfigDict

from hide_tasks import ALL_TASKS
from hide_tasks.contract import EpisodeResult, Rules, Split
from hide_tasks.machine import fingerprint
from workers.sandbox.choice import Sandbox


class Results(BaseModel):
    """What `results.json` holds."""

    model_config = ConfigDict(extra="ignore")

    policy: str
    checkpoint: str | None = None  # SHA-256 of the policy's file, if it is one
    remote: dict[str, str | int | bool | list[str]] | None = None  # what its server said
    suite: str
    version: int
    split: Split
    rules: Rules
    tasks: list[str]
    budgets: dict[str, int]  # decisions an episode may take, per task
    sources: dict[str, str] = {}  # per task, the code that its episodes were played by
    planned: dict[str, int]  # episodes asked for, per task: the first so many of the split
    indices: list[int] = []  # or these of each task, if any are named
    sandboxes: list[Sandbox] = []  # that were around the policy's process, if it had one
    machine: dict[str, str] = {}
    created: str = ""
    episodes: list[EpisodeResult] = []
    digests: dict[str, str] = {}  # per episode, SHA-256 of its result and decisions
    recording_hashes: dict[str, str] = {}  # SHA-256 of each recording, by its path in the folder

    def same_run(self, other: "Results") -> str | None:
        """Why episodes of these two may not stand in one file; None if they may."""
        # A checkpoint is what is in its file, wherever that lies.
        same = "checkpoint" if self.checkpoint and other.checkpoint else "policy"
        for field in (same, "suite", "version", "split", "rules"):
            if getattr(self, field) != getattr(other, field):
                return f"{field} {getattr(self, field)}, not {getattr(other, field)}"
        if self.indices != other.indices:
            return f"{self._chosen}, not {other._chosen}"
        if self.remote and other.remote:
            for field in ("dialect", "model"):
                if self.remote[field] != other.remote[field]:
                    return f"{field} {self.remote[field]}, not {other.remote[field]}"
        for task in set(self.budgets) & set(other.budgets):
            if self.budgets[task] != other.budgets[task]:
                return f"a budget of {self.budgets[task]} for {task}, not {other.budgets[task]}"
        for task in set(self.sources) & set(other.sources):
            if self.sources[task] != other.sources[task]:
                return f"another version of {task}'s sources"
        return None

    @property
    def _chosen(self) -> str:
        named = ", ".join(map(str, self.indices))
        return f"episodes {named} of each task" if named else "the first episodes of each task"

    def dated(self) -> "Results":
        """These results, begun now on this machine."""
        now = datetime.now(UTC).isoformat("T", "seconds")
        return self.model_copy(update={"machine": fingerprint(), "created": now})

    def grown(self, wanted: "Results") -> "Results":
        """These results with the tasks and episodes that another run wants as well."""
        planned = {
            task: max(self.planned.get(task, 0), wanted.planned.get(task, 0))
            for task in in_order({*self.tasks, *wanted.tasks})
        }
        changes = {
            "tasks": list(planned),
            "planned": planned,
            "budgets": {task: (self.budgets | wanted.budgets)[task] for task in planned},
            "sources": self.sources | wanted.sources,
            "sandboxes": sorted({*self.sandboxes, *wanted.sandboxes}),
        }
        return self.model_copy(update=changes)

    def with_episode(self, result: EpisodeResult) -> "Results":
        """These results and one more episode, in order."""
        episodes = [*self.episodes, result]
        place = {task: number for number, task in enumerate(self.tasks)}
        episodes.sort(key=lambda episode: (place[episode.task], episode.index))
        return self.model_copy(update={"episodes": episodes})

    def sealed(self, name: str, digest: str, recordings: dict[str, str]) -> "Results":
        """These results with what tells later whether an episode was changed."""
        changes = {
            "digests": self.digests | {name: digest},
            "recording_hashes": self.recording_hashes | recordings,
        }
        return self.model_copy(update=changes)

    @property
    def complete(self) -> bool:
        """True when every episode that was asked for is there."""
        return len(self.episodes) >= sum(self.planned.values())

    @property
    def finished(self) -> set[tuple[str, int]]:
        """(task, index) of every episode."""
        return {(episode.task, episode.index) for episode in self.episodes}


def in_order(tasks: Iterable[str]) -> list[str]:
    """Tasks in the order of the catalogue."""
    place = {task: number for number, task in enumerate(ALL_TASKS)}
    return sorted(tasks, key=lambda task: (place.get(task, len(place)), task))
