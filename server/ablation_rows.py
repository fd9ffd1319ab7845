"""Which ablations there are, in the paper's layout, with its figures.

What an ablation is made of comes from the presets; what was measured is found by that.
"""

from functools import cache
from typing import Literal, NamedTuple

from seek_model.presets import CLOCK, NAMES, preset
from server import facts
from server.published import published
from server.schemas.policies import PolicyFacts

Size = Literal["small", "paper"]
Published = dict[str, float]  # by category, and overall: percent

WHOLE = "seek"  # the model itself
BASE = "none"  # without memory: the backbone, SAM2Act
GROUPS = ("overall", "RC", "HSR", "EPT")
BESIDES = ("anchor_first", "anchor_oracle", "anchor_random", "archive_literal")


class Row(NamedTuple):
    """A line of a block."""

    key: str  # of the cell; several blocks may have the same one
    label: str
    against: str | None = None  # the cell that it is tested against
    published: Published | None = None
    steps: Published | None = None  # what the paper says it adds to the line before, in points


class Block(NamedTuple):
    """Lines that differ in one thing."""

    name: Literal["content", "length", "progressive", "single", "choice"]
    title: str
    rows: tuple[Row, ...]


def _figures(*numbers: float) -> Published:
    return dict(zip(GROUPS, numbers, strict=True))


def _method(name: str) -> Published:
    """What tab:main_results prints of a method."""
    [row] = [one for one in published().rows if one.method == name]
    return {"overall": row.overall, **row.categories}


_SEEK, _SAM2ACT = _method("SEEK"), _method("SAM2Act")

BLOCKS = (
    Block(
        "content",
        "Memory content",
        (
            Row("proprioception", "proprioception", WHOLE, _figures(42.5, 31.2, 41.6, 54.6)),
            Row(WHOLE, "visual features", None, _SEEK),
        ),
    ),
    Block(
        "length",
        "Memory length",
        (
            Row("length_0", "0", None, _figures(46.7, 46.4, 42.0, 51.6)),
            Row("length_2", "2", "length_0", _figures(53.7, 44.2, 51.8, 65.0)),
            Row("length_4", "4", "length_0", _figures(57.2, 48.6, 55.8, 67.2)),
            Row(WHOLE, "6", "length_0", _SEEK),
        ),
    ),
    Block(
        "progressive",
        "Components, one after the other",
        (
            Row(BASE, "none", None, _SAM2ACT),
            Row("scm", "SCM", BASE, steps={"RC": 14.0}),
            Row("scm_wcm", "SCM + WCM", "scm", steps={"EPT": 12.0}),
            Row(WHOLE, "SCM + WCM + PAM", "scm_wcm", _SEEK, steps={"HSR": 11.6}),
        ),
    ),
    Block(
        "single",
        "Components, each alone",
        (
            Row(BASE, "none", None, _SAM2ACT),
            Row("scm", "SCM", BASE),
            Row("wcm", "WCM", BASE),
            Row("pam", "PAM", BASE),
            Row(WHOLE, "all three", BASE, _SEEK),
        ),
    ),
    Block(
        "choice",
        "What PAM looks back at",
        (
            Row(WHOLE, "the most similar"),
            Row("anchor_first", "the first", WHOLE),
            Row("anchor_random", "one at random", WHOLE),
            Row("anchor_oracle", "the one that it is told", WHOLE),
            Row("archive_literal", "the most similar, trained to the letter", WHOLE),
        ),
    ),
)


def preset_of(key: str, size: Size, *, clock: bool) -> str | None:
    """The preset that `hide train` takes for a cell; None if none has its name."""
    name = {WHOLE: f"seek-{size}", BASE: f"sam2act-{size}"}.get(key, f"seek-{size}/{key}")
    return name + CLOCK * clock if name in NAMES else None


def cell_of(known: PolicyFacts) -> str | None:
    """The cell of a policy; None if it is no SEEK and not its backbone.

    A length of which there is no preset has a cell of its own: `length_3`.
    """
    base, _, ablation = known.preset.removesuffix(CLOCK).partition("/")
    model = base.rpartition("-")[0]
    if known.source != "checkpoint" or size_of(known) is None or known.window is None:
        return None
    if not known.components:
        return BASE
    if model != "seek":
        return None
    if ablation in BESIDES:
        return ablation
    made = _made_of(known)
    if made in _cells():
        return _cells()[made]
    whole = _made_of(_facts(WHOLE))
    return f"length_{known.window}" if (made[0], made[2]) == (whole[0], whole[2]) else None


def size_of(known: PolicyFacts) -> Size | None:
    """Whether it is a small SEEK or SAM2Act, or one at paper size."""
    sizes: dict[str, Size] = {
        f"{model}-{size}": size for model in ("seek", "sam2act") for size in _SIZES
    }
    return sizes.get(known.preset.removesuffix(CLOCK).partition("/")[0])


_SIZES: tuple[Size, ...] = ("small", "paper")
_Made = tuple[frozenset[str], int | None, str | None]


def _made_of(known: PolicyFacts) -> _Made:
    return frozenset(known.components), known.window, known.content


def _facts(key: str) -> PolicyFacts:
    name = preset_of(key, "small", clock=False)
    assert name
    return facts.of_config(preset(name))


@cache
def _cells() -> dict[_Made, str]:
    keys = [row.key for block in BLOCKS for row in block.rows if row.key not in (*BESIDES, BASE)]
    return {_made_of(_facts(key)): key for key in dict.fromkeys(keys)}
