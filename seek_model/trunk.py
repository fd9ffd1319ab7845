"""What a trunk and a decoder are: images to features, and features to heat maps.

f frames, v views, c channels of a pixel, s pixels a side, d channels, h = w cells a side,
e sequences, l words.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from jaxtyping import Bool, Float
from torch import Tensor, nn


class Words(NamedTuple):
    """An instruction, read."""

    tokens: Float[Tensor, "e l d"]
    mask: Bool[Tensor, "e l"]  # True where a word is
    pooled: Float[Tensor, "e d"]


class Seen(NamedTuple):
    """What a trunk makes of frames, before any memory is read."""

    features: Float[Tensor, "f v d h w"]
    skips: tuple[Tensor, ...]  # (f*v c h w), the finest first
    backbone: Float[Tensor, "f v k"]  # features of the image encoder alone, pooled


class Decoded(NamedTuple):
    """Heat maps."""

    logits: Float[Tensor, "f v s s"]
    local: Float[Tensor, "f v u s s"] | None = None  # features of every pixel (RVT)


class _Module(Protocol):
    def parameters(self) -> Iterator[nn.Parameter]: ...


class Trunk(_Module, Protocol):
    """Images, instruction and fingers to features."""

    channels: int  # d
    cells: int  # h = w
    backbone_channels: int  # k

    @property
    def skip_channels(self) -> tuple[int, ...]:
        """Of `Seen.skips`."""

    @property
    def encoder(self) -> nn.Module | None:
        """The part that sees single views; stage 2 freezes it."""

    def __call__(
        self,
        images: Float[Tensor, "f v c s s"],
        words: Words,
        fingers: Float[Tensor, "f p"],
    ) -> Seen:
        """The features of frames; `words` has one row a frame."""


class Decoder(_Module, Protocol):
    """Features to heat maps."""

    def __call__(self, features: Float[Tensor, "f v d h w"], skips: tuple[Tensor, ...]) -> Decoded:
        """One heat map a view, in logits."""
