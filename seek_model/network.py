"""A policy's network, whole: the coarse branch with its memory, then the fine branch.

Training and play run the same steps in the same order. They differ in who says where and how many
stages are done: the demonstration or the network itself.
e sequences of t steps; f frames that are there, ordered by step, then by sequence.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from typing import NamedTuple, Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import Parameter

from seek_model import named_colors
from seek_model.clip_text import ClipText
from seek_model.clouds import SCALE
from seek_model.coarse import Coarse, CoarseBranch, Pending, Teacher, joined
from seek_model.config import Language, Model, Sam2
from seek_model.fine import Fine, FineBranch
from seek_model.frames import Frames, Targets
from seek_model.heads import JointHead, Said
from seek_model.language import WordReader
from seek_model.lora import lora_parameters
from seek_model.memory import Archive
from seek_model.minilm import MiniLM
from seek_model.sam2_trunk import make_encoder
from seek_model.trunk import Seen, Words
from seek_model.upsampling import ConvDecoder

CLOCK_STEPS = 24  # decisions from the clock's first value, 1, to its last, -1 (models.md 1.1)


class _Parametrised(Protocol):
    def parameters(self) -> Iterator[Parameter]: ...


class Rows(NamedTuple):
    """Which frames: those that are there, ordered by step, then by sequence."""

    sequence: Int[Tensor, " f"]
    step: Int[Tensor, " f"]


class Predictions(NamedTuple):
    """What a network says of frames: all of them in play, the supervised ones in training."""

    rows: Rows  # of the frames that were given
    coarse: Coarse
    fine: Fine | None
    said: Said | None
    position: Float[Tensor, "f 3"] | None  # the final one, in the cube; in play only


class Network(nn.Module):
    """The network of a configuration."""

    def __init__(self, model: Model):
        super().__init__()
        self.model = model
        self.language = make_language(model.language)
        encoder = make_encoder(model.backbone) if isinstance(model.backbone, Sam2) else None
        words = self.language.channels
        self.coarse = CoarseBranch(model, words, encoder)
        self.fine = FineBranch(model, words, encoder) if model.views.stages == 2 else None
        self.head = None if self.fine else JointHead(self._joint_features())

    def begin(self, episodes: int, seeds: Sequence[int] = ()) -> list[Archive]:
        """Empty memories of new episodes; the seeds tell an anchor's that is drawn at random."""
        return [Archive(seed=seed) for seed in seeds or range(episodes)]

    def forward(
        self,
        frames: Frames,
        targets: Targets,
        *,
        zoom_noise: float = 0.0,
        zoom_draw: str = "normal",
        coarse_only: bool = False,
    ) -> Predictions:
        """What it says of the supervised frames of sequences, each with a memory of its own.

        Steps before the first that is supervised only fill memory: no gradient goes through what
        was seen in them, but the encoder of memory learns from what is read of them.

        Args:
            frames: the sequences.
            targets: what the demonstrations did; it tells the counts of stages.
            zoom_noise: m, how far the fine look is off the true target along an axis: a standard
                deviation, or at most, if `zoom_draw` is `uniform`.
            zoom_draw: `normal`, cut at three deviations, or `uniform`.
            coarse_only: leave out the fine branch.
        """
        archives = self.begin(frames.shape[0], self._drawn(frames.shape[0]))
        first = int(targets.supervised.any(dim=0).to(torch.uint8).argmax())
        if first and self.coarse.memory:
            past = frames.between(0, first), targets.between(0, first)
            for _, pending in self._steps(past[0], archives, past[1], learn=False):
                _commit(pending)
        steps = frames.shape[1]
        frames, targets = frames.between(first, steps), targets.between(first, steps)
        parts = []
        for coarse, pending in self._steps(frames, archives, targets, learn=True):
            _commit(pending)
            parts.append(coarse)
        rows = _rows(frames)
        kept = targets.supervised[rows.sequence, rows.step]
        coarse = joined(parts, kept)
        rows = Rows(rows.sequence[kept], rows.step[kept])
        whole = Rows(rows.sequence, rows.step + first)
        true = targets.at(rows.sequence, rows.step)
        if coarse_only:
            return Predictions(whole, coarse, None, None, None)
        if self.fine is None:
            said = self._joint(coarse, true.rotation)
            return Predictions(whole, coarse, None, said, None)
        noise = _noise(true.position, zoom_draw)
        center = true.position + noise * zoom_noise * SCALE
        fine = self._look_closely(frames, rows, center, (true.position, true.rotation))
        return Predictions(whole, coarse, fine, fine.said, None)

    @torch.no_grad()
    def play(
        self, frames: Frames, archives: Sequence[Archive], targets: Targets | None = None
    ) -> tuple[Predictions, Pending | None]:
        """One decision of every episode, and what it leaves behind: `commit` that to go on.

        Args:
            frames: one step, of all of the episodes that `archives` belong to.
            archives: what each remembers.
            targets: if given, tells how many stages are done; nothing else of it is read.
        """
        ((coarse, pending),) = self._steps(frames, archives, targets, learn=False, play=True)
        rows = _rows(frames)
        if self.fine is None:
            said = self._joint(coarse, None)
            return Predictions(rows, coarse, None, said, coarse.target), pending
        fine = self._look_closely(frames, rows, coarse.target, None)
        place = self.fine.position(fine)
        return Predictions(rows, coarse, fine, fine.said, place), pending

    def parts(self) -> dict[str, list[Parameter]]:
        """Parameters by part; those of an image encoder's LoRA are in `lora` alone."""
        branches = [branch for branch in (self.coarse, self.fine) if branch]
        encoders = {id(b.trunk.encoder): b.trunk.encoder for b in branches if b.trunk.encoder}
        found = {
            "encoder": _parameters(encoders.values()),
            "lora": list(lora_parameters(self)),
            "memory": _parameters(self._of_memory()),
            "coarse_decoder": _parameters([self.coarse.decoder]),
            "language": _parameters([self.language]),
            "fine": _parameters([part for part in (self.fine, self.head) if part]),
        }
        taken = {id(p) for part in found.values() for p in part}
        found["coarse"] = [p for p in self.coarse.parameters() if id(p) not in taken]
        for name in ("fine", "encoder"):
            others = {id(p) for part in ("encoder", "lora") if part != name for p in found[part]}
            found[name] = [p for p in found[name] if id(p) not in others]
        return found

    def _of_memory(self) -> list[nn.Module]:
        """What sees features with memory in them alone: the say that it is done is told anew."""
        parts = (self.coarse.memory, self.coarse.stop) if self.coarse.memory else ()
        return [part for part in parts if part is not None]

    def _drawn(self, episodes: int) -> list[int]:
        """New seeds of anchors that are drawn at random."""
        memory = self.model.memory
        random = memory is not None and memory.anchor == "random"
        return torch.randint(2**31, (episodes,)).tolist() if random else []

    # --- its steps ---

    def _steps(
        self,
        frames: Frames,
        archives: Sequence[Archive],
        targets: Targets | None,
        *,
        learn: bool,
        play: bool = False,
    ) -> Iterator[tuple[Coarse, Pending | None]]:
        """The coarse branch's decisions, step by step; all at once where nothing is remembered."""
        rows = _rows(frames)
        with nullcontext() if learn else torch.no_grad():
            seen = self._see(frames, rows)
        for part in _by_step(rows, frames.shape[1], together=self.coarse.memory is None):
            now, at = _sliced(seen, part), Rows(rows.sequence[part], rows.step[part])
            own = [archives[i] for i in at.sequence.tolist()]
            teacher = _teacher(targets, at) if targets else None
            with nullcontext() if learn else torch.no_grad():
                said = self.coarse.decide(now, own, teacher=teacher, own_place=play)
            # Even in a past without gradient the encoder of memory keeps its own.
            decisions = frames.decision[at.sequence, at.step].tolist()
            yield said, self.coarse.leave(now, said, own, _body(frames, at), decisions)

    def _see(self, frames: Frames, rows: Rows) -> Seen:
        owner, shown = _owners(frames, rows)
        points, colors = frames.points[shown], frames.colors[shown]
        named = self._named(frames, rows)
        images = self.coarse.images(points, colors, owner, len(rows.step), named)
        words = self._words(frames, rows)
        return self.coarse.trunk(images, words, self._fingers(frames, rows))

    def _words(self, frames: Frames, rows: Rows) -> Words:
        read = self.language(frames.instructions)
        return Words(*(part[rows.sequence] for part in read))

    def _named(self, frames: Frames, rows: Rows) -> Float[Tensor, "f n 4"] | None:
        if not self.model.language.colors:
            return None
        told = named_colors.named(frames.instructions, self.model.language.colors)
        return told.to(rows.sequence.device)[rows.sequence]

    def _fingers(self, frames: Frames, rows: Rows) -> Float[Tensor, "f p"]:
        fingers = frames.fingers[rows.sequence, rows.step]
        if not self.model.clock:
            return fingers
        time = 1 - 2 * frames.decision[rows.sequence, rows.step] / CLOCK_STEPS
        return torch.cat([fingers, time[:, None].to(fingers.dtype)], dim=-1)

    def _look_closely(
        self, frames: Frames, rows: Rows, center: Tensor, taught: tuple[Tensor, Tensor] | None
    ) -> Fine:
        assert self.fine
        owner, shown = _owners(frames, rows)
        points, colors = frames.points[shown], frames.colors[shown]
        words, fingers = self._words(frames, rows), self._fingers(frames, rows)
        named = self._named(frames, rows)
        return self.fine.decide(points, colors, owner, words, fingers, center, named, taught)

    def _joint_features(self) -> int:
        decoder = self.coarse.decoder
        assert isinstance(decoder, ConvDecoder), "a single stage has RVT's decoder"
        return self.coarse.cameras.count * (self.coarse.trunk.channels + decoder.local_channels)

    def _joint(self, coarse: Coarse, true: Tensor | None) -> Said:
        """RVT's features: each view's strongest, and those where its heat map is."""
        assert self.head
        local, logits = coarse.decoded.local, coarse.decoded.logits
        assert local is not None
        heat = torch.softmax(logits.detach().float().flatten(-2), dim=-1).view_as(logits)
        there = torch.einsum("fvhw,fvuhw->fvu", heat.to(local.dtype), local)
        strongest = coarse.features.amax(dim=(3, 4))
        said: Said = self.head(torch.cat([strongest, there], dim=-1).flatten(1), true)
        return said


def parameter_counts(model: Model) -> dict[str, int]:
    """How many parameters each part of a network has, frozen ones too; nothing is allocated."""
    with torch.device("meta"):
        parts = Network(model).parts()
    counts = {name: sum(one.numel() for one in found) for name, found in parts.items()}
    return {name: count for name, count in counts.items() if count}


def make_language(settings: Language) -> WordReader | ClipText | MiniLM:
    """The reader of instructions."""
    if settings.kind == "clip":
        return ClipText(settings.weights, settings.vocabulary)
    if settings.kind == "minilm":
        return MiniLM(settings.weights)
    return WordReader(settings)


def _noise(like: Tensor, draw: str) -> Tensor:
    if draw == "uniform":
        return torch.rand_like(like) * 2 - 1
    return torch.randn_like(like).clamp(-3, 3)


# --- frames as rows ---


def _rows(frames: Frames) -> Rows:
    step, sequence = frames.present.T.nonzero(as_tuple=True)
    return Rows(sequence, step)


def _by_step(rows: Rows, steps: int, *, together: bool) -> Iterator[slice]:
    if together:
        yield slice(0, len(rows.step))
        return
    ends = torch.bincount(rows.step, minlength=steps).cumsum(dim=0).tolist()
    for start, end in zip([0, *ends], ends, strict=False):
        if end > start:
            yield slice(start, end)


def _sliced(seen: Seen, part: slice) -> Seen:
    views = seen.features.shape[1]
    skips = tuple(skip[part.start * views : part.stop * views] for skip in seen.skips)
    return Seen(seen.features[part], skips, seen.backbone[part])


def _owners(frames: Frames, rows: Rows) -> tuple[Tensor, Tensor | slice]:
    """The rows of points, and which points have one."""
    sequences, steps = frames.shape
    row = rows.sequence.new_full((sequences * steps,), -1)
    row[rows.sequence * steps + rows.step] = torch.arange(len(rows.step), device=row.device)
    owner = row.index_select(0, frames.owner)
    shown = owner >= 0
    return (owner, slice(None)) if shown.all() else (owner[shown], shown)


def _body(frames: Frames, rows: Rows) -> Float[Tensor, "f 10"]:
    pose = frames.pose[rows.sequence, rows.step]
    return torch.cat([pose, frames.fingers[rows.sequence, rows.step, :1]], dim=-1)


def _teacher(targets: Targets, rows: Rows) -> Teacher:
    at = rows.sequence, rows.step
    return Teacher(targets.position[at], targets.stage[at], targets.evidence[at])


def _commit(pending: Pending | None) -> None:
    if pending:
        pending.commit()


def _parameters(modules: Iterable[_Parametrised]) -> list[Parameter]:
    return [parameter for module in modules for parameter in module.parameters()]
