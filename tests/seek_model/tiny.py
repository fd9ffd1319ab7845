"""Small configurations and made-up frames: everything the real ones have, in milliseconds."""

import torch
from torch import Tensor

from seek_model.config import Config, ConvFilm, Language, Memory, Model, Views
from seek_model.frames import Frames, Targets
from seek_model.presets import preset

POINTS = 200  # of a frame
MEMORY = Memory(window=2, channels=8, layers=1, feedforward=16, stages=8, dropout=0.0)


def tiny(name: str = "seek-small", **memory: object) -> Config:
    """A preset, reduced to a size that runs in milliseconds."""
    config = preset(name)
    views = config.model.views.model_copy(update={"size": 16, "points": 2048, "voxel": 0.01})
    small = {
        "views": views,
        "backbone": ConvFilm(widths=(8, 8), channels=16, depth=1, heads=2),
        "language": Language(channels=8, tokens=8, colors=config.model.language.colors),
    }
    if config.model.memory:
        stages = min(config.model.memory.stages, 8)
        sizes = {"channels": 8, "layers": 1, "feedforward": 16, "stages": stages}
        small["memory"] = config.model.memory.model_copy(update=sizes | memory)
    model = Model.model_validate(config.model.model_copy(update=small).model_dump())
    return config.model_copy(update={"model": model})


def tiny_model(memory: Memory | None = MEMORY, **parts: object) -> Model:
    """A small network's configuration with this memory."""
    return Model(
        views=Views(size=16, points=2048, voxel=0.01),
        backbone=ConvFilm(widths=(8, 8), channels=16, depth=1, heads=2),
        language=Language(channels=8, tokens=8),
        memory=memory,
        **parts,
    )


def frames(
    sequences: int, steps: int, present: Tensor | None = None, points: int = POINTS
) -> Frames:
    """Random frames; where nothing is present there are no points."""
    there = torch.ones(sequences, steps, dtype=torch.bool) if present is None else present
    owner = there.flatten().nonzero()[:, 0].repeat_interleave(points)
    return Frames(
        points=torch.rand(len(owner), 3) * 2 - 1,
        colors=torch.rand(len(owner), 3),
        owner=owner,
        instructions=[f"push the red button {1 + i % 5} times" for i in range(sequences)],
        fingers=torch.rand(sequences, steps, 3),
        pose=torch.rand(sequences, steps, 9),
        decision=torch.arange(steps).expand(sequences, steps).contiguous(),
        present=there,
    )


def targets(of: Frames, supervised: Tensor | None = None) -> Targets:
    """Random targets of frames."""
    shape = of.shape
    return Targets(
        position=torch.rand(*shape, 3) - 0.5,
        rotation=torch.randint(0, 72, (*shape, 3)),
        opening=torch.randint(0, 2, shape),
        ignore_collisions=torch.randint(0, 2, shape),
        stage=of.decision // 2,
        boundary=(of.decision % 2).float(),
        stop=torch.zeros(shape),
        evidence=torch.full(shape, -1),
        supervised=of.present if supervised is None else supervised,
    )


def alone(of: Frames, sequence: int) -> Frames:
    """One of the sequences by itself, without the steps that are not there."""
    steps = int(of.present[sequence].sum())
    first = int(of.present[sequence].to(torch.uint8).argmax())
    cut = of.between(first, first + steps)
    kept = cut.owner // steps == sequence
    one = slice(sequence, sequence + 1)
    return Frames(
        points=cut.points[kept],
        colors=cut.colors[kept],
        owner=cut.owner[kept] % steps,
        instructions=[of.instructions[sequence]],
        fingers=cut.fingers[one],
        pose=cut.pose[one],
        decision=cut.decision[one],
        present=cut.present[one],
    )
