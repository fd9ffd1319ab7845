"""What SEEK remembers of an episode (paper 4.1): WCM, PAM and SCM.

e episodes, v views, n = h*w cells, c channels of an entry, k of a key. Every episode has an archive
of its own, so episodes of different length share a batch and each is as if it were alone. Read
before the action, written after it, new with every episode.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from seek_model import config

TIE = 1e-6  # similarities this close are equal; the earliest entry wins


class Entry(NamedTuple):
    """One interaction, remembered."""

    decision: int
    tokens: Float[Tensor, "v n c"]  # attended to, never searched


class Keys:
    """The descriptors of an episode's entries, searched and never attended to."""

    def __init__(self) -> None:
        self._rows: Tensor | None = None
        self.count = 0
        self.total: Tensor | float = 0.0  # of all keys, for their mean

    def append(self, key: Float[Tensor, " k"]) -> None:
        """One more, kept in memory that doubles when it is full."""
        if self._rows is None:
            self._rows = key.new_zeros(16, len(key))
        if self.count == len(self._rows):
            self._rows = torch.cat([self._rows, torch.zeros_like(self._rows)])
        self._rows[self.count] = key
        self.count += 1
        self.total = self.total + key

    def similarity(
        self, key: Float[Tensor, " k"], older: int, center: bool
    ) -> Float[Tensor, " older"]:
        """The cosine of `key` with each of the first `older` keys.

        `center`: of their differences to the mean of all keys, the present one among them.
        """
        assert self._rows is not None
        rows = self._rows[:older]
        if center:
            mean = (self.total + key) / (self.count + 1)
            rows, key = rows - mean, key - mean
        found: Tensor = nn.functional.cosine_similarity(rows, key[None], dim=1)
        return found


@dataclass
class Archive:
    """All that one episode has stored, and how many stages are done."""

    entries: list[Entry] = field(default_factory=list)
    keys: Keys = field(default_factory=Keys)
    done: int = 0
    seed: int = 0  # of an anchor that is drawn at random


class Anchor(NamedTuple):
    """An older entry that the present looks back at."""

    entry: Entry
    similarity: float


class Slots(NamedTuple):
    """M_t = [W_t; m_a; S_t] (equation 2), padded to its fixed budget."""

    tokens: Float[Tensor, "e v slots n c"]  # the latest first; then the anchor
    present: Bool[Tensor, "e slots"]
    stage: Float[Tensor, "e c"]  # of the counter; without one, a learned nothing
    windows: list[list[int]]  # decisions in the window, the oldest first
    anchors: list[Anchor | None]


class WindowedContextMemory:
    """WCM: the latest `size` entries."""

    def __init__(self, size: int):
        self.size = size

    def split(self, entries: Sequence[Entry]) -> tuple[int, Sequence[Entry]]:
        """How many entries left the window, and those inside it, oldest first."""
        older = max(len(entries) - self.size, 0)
        return older, entries[older:]


class PersistentAnchorMemory:
    """PAM: of the entries that left the window, the one most like the present (equation 1)."""

    def __init__(self, select: str, center: bool):
        self._choose = {
            "cosine": self._most_similar,
            "first": self._first,
            "random": self._random,
            "oracle": self._oracle,
        }[select]
        self._center = center

    def read(
        self, archive: Archive, older: int, key: Float[Tensor, " k"], evidence: int
    ) -> Anchor | None:
        """The anchor; None if no entry left the window, or an oracle names none that did."""
        if not older:
            return None
        similarity = archive.keys.similarity(key, older, self._center)
        index = self._choose(archive, similarity, evidence)
        if index is None:
            return None
        return Anchor(archive.entries[index], float(similarity[index]))

    def _most_similar(self, archive: Archive, similarity: Tensor, evidence: int) -> int | None:
        return int((similarity >= similarity.max() - TIE).to(torch.uint8).argmax())

    def _first(self, archive: Archive, similarity: Tensor, evidence: int) -> int | None:
        return 0

    def _random(self, archive: Archive, similarity: Tensor, evidence: int) -> int | None:
        drawn = zlib.crc32(f"{archive.seed}/{len(archive.entries)}".encode())
        return drawn % len(similarity)

    def _oracle(self, archive: Archive, similarity: Tensor, evidence: int) -> int | None:
        decisions = [entry.decision for entry in archive.entries[: len(similarity)]]
        return decisions.index(evidence) if evidence in decisions else None


class StageCounterMemory(nn.Module):
    """SCM: how many stages are done, as a learned vector S_t."""

    def __init__(self, stages: int, channels: int):
        super().__init__()
        self.embedding = nn.Embedding(stages, channels)

    def forward(self, archives: Sequence[Archive]) -> Float[Tensor, "e c"]:
        last = self.embedding.num_embeddings - 1
        done = [min(archive.done, last) for archive in archives]
        found: Tensor = self.embedding(torch.tensor(done, device=self.embedding.weight.device))
        return found


class EpisodeMemory(nn.Module):
    """The three memories of every episode of a batch."""

    def __init__(self, settings: config.Memory):
        super().__init__()
        self.window = WindowedContextMemory(settings.window)
        self.anchor = (
            PersistentAnchorMemory(settings.anchor, settings.center)
            if settings.anchor != "none"
            else None
        )
        self.stage = (
            StageCounterMemory(settings.stages, settings.channels) if settings.stages else None
        )
        # Attention without a key would have other statistics at the first step (models.md D6).
        self.nothing = None if self.stage else nn.Parameter(torch.zeros(settings.channels))

    @property
    def slots(self) -> int:
        """Entries that one read can hold, whatever the archive's length."""
        return self.window.size + (self.anchor is not None)

    def read(
        self,
        archives: Sequence[Archive],
        keys: Float[Tensor, "e k"],
        empty: Float[Tensor, "v n c"],
        evidence: Sequence[int] | None = None,
    ) -> Slots:
        """What each episode's memory gives for its present key.

        Args:
            archives: one an episode.
            keys: of the present.
            empty: stands where there is no entry.
            evidence: the decision that an oracle would look back at; only an oracle reads it.
        """
        names = evidence or [-1] * len(archives)
        picked = [self._pick(*one) for one in zip(archives, keys, names, strict=True)]
        tokens, present = [], []
        for recent, anchor in picked:
            found = [entry.tokens for entry in reversed(recent)]
            found += [empty] * (self.window.size - len(found))
            if self.anchor:
                found.append(anchor.entry.tokens if anchor else empty)
            tokens += found
            present.append(self._present(len(recent), anchor is not None))
        stacked = torch.stack(tokens) if tokens else empty.new_zeros(0, *empty.shape)
        by_episode = stacked.view(len(archives), self.slots, *empty.shape) if self.slots else (
            empty.new_zeros(len(archives), 0, *empty.shape)
        )  # fmt: skip
        return Slots(
            tokens=by_episode.transpose(1, 2),
            present=torch.tensor(present, dtype=torch.bool, device=keys.device),
            stage=self._stage(archives),
            windows=[[entry.decision for entry in recent] for recent, _ in picked],
            anchors=[anchor for _, anchor in picked],
        )

    def _pick(
        self, archive: Archive, key: Tensor, evidence: int
    ) -> tuple[Sequence[Entry], Anchor | None]:
        older, recent = self.window.split(archive.entries)
        return recent, self.anchor.read(archive, older, key, evidence) if self.anchor else None

    def _present(self, recent: int, anchor: bool) -> list[bool]:
        window = [age < recent for age in range(self.window.size)]
        return window + [anchor] * (self.anchor is not None)

    def _stage(self, archives: Sequence[Archive]) -> Tensor:
        if self.stage:
            found: Tensor = self.stage(archives)
            return found
        assert self.nothing is not None
        return self.nothing.expand(len(archives), -1)


def write(
    archive: Archive, decision: int, key: Float[Tensor, " k"], tokens: Float[Tensor, "v n c"]
) -> None:
    """Remember one interaction."""
    archive.entries.append(Entry(decision, tokens))
    archive.keys.append(key)
