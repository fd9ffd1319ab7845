"""Every model of the paper by name, small and at paper size, with its ablations.

`seek-small` is a model, `seek-small/scm` one of its ablations; `+clock` after either tells the
policy the number of the decision. The published codebases do that in every model; it is a hidden
counter, so here it is a row of its own (models.md A12).
"""

import difflib
from collections.abc import Callable
from typing import Literal

from seek_model.config import (
    Augment,
    Config,
    Language,
    Memory,
    Model,
    PatchTransformer,
    Phase,
    Sam2,
    Train,
    Views,
)

CLOCK = "+clock"

# --- small: from scratch, on two processor cores ---

_SMALL = Model(stop=True, views=Views(zoom=8.0, layers=2, behind=True), language=Language(colors=2))
_SMALL_MEMORY = Memory(layers=2, feedforward=256, channels=48, dropout=0.0, colocation=True)

# --- paper: SEEK's table of hyperparameters, RVT's and SAM2Act's configurations ---

_CLIP = Language(kind="clip")
_RVT = Model(
    views=Views(count=5, size=220, stages=1, points=65_536, voxel=0.0),
    backbone=PatchTransformer(patch=11, first_conv=64),
    decoder="conv",
    head="rvt",
    language=_CLIP,
)
_RVT2 = Model(
    views=Views(size=224, points=65_536, voxel=0.0),
    backbone=PatchTransformer(),
    decoder="convex",
    language=_CLIP,
)
_SAM2ACT = _RVT2.model_copy(update={"backbone": Sam2(), "decoder": "multires"})

# --- ablations: what is written besides K, PAM and SCM ---

ABLATIONS: dict[str, dict[str, object]] = {
    # content (table 2)
    "proprioception": {"content": "proprioception"},
    # length (table 2): K; 6 is the model itself
    "length_0": {"window": 0},
    "length_2": {"window": 2},
    "length_4": {"window": 4},
    # components, singly (figure)
    "scm": {"window": 0, "anchor": "none"},
    "wcm": {"anchor": "none", "stages": 0},
    "pam": {"window": 0, "stages": 0},
    # components, progressively: none is sam2act, the first is scm, the last the model itself
    "scm_wcm": {"anchor": "none"},
    # how the anchor is chosen (ours; models.md A3)
    "anchor_first": {"anchor": "first"},
    "anchor_oracle": {"anchor": "oracle"},
    "anchor_random": {"anchor": "random"},
    # the protocol to the letter: nothing is older than the window in training (models.md A1)
    "archive_literal": {},
}


def _small(name: str, **model: object) -> Config:
    return Config(name=name, model=_SMALL.model_copy(update=model))


def _rvt_small() -> Config:
    views = _SMALL.views.model_copy(update={"count": 5, "stages": 1})
    return _small("rvt-small", views=views, decoder="conv", head="rvt")


def _sam2act_plus_small() -> Config:
    memory = _SMALL_MEMORY.model_copy(update={"window": 9, "anchor": "none", "stages": 0})
    second = _two_small().second.model_copy(
        update={"frames": 10, "freeze": ("all_but_memory",), "loss": "coarse"}
    )
    config = _small("sam2act_plus-small", memory=memory)
    return config.model_copy(update={"train": _two_small().model_copy(update={"second": second})})


def _two_small() -> Train:
    return Train()


def _paper(name: str, model: Model, train: Train) -> Config:
    published = {
        "ema": 0.0,
        "augment": Augment(shift=(0.125, 0.125, 0.125), turn=45.0, colors=False),
        "zoom_noise": 0.05,
        "zoom_draw": "uniform",
    }
    return Config(name=name, model=model, train=train.model_copy(update=published))


def _rvt_train(
    *, batch: int, rate: float, steps: int, decay: float, precision: Literal["bf16", "fp32"]
) -> Train:
    first = Phase(
        steps=steps, horizon=steps, warmup=2000, batch=batch, optimizer="lamb", rate=rate,
        decay=decay, clip=0.0,
    )  # fmt: skip
    return Train(first=first, second=_NONE, precision=precision)


_NONE = Phase(steps=0, horizon=1, warmup=0, batch=1)
_SEEK_FIRST = Phase(
    steps=57_140, horizon=114_280, warmup=2000, batch=56, optimizer="lamb", rate=7e-4, clip=0.0
)
_SEEK_SECOND = Phase(
    steps=3575, horizon=7150, warmup=250, batch=64, frames=7, optimizer="adam", rate=2e-4,
    decay=0.0, clip=0.0, freeze=("encoder",),
)  # fmt: skip
_SEEK_TRAIN = Train(first=_SEEK_FIRST, second=_SEEK_SECOND)
_PLUS_TRAIN = Train(
    # 56.25k steps of 256 frames, then 20 epochs of 160,000 frames in sequences of ten, 32 a step
    first=Phase(
        steps=56_250, horizon=56_250, warmup=2000, batch=256, optimizer="lamb", rate=3.2e-3,
        clip=0.0,
    ),
    second=Phase(
        steps=10_000, horizon=10_000, warmup=2000, batch=32, frames=10, optimizer="lamb",
        rate=4e-4, clip=0.0, freeze=("all_but_memory",), loss="coarse",
    ),
)  # fmt: skip
_PLUS_MEMORY = Memory(window=9, anchor="none", stages=0, heatmap="sigmoid")

_MAKERS: dict[str, Callable[[], Config]] = {
    "rvt-small": _rvt_small,
    "rvt2-small": lambda: _small("rvt2-small", decoder="convex"),
    "sam2act-small": lambda: _small("sam2act-small"),
    "sam2act_plus-small": _sam2act_plus_small,
    "seek-small": lambda: _small("seek-small", memory=_SMALL_MEMORY),
    "rvt-paper": lambda: _paper(
        "rvt-paper",
        _RVT,
        _rvt_train(batch=24, rate=2.4e-3, steps=100_000, decay=1e-6, precision="fp32"),
    ),
    "rvt2-paper": lambda: _paper(
        "rvt2-paper",
        _RVT2,
        _rvt_train(batch=192, rate=2.4e-3, steps=80_000, decay=1e-4, precision="bf16"),
    ),
    "sam2act-paper": lambda: _paper(
        "sam2act-paper", _SAM2ACT, _PLUS_TRAIN.model_copy(update={"second": _NONE})
    ),
    "sam2act_plus-paper": lambda: _paper(
        "sam2act_plus-paper", _SAM2ACT.model_copy(update={"memory": _PLUS_MEMORY}), _PLUS_TRAIN
    ),
    "seek-paper": lambda: _paper(
        "seek-paper", _SAM2ACT.model_copy(update={"memory": Memory()}), _SEEK_TRAIN
    ),
}
MODELS = tuple(_MAKERS)
NAMES = (
    *MODELS,
    *(f"{model}/{row}" for model in ("seek-small", "seek-paper") for row in ABLATIONS),
)


def preset(name: str) -> Config:
    """The configuration of a name in NAMES, or of one with `+clock` after it.

    Raises:
        ValueError: there is none; it names the nearest.
    """
    base = name.removesuffix(CLOCK)
    if base not in NAMES:
        near = difflib.get_close_matches(base, NAMES, n=1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise ValueError(
            f"No preset '{name}'.{hint} Presets: {', '.join(NAMES)}; each with {CLOCK}."
        )
    made, _, row = base.partition("/")
    config = _MAKERS[made]()
    if row:
        config = _ablated(config, row)
    if name.endswith(CLOCK):
        model = config.model.model_copy(update={"clock": True})
        config = config.model_copy(update={"model": model})
    return Config.model_validate(config.model_dump() | {"name": name})


def _ablated(config: Config, row: str) -> Config:
    assert config.model.memory
    memory = config.model.memory.model_copy(update=ABLATIONS[row])
    archive = "literal" if row == "archive_literal" else config.train.archive
    return config.model_copy(
        update={
            "model": config.model.model_copy(update={"memory": memory}),
            "train": config.train.model_copy(update={"archive": archive}),
        }
    )
