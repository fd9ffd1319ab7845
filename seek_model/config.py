"""What a model and its training are made of: frozen, checked, and written into every checkpoint.

A part that is off (`memory = None`, `window = 0`) is never built. No switch travels into a
`forward`: each is read once, where the part that it chooses is made.
"""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Whole = Annotated[int, Field(ge=0)]
Positive = Annotated[int, Field(gt=0)]
Layers = Annotated[int, Field(gt=0, le=100)]
Name = Annotated[str, Field(min_length=1, max_length=100)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Size = Annotated[float, Field(gt=0.0)]


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


# --- the model ----------------------------------------------------------------------------------


class Views(_Config):
    """The virtual cameras of models.md 1.3: orthographic looks at a cube of one metre."""

    count: Literal[3, 5] = 3
    size: Annotated[int, Field(gt=0, le=512)] = 64  # pixels a side
    stages: Literal[1, 2] = 2  # 2: a second, zoomed look around the coarse target
    zoom: Size = 4.0  # of the second look: a crop of 1 m / zoom
    points: Positive = 32768  # the most that are kept of one cloud
    voxel: Annotated[float, Field(ge=0.0)] = 0.005  # m; one point of a voxel is kept; 0 keeps all
    layers: Literal[1, 2] = 1  # 2: the farthest points of each view as well as the nearest
    behind: bool = False  # does the second look show what is behind its crop?


class ConvFilm(_Config):
    """A convolutional pyramid that is told the instruction at every level (small presets)."""

    kind: Literal["conv_film"] = "conv_film"
    widths: tuple[Positive, ...] = (32, 64, 128)  # channels at strides 2, 4, 8, …
    channels: Positive = 128  # of the features that memory is read into
    depth: Layers = 2  # layers of attention across the views
    heads: Positive = 4

    @property
    def stride(self) -> int:
        """Pixels a side of one feature cell."""
        return int(2 ** len(self.widths))


class PatchTransformer(_Config):
    """RVT's and RVT-2's transformer over image patches (models.md 1.4, 1.5)."""

    kind: Literal["patch_transformer"] = "patch_transformer"
    patch: Positive = 14  # pixels a side
    channels: Positive = 128  # of a token before and after the transformer
    width: Positive = 512  # inside the transformer
    depth: Layers = 8  # the first half looks within a view, the second at all
    heads: Positive = 8
    dropout: Share = 0.1
    first_conv: Whole = 0  # channels of RVT's 1x1 convolution before patches are cut; 0: none

    @property
    def stride(self) -> int:
        """Pixels a side of one feature cell."""
        return self.patch


class Sam2(_Config):
    """SAM2Act's trunk: RVT-2's transformer beside a SAM 2.1 image encoder (models.md 1.11)."""

    kind: Literal["sam2"] = "sam2"
    transformer: PatchTransformer = PatchTransformer()
    encoder: Literal["tiny", "small", "base_plus", "large", "toy"] = "base_plus"
    image: Positive = 256  # pixels a side of what the encoder sees
    lora: Whole = 16  # rank; 0: none
    weights: str = ""  # a file of Meta's SAM 2.1; empty: random

    @property
    def channels(self) -> int:
        """Of the features that memory is read into."""
        return self.transformer.channels

    @property
    def stride(self) -> int:
        """Pixels a side of one feature cell."""
        return self.transformer.patch


Backbone = Annotated[ConvFilm | PatchTransformer | Sam2, Field(discriminator="kind")]


class Language(_Config):
    """What reads the instruction."""

    kind: Literal["words", "clip", "minilm"] = "words"  # words: trained with the policy
    channels: Positive = 64  # of `words`; the others have their own (512, 384)
    tokens: Positive = 24  # of `words`; the others have their own (77, 32)
    weights: str = ""  # a file of CLIP's text encoder; minilm: empty for its package
    vocabulary: str = ""  # CLIP's file of merges
    colors: Annotated[int, Field(ge=0, le=4)] = 0  # named ones that are told with the pixels


class Memory(_Config):
    """WCM, PAM and SCM, what they store, and how they are read (paper 4.1, 4.2)."""

    window: Whole = 6  # WCM: entries; 0: none
    anchor: Literal["none", "cosine", "first", "oracle", "random"] = "cosine"  # PAM
    stages: Whole = 32  # SCM: counts that are told apart; 0: no counter
    content: Literal["visual", "proprioception"] = "visual"
    channels: Positive = 64  # of an entry
    layers: Layers = 4
    feedforward: Positive = 2048
    dropout: Share = 0.1
    gate: bool = False  # X + g (MemoryAttn(X) - X), g = 0 at first (models.md A10)
    colocation: bool = False  # a bias for the same place (models.md 4.3)
    heatmap: Literal["max", "sigmoid"] = "max"  # how logits are scaled (models.md A8)
    commit: Literal["executed", "always"] = "executed"  # what is remembered (models.md A11)
    key: Literal["trunk", "backbone"] = "trunk"  # what is pooled to a descriptor (models.md A2)
    center: bool = False  # descriptors less the episode's running mean (models.md A2)

    @model_validator(mode="after")
    def _holds_something(self) -> Self:
        if not self.window and self.anchor == "none" and not self.stages:
            raise ValueError("a memory without window, anchor and stages; write memory = none")
        return self


class Model(_Config):
    """A network, whole."""

    views: Views = Views()
    backbone: Backbone = ConvFilm()
    decoder: Literal["conv", "convex", "multires", "pyramid"] = "pyramid"
    head: Literal["rvt", "rvt2"] = "rvt2"
    language: Language = Language()
    clock: bool = False  # tells the number of the decision: a hidden counter (models.md 1.1)
    stop: bool = False  # may say that it is done
    memory: Memory | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.views.size % self.backbone.stride:
            raise ValueError(
                f"views.size = {self.views.size} is no multiple of the backbone's stride, "
                f"{self.backbone.stride}"
            )
        if self.views.stages == 1 and self.head == "rvt2":
            raise ValueError("head = rvt2 belongs to two stages; a single stage has head = rvt")
        if self.views.stages == 2 and self.head == "rvt":
            raise ValueError("head = rvt belongs to a single stage; two stages have head = rvt2")
        if (self.head == "rvt") != (self.decoder == "conv"):
            raise ValueError("head = rvt and decoder = conv belong together")
        needed = {"multires": "sam2", "pyramid": "conv_film"}.get(self.decoder)
        if needed and self.backbone.kind != needed:
            raise ValueError(f"decoder = {self.decoder} needs backbone.kind = {needed}")
        more = {
            "views.layers": self.views.layers > 1,
            "views.behind": self.views.behind,
            "language.colors": self.language.colors > 0,
        }
        for name in (name for name, on in more.items() if on and self.backbone.kind != "conv_film"):
            raise ValueError(f"{name} needs backbone.kind = conv_film")
        return self


# --- training -----------------------------------------------------------------------------------


class Augment(_Config):
    """One shift and turn a sequence, about the middle of the workspace, and other colours."""

    shift: tuple[float, float, float] = (0.05, 0.05, 0.02)  # m, either way along x, y, z
    turn: float = 15.0  # degrees, either way about the vertical
    tries: Positive = 20  # until every target is in bounds; then none at all
    colors: bool = True  # are colours that the instruction names changed, in word and picture?


class Phase(_Config):
    """One of the two stages of training."""

    steps: Whole  # where it stops; 0 leaves the phase out
    horizon: Positive  # steps to the end of the cosine
    warmup: Whole
    batch: Positive  # sequences; of one frame each in stage 1
    frames: Positive = 1  # supervised ones of a sequence
    optimizer: Literal["lamb", "adam", "adamw"] = "adamw"
    rate: Size = 1.5e-3  # at its peak
    lowest: Share = 0.01  # of the peak, at the horizon
    decay: Annotated[float, Field(ge=0.0)] = 1e-4
    clip: Annotated[float, Field(ge=0.0)] = 1.0  # of the gradient's norm; 0: none
    freeze: tuple[Literal["encoder", "all_but_memory", "fine"], ...] = ()
    loss: Literal["all", "coarse"] = "all"
    choice_weight: Size = 1.0  # of where to go when a stage begins


class Train(_Config):
    """How a model is trained; the defaults are those of the small presets."""

    tasks: tuple[str, ...] = ()  # empty: all that the data has
    start: str = ""  # a checkpoint of the first phase, which is then left out
    first: Phase = Phase(steps=5600, horizon=5600, warmup=300, batch=32)
    # Memory is read by the coarse branch alone; the fine one stays as the first phase left it.
    second: Phase = Phase(
        steps=480, horizon=480, warmup=30, batch=16, frames=7, rate=1e-3, decay=0.0,
        freeze=("encoder", "fine"), loss="coarse", choice_weight=4.0,
    )  # fmt: skip
    archive: Literal["prefix", "literal"] = "prefix"  # models.md A1: c, a
    augment: Augment = Augment()
    stage_weight: Annotated[float, Field(ge=0.0)] = 1.0  # lambda_stage
    stop_weight: Annotated[float, Field(ge=0.0)] = 1.0
    # How far the fine look is off the true target in training, along each axis, in m: as far as a
    # coarse target is, so that where the look shows nothing its middle is the best guess (normal:
    # the standard deviation); uniform: at most (RVT-2).
    zoom_noise: Annotated[float, Field(ge=0.0)] = 0.012
    zoom_draw: Literal["normal", "uniform"] = "normal"
    precision: Literal["bf16", "fp32"] = "bf16"
    ema: Share = 0.999
    save_every: Size = 180.0  # s between two checkpoints
    validate_every: Positive = 1000  # steps
    validate_episodes: Whole = 5  # a task, of split val
    seed: Whole = 0


class Config(_Config):
    """A model and its training, under a name."""

    name: Name
    model: Model = Model()
    train: Train = Train()
