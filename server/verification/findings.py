"""What a verification looked at, and what did not agree."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from server.evaluations import Counts

LONGEST = 200  # characters of a value that is told


@dataclass(frozen=True)
class Mismatch:
    """Two things that should be equal and are not."""

    subject: str  # id of the episode, evaluation or blob; name of an episode of a run
    name: str  # what a reader knows it by
    what: str
    stored: Any
    found: Any

    def __str__(self) -> str:
        where = f"{self.subject} ({self.name})" if self.name else self.subject
        stored, found = _brief(self.stored), _brief(self.found)
        return f"{where}: {self.what}: stored {stored}, found {found}"


@dataclass
class Findings:
    """Everything that one verification found."""

    mismatches: list[Mismatch] = field(default_factory=list)
    evaluations: int = 0
    episodes: int = 0  # whose digest, verdicts and spec were recomputed
    files: int = 0  # that were hashed
    removed: int = 0  # recordings that are gone to make room, and are said to be
    simulated: int = 0  # episodes that were played again
    bitwise: int = 0  # of them, on the class of machine that played them first
    unplayed: dict[str, int] = field(default_factory=dict)  # why not, and how many
    scores: dict[str, Counts] = field(default_factory=dict)  # recomputed, by evaluation

    def expect(
        self, subject: str, name: str, stored: Mapping[str, Any], found: Mapping[str, Any]
    ) -> bool:
        """Compares what both have; notes every difference, and is true if there is none."""
        different = [what for what in stored if what in found and stored[what] != found[what]]
        for what in different:
            self.note(subject, name, what, stored[what], found[what])
        return not different

    def note(self, subject: str, name: str, what: str, stored: Any, found: Any) -> None:
        """Notes a difference, once."""
        mismatch = Mismatch(subject, name, what, stored, found)
        if mismatch not in self.mismatches:
            self.mismatches.append(mismatch)

    def leave_out(self, reason: str) -> None:
        """Counts an episode that is not played again."""
        self.unplayed[reason] = self.unplayed.get(reason, 0) + 1

    @property
    def document(self) -> dict[str, Any]:
        """As JSON."""
        shown = {name: value for name, value in vars(self).items() if name != "mismatches"}
        return shown | {
            "good": not self.mismatches,
            "scores": {name: score._asdict() for name, score in self.scores.items()},
            "mismatches": [vars(one) for one in self.mismatches],
        }


def _brief(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
