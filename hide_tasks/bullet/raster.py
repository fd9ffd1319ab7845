"""Colour, metric depth and instance ids of several cameras in one call, on the CPU.

PyBullet's own renderers are 10 to 30 times slower and off by half a pixel. The kernels run in
one thread and without fast-math, and use only operations that IEEE 754 rounds exactly, so that
equal meshes, poses and cameras give equal bits in every process and on every machine.

Triangles are drawn with homogeneous edge functions (Olano and Greer 1997): the edges of a face
are planes through the camera, so that nothing needs clipping and 1/depth is affine in the pixel.
Colour comes afterwards, once a pixel.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hide_tasks.bullet.cameras import Camera, looking
from hide_tasks.bullet.meshes import BoolArray, ByteArray, FloatArray, IntArray, Mesh
from hide_tasks.bullet.raster_draw import Frame, Placed, Shapes, draw, place
from hide_tasks.bullet.raster_shade import LIGHTS, Lighting, ShadowMap, shade

Kind = TypeVar("Kind", bound=np.generic)

NO_INSTANCE = -1  # id of the background

SHADOW_CENTRE = np.array([0.15, 0.0, 0.95])  # m, world: what the shadow map covers
SHADOW_RADIUS = 0.80  # m


class Images(NamedTuple):
    """Pictures of c cameras of h x w pixels."""

    rgb: ByteArray  # (c, h, w, 3)
    depth: NDArray[np.float32]  # (c, h, w), m along the optical axis; background: far
    ids: IntArray  # (c, h, w), index of the instance or NO_INSTANCE


class Renderer:
    """Draws a fixed set of instances at ever new poses; one thread at a time."""

    def __init__(
        self,
        instances: Sequence[Mesh],
        colors: ByteArray | None = None,
        *,
        lighting: Lighting | None = None,
        shadow_pixels: int = 256,
    ) -> None:
        """Takes one mesh per instance; the same mesh may come several times.

        `colors` (n, 3) multiply the meshes' own, which are white where a mesh has none.
        `shadow_pixels` is the width of the shadow map; 0 draws no shadows.
        """
        self.colors = _checked_colors(colors, len(instances))
        self._shapes = _concatenated(instances)
        self._owner = np.append(self._shapes.instance, np.int32(NO_INSTANCE))
        self._scratch = _Scratch.of(self._shapes)
        self._lighting = _normalised(lighting or Lighting())
        self._shadows = _shadow_map(self._lighting.to_sun, max(shadow_pixels, 1))
        self._has_shadows = shadow_pixels > 0

    def render(
        self,
        cameras: Sequence[Camera],
        poses: FloatArray,
        *,
        colors: ByteArray | None = None,
        visible: BoolArray | None = None,
        supersample: int = 1,
    ) -> Images:
        """Images of all cameras, which must be of one size.

        `poses` (n, 4, 4) are the instances' in the world; `colors` (n, 3) replace those given to
        the constructor, for this call; instances with a false `visible` (n,) are neither seen
        nor cast shadows. `supersample` smooths the colours of a picture, not depth or ids.

        Raises:
            ValueError: the number of poses, colours or flags is not that of the instances, or
                the cameras differ in size.
        """
        count = len(self.colors)
        tints = self.colors if colors is None else _checked_colors(colors, count)
        shown = np.ones(count, dtype=np.bool_) if visible is None else visible
        shown = _checked("visible", np.asarray(shown, dtype=np.bool_), (count,))
        placed = self._scratch.placed
        poses = _checked("poses", np.asarray(poses, dtype=np.float64), (count, 4, 4))
        place(self._shapes, poses, placed)
        if self._has_shadows:
            self._cast_shadows(shown)
        images = _empty_images(cameras)
        for index, camera in enumerate(cameras):
            frame = self._draw(camera, shown)
            np.divide(1.0, frame.closeness, out=images.depth[index], casting="same_kind")
            np.take(self._owner, frame.face, out=images.ids[index], mode="wrap")
            if supersample == 1:
                self._shade(camera, frame, tints, images.rgb[index])
            else:
                fine = _enlarged(camera, supersample)
                picture = np.empty((fine.height, fine.width, 3), dtype=np.uint8)
                self._shade(fine, self._draw(fine, shown), tints, picture)
                images.rgb[index] = _averaged(picture, supersample)
        return images

    def _cast_shadows(self, shown: BoolArray) -> None:
        view, height = self._shadows
        frame = self._frame(*height.shape)._replace(closeness=height)
        self._fill(frame, view, (0.5, -np.inf, np.inf), shown)

    def _draw(self, camera: Camera, shown: BoolArray) -> Frame:
        frame = self._frame(camera.height, camera.width)
        limits = (camera.near, 1.0 / camera.far, 1.0 / camera.near)
        self._fill(frame, _pinhole_view(camera), limits, shown)
        return frame

    def _fill(
        self, frame: Frame, view: FloatArray, limits: tuple[float, float, float], shown: BoolArray
    ) -> None:
        scratch = self._scratch
        draw(
            self._shapes,
            scratch.placed,
            shown,
            view,
            *limits,
            scratch.corners,
            scratch.pixels,
            frame,
        )

    def _shade(self, camera: Camera, frame: Frame, tints: ByteArray, rgb: ByteArray) -> None:
        scratch, rays = self._scratch, _rays(camera)
        shade(
            self._shapes,
            scratch.placed,
            tints,
            frame,
            rays,
            self._lighting,
            self._shadows,
            scratch.lights,
            rgb,
        )

    def _frame(self, height: int, width: int) -> Frame:
        size, scratch = (height, width), self._scratch
        closeness, face = np.empty(size), np.empty(size, dtype=np.int32)
        return Frame(closeness, face, scratch.drawn, scratch.weights)


class _Scratch(NamedTuple):
    """Memory that is written anew for every call or picture."""

    placed: Placed
    corners: FloatArray
    pixels: IntArray
    drawn: BoolArray
    weights: FloatArray
    lights: FloatArray

    @staticmethod
    def of(shapes: Shapes) -> "_Scratch":
        points, faces = len(shapes.vertices), len(shapes.faces)
        return _Scratch(
            Placed(
                np.empty((points, 3)), np.empty((points, 3)), np.empty((len(shapes.spheres), 4))
            ),
            np.empty((points, 6)),
            np.empty((points, 2), dtype=np.int32),
            np.empty(faces, dtype=np.bool_),
            np.empty((faces, 9)),
            np.empty((faces, LIGHTS)),
        )


def _concatenated(instances: Sequence[Mesh]) -> Shapes:
    """The instances' meshes, one after the other."""
    vertex = np.cumsum([0] + [len(mesh.vertices) for mesh in instances]).astype(np.int32)
    face = np.cumsum([0] + [len(mesh.faces) for mesh in instances]).astype(np.int32)
    moved = [mesh.faces + first for mesh, first in zip(instances, vertex, strict=False)]
    return Shapes(
        vertices=np.concatenate([mesh.vertices for mesh in instances], dtype=np.float64),
        normals=np.concatenate([mesh.normals for mesh in instances], dtype=np.float64),
        faces=np.concatenate(moved, dtype=np.int32),
        colors=np.concatenate([_face_colors(mesh) for mesh in instances], dtype=np.uint8),
        instance=np.repeat(np.arange(len(instances), dtype=np.int32), np.diff(face)),
        first_vertex=vertex,
        first_face=face,
        spheres=np.array([_bounding_sphere(mesh.vertices) for mesh in instances]),
    )


def _face_colors(mesh: Mesh) -> ByteArray:
    white = np.full((len(mesh.faces), 3), 255, dtype=np.uint8)
    return white if mesh.colors is None else mesh.colors


def _bounding_sphere(vertices: FloatArray) -> tuple[float, float, float, float]:
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    return (*centre, float(np.linalg.norm(vertices - centre, axis=1).max()))


def _pinhole_view(camera: Camera) -> FloatArray:
    """World points to (wx, wy, w, 1), see raster_draw."""
    rotation, position = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3:]
    view = np.zeros((4, 4))
    view[:3, :3] = _product(camera.intrinsics, rotation.T)
    view[:3, 3:] = -_product(view[:3, :3], position)
    view[3, 3] = 1.0
    return view


def _rays(camera: Camera) -> FloatArray:
    """Image points (x, y, 1) to directions of depth 1, and the camera's position: (3, 4)."""
    rotation, position = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3]
    (fx, skew, cx), (_, fy, cy), _ = camera.intrinsics
    across = [1.0 / fx, -skew / (fx * fy), (skew * cy / fy - cx) / fx]
    inverse = np.array([across, [0.0, 1.0 / fy, -cy / fy], [0.0, 0.0, 1.0]])
    return np.column_stack([_product(rotation, inverse), position])


def _shadow_map(to_sun: FloatArray, pixels: int) -> ShadowMap:
    """Empty shadow map, all lit."""
    pose = looking(SHADOW_CENTRE, -to_sun)
    view = np.zeros((4, 4))
    view[:2, :3] = pixels / 2.0 / SHADOW_RADIUS * pose[:3, :2].T
    view[:2, 3:] = pixels / 2.0 - _product(view[:2, :3], SHADOW_CENTRE[:, None])
    view[2, 3] = 1.0
    view[3, :3] = to_sun
    return ShadowMap(view, np.full((pixels, pixels), -np.inf))


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrix product, rounded alike everywhere, as that of a machine's own BLAS is not."""
    product: FloatArray = (a[:, :, None] * b[None, :, :]).sum(axis=1)
    return product


def _normalised(lighting: Lighting) -> Lighting:
    to_sun = lighting.to_sun / np.sqrt((lighting.to_sun**2).sum())
    return lighting._replace(to_sun=to_sun)


def _enlarged(camera: Camera, factor: int) -> Camera:
    scale = np.diag([float(factor), float(factor), 1.0])
    width, height = camera.width * factor, camera.height * factor
    return replace(camera, width=width, height=height, intrinsics=scale @ camera.intrinsics)


def _averaged(picture: ByteArray, factor: int) -> ByteArray:
    height, width = picture.shape[0] // factor, picture.shape[1] // factor
    blocks = picture.reshape(height, factor, width, factor, 3)
    means: FloatArray = blocks.mean(axis=(1, 3))
    return np.round(means).astype(np.uint8)


def _empty_images(cameras: Sequence[Camera]) -> Images:
    sizes = {(camera.height, camera.width) for camera in cameras}
    if len(sizes) != 1:
        raise ValueError(f"Cameras of sizes {sorted(sizes)}: want one or more, all of one size")
    shape = (len(cameras), *sizes.pop())
    return Images(
        np.empty((*shape, 3), dtype=np.uint8),
        np.empty(shape, dtype=np.float32),
        np.empty(shape, dtype=np.int32),
    )


def _checked_colors(colors: ByteArray | None, count: int) -> ByteArray:
    if colors is None:
        return np.full((count, 3), 255, dtype=np.uint8)
    return _checked("colors", np.asarray(colors, dtype=np.uint8), (count, 3))


def _checked(name: str, array: NDArray[Kind], shape: tuple[int, ...]) -> NDArray[Kind]:
    if array.shape != shape:
        raise ValueError(f"{name} of shape {array.shape}: want {shape}, one row per instance")
    return np.ascontiguousarray(array)
