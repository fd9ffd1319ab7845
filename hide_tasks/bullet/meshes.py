"""Triangle meshes for the renderer: procedural solids, and the Panda arm as data.

Needs numpy alone. Every solid is watertight, with faces counter-clockwise seen from outside;
vertices are split where neighbouring faces meet at more than CREASE, so that edges stay sharp.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
Rgb = tuple[int, int, int]

CREASE = np.radians(36.0)  # faces that meet at a larger angle do not share a normal
PANDA_FILE = Path(__file__).with_name("panda_meshes.npz")  # written by make_panda_meshes


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in metres, with unit normals (to 1e-6) for shading.

    `colors` are of the faces; None leaves the colour to the instance.
    """

    vertices: FloatArray  # (n, 3)
    normals: FloatArray  # (n, 3)
    faces: IntArray  # (m, 3), counter-clockwise seen from outside
    colors: ByteArray | None = None  # (m, 3)

    @property
    def volume(self) -> float:
        """Enclosed volume in cubic metres; positive if the faces look outward."""
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def box(size: Sequence[float], bevel: float = 0.0) -> Mesh:
    """Box of full lengths `size` (x, y, z); `bevel` metres are cut off along its edges."""
    half = np.asarray(size, dtype=np.float64) / 2.0
    _require(len(half) == 3 and bool(np.all(half > 0)), f"box size {size}: want three lengths > 0")
    _require(0 <= bevel < half.min(), f"bevel {bevel}: want 0 <= bevel < {half.min()}")
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    polygons = _box_sides(signs)
    if bevel == 0.0:
        corners = np.repeat(signs * half, 3, axis=0)
    else:
        on_face = np.tile(np.eye(3), (8, 1)).astype(bool)
        inset = np.repeat(signs * (half - bevel), 3, axis=0)
        corners = np.where(on_face, np.repeat(signs * half, 3, axis=0), inset)
        polygons += _box_bevels(signs)
    return shaded(corners, _outward_fans(corners, polygons))


def lathe(profile: Sequence[tuple[float, float]], sides: int = 24) -> Mesh:
    """Surface of revolution about z of a line of points (r, z), in metres.

    The line runs with the solid on its left: upward on the outside, downward in a hollow.
    It is closed by starting and ending on the axis (r = 0) or by ending where it starts.
    """
    _require(sides >= 3 and len(profile) >= 3, "lathe: want at least 3 sides and 3 points")
    closed = tuple(profile[0]) == tuple(profile[-1])
    _require(
        closed or profile[0][0] == profile[-1][0] == 0.0,
        f"profile {profile}: want a closed line, or one from the axis r = 0 to the axis",
    )
    angles = 2.0 * np.pi * np.arange(sides) / sides
    radius, height = np.array(profile, dtype=np.float64).T
    x, y = np.outer(radius, np.cos(angles)), np.outer(radius, np.sin(angles))
    vertices = np.stack([x, y, np.repeat(height[:, None], sides, axis=1)], axis=-1)
    rings = np.arange(radius.size * sides).reshape(radius.size, sides)
    lower, upper = rings[:-1], rings[1:]
    lower_next, upper_next = np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1)
    quads = np.stack([lower, lower_next, upper_next, lower, upper_next, upper], axis=-1)
    return shaded(vertices.reshape(-1, 3), quads.reshape(-1, 3))


def cylinder(radius: float, height: float, sides: int = 24, bevel: float = 0.0) -> Mesh:
    """Upright cylinder; `bevel` metres are cut off along the rims."""
    half = height / 2.0
    _require(0 <= bevel < min(radius, half), f"bevel {bevel}: want less than radius and height/2")
    rim = [(radius - bevel, -half), (radius, -half + bevel)]
    rim += [(radius, half - bevel), (radius - bevel, half)]
    return lathe([(0.0, -half), *dict.fromkeys(rim), (0.0, half)], sides)


def cone(radius: float, height: float, sides: int = 24, top_radius: float = 0.0) -> Mesh:
    """Upright cone, or its frustum, half its height below and above the origin."""
    half = height / 2.0
    corners = [(0.0, -half), (radius, -half), (top_radius, half), (0.0, half)]
    return lathe(list(dict.fromkeys(corners)), sides)


def tube(inner: float, outer: float, height: float, sides: int = 32) -> Mesh:
    """Upright pipe of the two radii, open at both ends."""
    _require(0 < inner < outer, f"tube radii {inner}, {outer}: want 0 < inner < outer")
    half = height / 2.0
    return lathe(
        [(outer, -half), (outer, half), (inner, half), (inner, -half), (outer, -half)], sides
    )


def sphere(radius: float, sides: int = 20) -> Mesh:
    """Ball of `sides` meridians and half as many parallels."""
    tilt = np.linspace(-np.pi / 2.0, np.pi / 2.0, sides // 2 + 1)[1:-1]
    arc = zip(radius * np.cos(tilt), radius * np.sin(tilt), strict=True)
    return lathe([(0.0, -radius), *arc, (0.0, radius)], sides)


def merge(parts: Iterable[tuple[Mesh, FloatArray, Rgb | None]]) -> Mesh:
    """One mesh of several, each at its 4x4 pose and in its colour.

    Without a colour a part keeps its own, or is white, which takes the instance's colour.
    """
    parts = list(parts)
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh, _, _ in parts[:-1]])
    points: FloatArray = np.concatenate(
        [m.vertices @ pose[:3, :3].T + pose[:3, 3] for m, pose, _ in parts]
    )
    normals: FloatArray = np.concatenate([m.normals @ pose[:3, :3].T for m, pose, _ in parts])
    faces = [m.faces + start for (m, _, _), start in zip(parts, offsets, strict=True)]
    return Mesh(
        np.round(points, 9) + 0.0,
        np.round(normals, 6) + 0.0,
        np.concatenate(faces).astype(np.int32),
        np.concatenate([_face_colors(mesh, rgb) for mesh, _, rgb in parts]),
    )


def load_panda() -> dict[str, Mesh]:
    """Link name of panda.urdf -> coloured mesh in that link's URDF frame.

    That is the frame of PyBullet's `getLinkState(...)[4:6]`; links without a shape are absent.
    """
    with np.load(PANDA_FILE) as data:
        arrays = {name: data[name] for name in data.files}
    links = dict.fromkeys(name.split("/")[0] for name in arrays)
    return {
        link: Mesh(
            arrays[f"{link}/vertices"].astype(np.float64),
            _unit(arrays[f"{link}/normals"].astype(np.float64)),
            arrays[f"{link}/faces"].astype(np.int32),
            arrays[f"{link}/palette"][arrays[f"{link}/materials"]],
        )
        for link in links
    }


def shaded(
    vertices: FloatArray,
    faces: NDArray[np.integer],
    colors: ByteArray | None = None,
    crease: float = CREASE,
) -> Mesh:
    """Mesh of a triangle soup: equal points welded, flat triangles dropped, normals averaged.

    A corner's normal is the mean, by angle, of the faces round its point that are turned by
    less than `crease` radians from its own face. Points are rounded to a nanometre and normals
    to 1e-6, so that another machine's sine makes the same mesh.
    """
    points, faces = weld(vertices, faces)
    edges = np.roll(points[faces], -1, axis=1) - points[faces]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    solid = area > 1e-12
    faces, edges = faces[solid], edges[solid]
    normals = _corner_normals(faces, edges, len(points), crease)
    corners = np.column_stack([points[faces.reshape(-1)], np.round(normals, 6) + 0.0])
    split, corner = np.unique(corners, axis=0, return_inverse=True)
    return Mesh(
        np.ascontiguousarray(split[:, :3]),
        np.ascontiguousarray(split[:, 3:]),
        corner.reshape(-1, 3).astype(np.int32),
        None if colors is None else colors[solid],
    )


def weld(vertices: FloatArray, faces: NDArray[np.integer]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices without repetition, to a nanometre, and the faces that use them."""
    points, point = np.unique(np.round(vertices, 9) + 0.0, axis=0, return_inverse=True)
    return points, point.reshape(-1)[faces]


def _corner_normals(
    faces: NDArray[np.integer], edges: FloatArray, points: int, crease: float
) -> FloatArray:
    """Unit normal (3m, 3) of each face corner."""
    flat = _unit(np.cross(edges[:, 0], edges[:, 1]))
    along, back = _unit(edges), _unit(-np.roll(edges, 1, axis=1))
    angle = np.arccos(np.clip(np.einsum("fci,fci->fc", along, back), -1.0, 1.0)).reshape(-1)
    point = faces.reshape(-1)
    # All pairs of corners that share a point: `mine` repeated, `other` running over its group.
    grouped = np.argsort(point, kind="stable")
    count = np.bincount(point, minlength=points)
    start = np.cumsum(count) - count
    mine = np.repeat(np.arange(point.size), count[point])
    rank = np.arange(mine.size) - np.repeat(np.cumsum(count[point]) - count[point], count[point])
    other = grouped[start[point[mine]] + rank]
    own, near = flat[mine // 3], flat[other // 3]
    weight = np.where(np.einsum("pi,pi->p", own, near) > np.cos(crease), angle[other], 0.0)
    total = [np.bincount(mine, weight * near[:, i], minlength=point.size) for i in range(3)]
    return _unit(np.stack(total, axis=1))


def _box_sides(signs: IntArray) -> list[list[int]]:
    """Corners (three to a sign triple, one an axis) of the six sides, in cyclic order."""
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            rim = np.flatnonzero(signs[:, axis] == sign)
            sides.append([int(3 * corner + axis) for corner in rim[[0, 1, 3, 2]]])
    return sides


def _box_bevels(signs: IntArray) -> list[list[int]]:
    """Corners of the twelve bevelled edges and the eight cut-off corners."""
    bevels = [[3 * corner, 3 * corner + 1, 3 * corner + 2] for corner in range(8)]
    for a, b in ((0, 1), (1, 2), (0, 2)):
        for sign_a in (-1, 1):
            for sign_b in (-1, 1):
                ends = np.flatnonzero((signs[:, a] == sign_a) & (signs[:, b] == sign_b))
                low, high = map(int, ends)
                bevels.append([3 * low + a, 3 * high + a, 3 * high + b, 3 * low + b])
    return bevels


def _outward_fans(corners: FloatArray, polygons: list[list[int]]) -> IntArray:
    """Triangles of convex polygons, turned to look away from the origin."""
    triangles = np.array(
        [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)], dtype=np.int32
    )
    a, b, c = (corners[triangles[:, corner]] for corner in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return triangles


def _face_colors(mesh: Mesh, rgb: Rgb | None) -> ByteArray:
    if rgb is None and mesh.colors is not None:
        return mesh.colors
    return np.tile(np.array(rgb or (255, 255, 255), dtype=np.uint8), (len(mesh.faces), 1))


def _unit(vectors: FloatArray) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.maximum(lengths, 1e-300)


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)
