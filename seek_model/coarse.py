"""The coarse branch: the whole workspace, and what is remembered (paper 4.3).

f frames, v views, d channels, h = w cells, s pixels, k of a key or a summary, c of an entry.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from seek_model import heatmaps
from seek_model.branch import Branch
from seek_model.config import Memory, Model
from seek_model.heads import ProgressHead
from seek_model.memory import Archive, EpisodeMemory, Slots, write
from seek_model.memory_attention import MemoryAttention
from seek_model.memory_encoder import MemoryEncoder
from seek_model.sam2_encoder import Sam2Encoder
from seek_model.trunk import Decoded, Seen


class Recalled(NamedTuple):
    """What a frame's decision looked back at."""

    slots: Slots
    attention: Float[Tensor, "f v slots"]


@dataclass(frozen=True)
class Teacher:
    """What training says of frames instead of the policy itself."""

    position: Float[Tensor, "f 3"]
    stage: Int[Tensor, " f"]
    evidence: Int[Tensor, " f"]


class Coarse(NamedTuple):
    """What the coarse branch says of frames."""

    decoded: Decoded
    features: Float[Tensor, "f v d h w"]  # with memory read into them
    target: Float[Tensor, "f 3"]  # its own, or the teacher's
    done: Int[Tensor, " f"]  # stages that it held to be done
    boundary: Float[Tensor, " f"] | None  # logits: a stage ends with this action
    stop: Float[Tensor, " f"] | None  # logits: the episode does
    key: Float[Tensor, "f k"] | None  # of the present
    recalled: Recalled | None


@dataclass(frozen=True)
class Pending:
    """What the decisions of some episodes leave behind, once they are carried out."""

    archives: Sequence[Archive]
    decisions: Sequence[int]
    keys: Float[Tensor, "f k"]
    tokens: Float[Tensor, "f v n c"]
    ends_stage: Sequence[bool]

    def commit(self) -> None:
        """Write memory and advance the counter."""
        parts = zip(self.archives, self.decisions, self.keys, self.tokens.unbind(), strict=True)
        for archive, decision, key, tokens in parts:
            write(archive, decision, key, tokens)
        for archive, ends in zip(self.archives, self.ends_stage, strict=True):
            archive.done += ends


class InteractionMemory(nn.Module):
    """WCM, PAM and SCM with what writes and reads them."""

    def __init__(self, settings: Memory, branch: Branch):
        super().__init__()
        trunk, size = branch.trunk, branch.cameras.size
        self.episodes = EpisodeMemory(settings)
        self.encoder = MemoryEncoder(
            trunk.channels,
            settings.channels,
            size=size,
            cells=trunk.cells,
            heatmap=settings.heatmap,
            content=settings.content,
        )
        self.attention = MemoryAttention(trunk.channels, trunk.cells, self.episodes.slots, settings)
        self.boundary = (
            ProgressHead(branch.summary_channels, settings.stages) if settings.stages else None
        )
        self._of_backbone = settings.key == "backbone"
        self._empty = (branch.cameras.count, trunk.cells**2, settings.channels)

    def keys(self, seen: Seen) -> Float[Tensor, "f k"]:
        """Descriptors: pooled before memory is read, of length 1, without gradient."""
        pooled = seen.backbone if self._of_backbone else seen.features.mean(dim=(3, 4))
        return nn.functional.normalize(pooled.detach().float().flatten(1), dim=1)

    def read(
        self, seen: Seen, keys: Tensor, archives: Sequence[Archive], evidence: Sequence[int] | None
    ) -> tuple[Tensor, Recalled]:
        """Features with memory read into them."""
        empty = seen.features.new_zeros(self._empty)
        slots = self.episodes.read(archives, keys, empty, evidence)
        remembered = self.attention(seen.features, slots)
        return remembered.features, Recalled(slots, remembered.attention)


class CoarseBranch(Branch):
    """Decides where, with memory if there is one."""

    def __init__(self, model: Model, words: int, encoder: Sam2Encoder | None):
        super().__init__(model, words, encoder)
        self.memory = InteractionMemory(model.memory, self) if model.memory else None
        self.stages = model.memory.stages if model.memory else 0
        self.stop = ProgressHead(self.summary_channels, self.stages) if model.stop else None

    def decide(
        self,
        seen: Seen,
        archives: Sequence[Archive],
        *,
        teacher: Teacher | None = None,
        own_place: bool = True,
    ) -> Coarse:
        """One decision of each frame's episode.

        Args:
            seen: the frames, before memory.
            archives: of their episodes; empty without a memory.
            teacher: if given, says how many stages are done.
            own_place: the heads look at the branch's own target, not at the teacher's.
        """
        features, keys, recalled = seen.features, None, None
        if self.memory:
            keys = self.memory.keys(seen)
            evidence = _taught(archives, teacher)
            features, recalled = self.memory.read(seen, keys, archives, evidence)
        decoded = self.decoder(features, seen.skips)
        target = None if own_place or teacher is None else teacher.position
        if target is None:
            target = heatmaps.decode(decoded.logits.detach().float(), self.cameras)
        done = torch.tensor([archive.done for archive in archives], device=target.device)
        summary = self.summary(features, target)
        boundary = self.memory.boundary if self.memory else None
        return Coarse(
            decoded=decoded,
            features=features,
            target=target,
            done=done,
            boundary=boundary(summary, done) if boundary else None,
            stop=self.stop(summary, done) if self.stop else None,
            key=keys,
            recalled=recalled,
        )

    def leave(
        self,
        seen: Seen,
        said: Coarse,
        archives: Sequence[Archive],
        body: Float[Tensor, "f 10"],
        decisions: Sequence[int],
    ) -> Pending | None:
        """What decisions leave behind, from what was seen before memory was read.

        Args:
            seen, said: the frames and what was decided.
            archives: of their episodes.
            body: pose and opening.
            decisions: numbers of the decisions in their episodes.
        """
        if self.memory is None or said.key is None:
            return None
        tokens = self.memory.encoder(seen.features, said.decoded.logits, body)
        ends = [False] * len(archives)
        if said.boundary is not None:
            ends = (said.boundary > 0).tolist()
        return Pending(archives, decisions, said.key, tokens, ends)


def _taught(archives: Sequence[Archive], teacher: Teacher | None) -> list[int] | None:
    if teacher is None:
        return None
    for archive, done in zip(archives, teacher.stage.tolist(), strict=True):
        archive.done = done
    return [int(index) for index in teacher.evidence.tolist()]


def joined(parts: Sequence[Coarse], kept: Bool[Tensor, " f"]) -> Coarse:
    """The rows of several steps that are kept, one after the other; what was recalled is not."""

    def rows(values: Sequence[Tensor | None]) -> Tensor | None:
        there = [value for value in values if value is not None]
        return torch.cat(there)[kept] if there else None

    def must(values: Sequence[Tensor | None]) -> Tensor:
        found = rows(values)
        assert found is not None
        return found

    return Coarse(
        decoded=Decoded(
            must([part.decoded.logits for part in parts]),
            rows([part.decoded.local for part in parts]),
        ),
        features=must([part.features for part in parts]),
        target=must([part.target for part in parts]),
        done=must([part.done for part in parts]),
        boundary=rows([part.boundary for part in parts]),
        stop=rows([part.stop for part in parts]),
        key=rows([part.key for part in parts]),
        recalled=parts[0].recalled if len(parts) == 1 else None,
    )
