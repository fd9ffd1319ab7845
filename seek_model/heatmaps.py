"""Where to go, as one heat map a view, and back to a point of the cube.

f frames, v views, s pixels. Pixel i covers [i, i + 1) and has its centre at i + 0.5; the centres
of the pixels are the projections of the centres of a grid of s^3 voxels. (RVT's grid falls on the
corners of its pixels, which is why it averages four of them.)
"""

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from seek_model.views import VirtualCameras

SIGMA = 1.5  # pixels (RVT)
TRUNCATED = 3.0  # sigma from the middle to where a target ends (RVT)
BESIDE = (-1, 0, 1)  # voxels along an axis
CHUNK = 1_000_000  # voxels whose scores are held at a time: 4 MB, which a cache can hold


def target(
    pixels: Float[Tensor, "*f v 2"], size: int, sigma: float = SIGMA
) -> Float[Tensor, "*f v {size} {size}"]:
    """A round Gaussian about each image position (u, v) in pixels; each view sums to 1.

    A view whose image it does not reach is 0 throughout, and so takes no part in the loss.
    """
    centers = torch.arange(size, device=pixels.device, dtype=pixels.dtype) + 0.5
    squares = (centers - pixels[..., None]) ** 2  # *f v 2 s
    distance = squares[..., 1, :, None] + squares[..., 0, None, :]
    bell = torch.exp(distance / (-2 * sigma**2))
    bell = bell.masked_fill(distance > (TRUNCATED * sigma) ** 2, 0.0)
    total = bell.sum(dim=(-2, -1), keepdim=True)
    return bell / total.masked_fill(total == 0, 1.0)


def loss(
    logits: Float[Tensor, "*f v s s"], target: Float[Tensor, "*f v s s"]
) -> Float[Tensor, "*f"]:
    """Cross-entropy over the pixels of a view, the mean over the views."""
    likely = functional.log_softmax(logits.float().flatten(-2), dim=-1)
    return -(target.flatten(-2) * likely).sum(dim=-1).mean(dim=-1)


@torch.no_grad()
def decode(logits: Float[Tensor, "f v s s"], cameras: VirtualCameras) -> Float[Tensor, "f 3"]:
    """The voxel centre, in the cube, where the mean of the views' softmaxed maps is highest.

    A view that looks along an axis says the same of all voxels along it, so that the score of a
    voxel is the sum of one value of each of three maps, whatever the number of views.
    """
    maps = torch.softmax(logits.float().flatten(-2), dim=-1).view_as(logits)
    return (_voxel(_folded(maps, cameras)) + 0.5) * (2 / cameras.size) - 1


@torch.no_grad()
def peak(logits: Float[Tensor, "f v s s"], cameras: VirtualCameras) -> Float[Tensor, "f 3"]:
    """The place, in the cube, of the bell whose top is at the voxel that `decode` finds.

    The logarithm of a Gaussian is a parabola: along each axis the one through the voxel and its
    two neighbours, summed over the views that see the axis, tells where between them the top is,
    at most half a voxel away.
    """
    logits = logits.float()
    voxel = _voxel(_folded(torch.softmax(logits.flatten(-2), dim=-1).view_as(logits), cameras))
    zy, zx, yx = (functional.pad(plane, (1, 1, 1, 1), mode="replicate")
                  for plane in _folded(logits, cameras))  # fmt: skip
    x, y, z = (voxel + 1).unbind(dim=-1)
    frame = torch.arange(len(voxel), device=voxel.device)
    lines = [
        [zx[frame, z, x + step] + yx[frame, y, x + step] for step in BESIDE],
        [zy[frame, z, y + step] + yx[frame, y + step, x] for step in BESIDE],
        [zy[frame, z + step, y] + zx[frame, z + step, x] for step in BESIDE],
    ]
    beside = torch.stack([_top(*line) for line in lines], dim=-1)
    return (voxel + 0.5 + beside) * (2 / cameras.size) - 1


def _top(before: Tensor, here: Tensor, after: Tensor) -> Tensor:
    """Where the parabola through three values at -1, 0 and 1 is highest; 0 if it opens upwards."""
    bend = 2 * here - before - after
    found = (after - before) / (2 * bend.clamp(min=1e-6))
    return torch.where(bend > 1e-6, found.clamp(-0.5, 0.5), torch.zeros_like(found))


def _voxel(planes: tuple[Tensor, Tensor, Tensor]) -> Int[Tensor, "f 3"]:
    """The highest voxel, x y z, of the sums of three planes (f s s)."""
    zy, zx, yx = planes
    size = yx.shape[-1]
    depth = max(1, CHUNK // (len(yx) * size**2))
    starts = range(0, size, depth)
    best = [_highest(zy[:, z : z + depth], zx[:, z : z + depth], yx) for z in starts]
    values, places = (torch.stack(parts) for parts in zip(*best, strict=True))  # chunk f
    chunk = values.argmax(dim=0)
    voxel = places.gather(0, chunk[None])[0] + chunk * depth * size**2
    return torch.stack([voxel % size, voxel // size % size, voxel // size**2], dim=-1)


def at(
    features: Float[Tensor, "f v c h w"], pixels: Float[Tensor, "f v 2"], size: int
) -> Float[Tensor, "f v c"]:
    """Features at image positions given in pixels of an image of `size`, bilinear.

    A cell's value belongs to its centre; beyond the outermost centres nothing changes.
    """
    grid = rearrange(pixels, "f v two -> (f v) 1 1 two") * (2 / size) - 1
    maps = rearrange(features, "f v c h w -> (f v) c h w").float()
    sampled = functional.grid_sample(maps, grid.float(), padding_mode="border", align_corners=False)
    return sampled.view(*features.shape[:3]).to(features.dtype)


def _folded(
    maps: Float[Tensor, "f v s s"], cameras: VirtualCameras
) -> tuple[Tensor, Tensor, Tensor]:
    """The sums of the views of each plane, (f s s) along the axes z y, z x and y x."""
    planes = {plane: torch.zeros_like(maps[:, 0]) for plane in ((2, 1), (2, 0), (1, 0))}
    for view, look in enumerate(cameras.looks):
        (down, down_sign), (right, right_sign) = look.down, look.right
        backwards = [dim for dim, sign in ((1, down_sign), (2, right_sign)) if sign < 0]
        planes[down, right] += maps[:, view].flip(backwards)
    zy, zx, yx = planes.values()
    return zy, zx, yx


def _highest(
    zy: Float[Tensor, "f z s"], zx: Float[Tensor, "f z s"], yx: Float[Tensor, "f s s"]
) -> tuple[Tensor, Tensor]:
    """The highest score of each frame and its place in z y x order, for some z."""
    scores = (zy[..., None] + zx[:, :, None]).add_(yx[:, None])
    value, place = scores.flatten(1).max(dim=1)
    return value, place
