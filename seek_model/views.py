"""Virtual cameras: the cloud seen along the axes of the cube, without perspective.

Pixel i covers [i, i + 1) and has its centre at i + 0.5. f frames, v views, p points, s pixels.

Points outside of the cube are not drawn, unless those behind it are asked for: a zoomed look at a
place in the air then shows what it is above. (RVT-2's renderer, whose images these follow, draws
what is behind a camera in front of all others, which in its zoomed look is most of the scene.)

A second layer shows the farthest points of the cube, as the opposite camera would see them: what is
inside a cabinet, or on the table under what is lifted.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

CHANNELS = 10  # x y z, r g b, depth, and where the pixel is: view, row, column
LAYER = 7  # more for the second layer: x y z, r g b, depth
RED = 3  # the channel within a layer where its colours begin
BEYOND = 1.5  # positions behind the cube are told as if they were no farther than this
SPLAT = 0.012  # radius of a point, in the cube (RVT-2); never less than one pixel
LEVELS = 1000  # steps of depth a unit of the cube that are told apart (RVT-2), 0.5 mm each
CHUNK = 300_000  # points that are drawn at a time: what is calculated of them fits a cache
EMPTY = torch.iinfo(torch.int64).max


class Look(NamedTuple):
    """A view: the axes of the cube (0 x, 1 y, 2 z) along the image, and their signs."""

    name: str
    right: tuple[int, int]
    down: tuple[int, int]
    forward: tuple[int, int]


LOOKS = (
    Look("top", right=(0, 1), down=(1, -1), forward=(2, -1)),
    Look("front", right=(1, 1), down=(2, -1), forward=(0, -1)),
    Look("right", right=(0, -1), down=(2, -1), forward=(1, -1)),
    Look("back", right=(1, -1), down=(2, -1), forward=(0, 1)),
    Look("left", right=(0, 1), down=(2, -1), forward=(1, 1)),
)  # the first three are RVT-2's


@dataclass(frozen=True)
class VirtualCameras:
    """The first `count` looks, drawn on `size` x `size` pixels.

    `front` stands on the x side, facing the robot; `right` and `left` are those of its image.
    """

    count: int
    size: int
    layers: int = 1  # 2: the farthest points as well
    behind: bool = False  # are points behind the cube drawn, where nothing in it is?

    @property
    def channels(self) -> int:
        """Of an image."""
        return CHANNELS + LAYER * (self.layers - 1)

    @property
    def red(self) -> tuple[int, ...]:
        """The channels where the colours of a layer begin."""
        return (RED, CHANNELS + RED)[: self.layers]

    @property
    def looks(self) -> tuple[Look, ...]:
        """In the order of the views."""
        return LOOKS[: self.count]

    def project(self, points: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n v 2"]:
        """Image positions (u right, v down) of points in the cube, in pixels, 0 to `size`."""
        columns = _along(points, [look.right for look in self.looks])
        rows = _along(points, [look.down for look in self.looks])
        pixels = (torch.stack([columns, rows]) + 1) * (self.size / 2)
        return pixels.movedim((0, 1), (-1, -2))

    @torch.no_grad()
    def render(
        self,
        points: Float[Tensor, "p 3"],
        colors: Float[Tensor, "p 3"],
        owner: Int[Tensor, " p"],
        frames: int,
    ) -> Float[Tensor, "f v c s s"]:
        """Images of the points of each frame; `colors` are 0 to 1, `owner` is a point's frame.

        Depth is in units of the cube less the mean of its image. A pixel that shows nothing has
        depth -1, position 0 and colour 0.
        """
        points, colors = points.float(), colors.float()
        sides = (self.size, self.size)
        images = points.new_empty(frames, self.count, self.channels, *sides)
        images[:, :, LAYER:CHANNELS] = self._places(points)
        table = functional.pad(torch.cat([points, colors], dim=1), (0, 0, 0, 1))
        for layer in range(self.layers):
            begin = CHANNELS * layer
            nearest = self._nearest(points, owner, frames, far=layer == 1)
            splatted = self._splatted(nearest)
            # Splats of a table would cover what lies flat on it: they fill the far layer's gaps.
            nearest = splatted if layer == 0 else torch.where(nearest == EMPTY, splatted, nearest)
            empty = nearest == EMPTY
            shown = (nearest % max(len(points), 1)).masked_fill_(empty, len(points))
            seen = table.index_select(0, shown.flatten()).view(*shown.shape, -1)
            seen = rearrange(seen, "f v h w c -> f v c h w")
            seen[:, :, :3].clamp_(-BEYOND, BEYOND)
            images[:, :, begin : begin + LAYER - 1] = seen
            images[:, :, begin + LAYER - 1] = self._depth(seen[:, :, :3], empty)
        return images

    def _nearest(
        self,
        points: Float[Tensor, "p 3"],
        owner: Int[Tensor, " p"],
        frames: int,
        *,
        far: bool,
    ) -> Int[Tensor, "f v s s"]:
        """Per pixel the least of level * p + number of a point: the nearest, then the first.

        `far`: as seen from behind, the farthest.
        """
        nearest = torch.full(
            (frames * self.count * self.size**2,), EMPTY, dtype=torch.int64, device=points.device
        )
        for first in range(0, len(points), CHUNK):
            part = slice(first, first + CHUNK)
            pixel, depth, number = self._placed(points[part], owner[part], far=far)
            keys = (depth * LEVELS).long() * len(points) + (number + first)
            nearest.scatter_reduce_(0, pixel, keys, "amin")
        return nearest.view(frames, self.count, self.size, self.size)

    def _placed(
        self, points: Float[Tensor, "p 3"], owner: Int[Tensor, " p"], *, far: bool
    ) -> tuple[Int[Tensor, " n"], Float[Tensor, " n"], Int[Tensor, " n"]]:
        """Where points are drawn, in all views, how deep, and which they are."""
        behind = self.behind and not far
        within = points.abs() <= 1
        number = (within.sum(dim=1) >= (2 if behind else 3)).nonzero()[:, 0]
        near = points.index_select(0, number)
        pixels = self.project(near).long().clamp_(min=0, max=self.size - 1)
        column, row = rearrange(pixels, "n v two -> two v n")
        depth = _along(near, [look.forward for look in self.looks]) + 1
        view = torch.arange(self.count, device=points.device)[:, None]
        image = owner.index_select(0, number) * self.count + view
        pixel = (image * self.size + row) * self.size + column
        number = number.expand_as(pixel)
        if behind:
            x, y, z = within.index_select(0, number[0]).unbind(dim=1)
            across = {0: y & z, 1: x & z, 2: x & y}  # by the axis that a view looks along
            seen = torch.stack([across[look.forward[0]] for look in self.looks]) & (depth >= 0)
            drawn = seen.flatten().nonzero()[:, 0]
            pixel, depth, number = (
                one.flatten().index_select(0, drawn) for one in (pixel, depth, number)
            )
            return pixel, depth, number
        return pixel.flatten(), (2 - depth if far else depth).flatten(), number.flatten()

    def _splatted(self, nearest: Int[Tensor, "f v s s"]) -> Int[Tensor, "f v s s"]:
        """A pixel shows the nearest of the points within a splat's radius of it."""
        result = nearest.clone()
        for down, right in _offsets(self.size):
            here, there = _overlap(down, self.size), _overlap(-down, self.size)
            to = result[:, :, here, _overlap(right, self.size)]
            source = nearest[:, :, there, _overlap(-right, self.size)]
            torch.minimum(to, source, out=to)
        return result

    def _depth(
        self, position: Float[Tensor, "f v 3 s s"], empty: Tensor
    ) -> Float[Tensor, "f v s s"]:
        forward = [look.forward for look in self.looks]
        along = [sign * position[:, view, axis] for view, (axis, sign) in enumerate(forward)]
        depth = torch.stack(along, dim=1)
        count = (~empty).sum(dim=(2, 3), keepdim=True).clamp_(min=1)
        mean = depth.sum(dim=(2, 3), keepdim=True) / count  # positions are 0 where empty
        return (depth - mean).masked_fill_(empty, -1.0)

    def _places(self, like: Tensor) -> Float[Tensor, "v 3 s s"]:
        """View, row and column of every pixel, each from -1 to 1."""
        sides = (self.count, self.size, self.size)
        steps = [torch.linspace(-1, 1, n, device=like.device) for n in sides]
        return torch.stack(torch.meshgrid(*steps, indexing="ij"), dim=1)


def _along(points: Float[Tensor, "*n 3"], axes: Sequence[tuple[int, int]]) -> Float[Tensor, "v *n"]:
    """The coordinates of the points along signed axes of the cube."""
    return torch.stack([points[..., axis] * sign for axis, sign in axes])


def _offsets(size: int) -> Iterator[tuple[int, int]]:
    """Rows and columns from a pixel to the others of its splat."""
    radius = max(1.0, SPLAT * size / 2)
    reach = range(-int(radius), int(radius) + 1)
    return (
        (row, column) for row in reach for column in reach if 0 < math.hypot(row, column) <= radius
    )


def _overlap(offset: int, size: int) -> slice:
    return slice(max(offset, 0), size + min(offset, 0))


def zoomed(
    points: Float[Tensor, "p 3"],
    owner: Int[Tensor, " p"],
    center: Float[Tensor, "f 3"],
    zoom: float,
) -> Float[Tensor, "p 3"]:
    """The points in a cube `zoom` times smaller, about the center of their frame."""
    return zoom * (points - center[owner])


def unzoomed(
    points: Float[Tensor, "*f 3"], center: Float[Tensor, "*f 3"], zoom: float
) -> Float[Tensor, "*f 3"]:
    """The place in the whole cube of positions in the zoomed one, one center each."""
    return points / zoom + center
