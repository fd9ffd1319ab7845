"""The fine branch: the neighbourhood of the coarse target, closely. It reads no memory."""

from typing import NamedTuple

from jaxtyping import Float, Int
from torch import Tensor, nn

from seek_model import heatmaps
from seek_model.branch import Branch
from seek_model.config import ConvFilm, Model
from seek_model.heads import ConditionalHead, Said
from seek_model.sam2_encoder import Sam2Encoder
from seek_model.trunk import Words
from seek_model.views import unzoomed, zoomed


class Fine(NamedTuple):
    """What the fine branch says of frames."""

    logits: Float[Tensor, "f v s s"]
    center: Float[Tensor, "f 3"]  # of its look, in the whole cube
    said: Said


class FineBranch(Branch):
    """Decides where exactly, and the rest of the action."""

    def __init__(self, model: Model, words: int, encoder: Sam2Encoder | None):
        super().__init__(model, words, encoder)
        features = self.summary_channels
        # A batch's statistics would make a frame depend on its neighbours; RVT-2 has them so.
        small = isinstance(model.backbone, ConvFilm)
        norm = nn.LayerNorm(features) if small else nn.BatchNorm1d(features)
        self.head = ConditionalHead(features, norm)
        self.zoom = model.views.zoom

    def decide(
        self,
        points: Float[Tensor, "p 3"],
        colors: Float[Tensor, "p 3"],
        owner: Int[Tensor, " p"],
        words: Words,
        fingers: Float[Tensor, "f q"],
        center: Float[Tensor, "f 3"],
        named: Float[Tensor, "f n 4"] | None,
        taught: tuple[Float[Tensor, "f 3"], Int[Tensor, "f 3"]] | None = None,
    ) -> Fine:
        """The action about `center`; `taught` is the true position and rotation, in training.

        `named` are the colours of the instructions, if they are told.
        """
        near = zoomed(points, owner, center, self.zoom)
        images = self.images(near, colors, owner, len(center), named)
        seen = self.trunk(images, words, fingers)
        logits = self.decoder(seen.features, seen.skips).logits
        if taught:
            place, rotation = self.zoom * (taught[0] - center), taught[1]
        else:
            place, rotation = heatmaps.decode(logits.detach().float(), self.cameras), None
        return Fine(logits, center, self.head(self.summary(seen.features, place), rotation))

    def position(self, fine: Fine) -> Float[Tensor, "f 3"]:
        """Where exactly, in the whole cube."""
        near = heatmaps.peak(fine.logits.detach(), self.cameras)
        return unzoomed(near, fine.center, self.zoom)
