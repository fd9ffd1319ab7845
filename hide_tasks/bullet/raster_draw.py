"""Kernels that find, for every pixel, the nearest face and how near it is.

A view is a (4, 4) matrix from world points to (wx, wy, w, c): (x, y) is the image point, in
pixels; w the depth for a pinhole, 1 for a parallel view; c/w the closeness that decides which
face is in front. A pinhole has c = 1, so that its closeness is 1/depth.
"""

from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar, cast

import numba
import numpy as np

from hide_tasks.bullet.meshes import BoolArray, ByteArray, FloatArray, IntArray

P = ParamSpec("P")
R = TypeVar("R")
Point = tuple[float, float, float]
Indices = tuple[np.uintp, np.uintp, np.uintp]

REACH = 1e-9  # pixels that a face reaches beyond its edges
WIDE = 8  # pixels: in wider rectangles the rows of a face are looked for before they are tested


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """`function` compiled at its first call and kept on disk.

    A kernel must not call one of another file: the disk cache looks at the caller's file alone.
    """
    return cast(Callable[P, R], numba.njit(cache=True, error_model="numpy")(function))


class Shapes(NamedTuple):
    """All meshes in one, in their own frames; instance i owns first[i] up to first[i + 1]."""

    vertices: FloatArray  # (v, 3)
    normals: FloatArray  # (v, 3)
    faces: IntArray  # (f, 3)
    colors: ByteArray  # (f, 3)
    instance: IntArray  # (f,)
    first_vertex: IntArray  # (n + 1,)
    first_face: IntArray  # (n + 1,)
    spheres: FloatArray  # (n, 4), bounding: centre, radius


class Placed(NamedTuple):
    """The shapes in the world."""

    points: FloatArray  # (v, 3)
    normals: FloatArray  # (v, 3)
    spheres: FloatArray  # (n, 4)


class Frame(NamedTuple):
    """One view's pixels, and the faces that are or were in front on some of them.

    A face's corner weights are affine in the image point (x, y): three rows of coefficients of
    (x, y, 1). They sum to 1/w, and weigh what is interpolated between the corners.
    """

    closeness: FloatArray  # (h, w)
    face: IntArray  # (h, w), or -1
    drawn: BoolArray  # (f,)
    weights: FloatArray  # (f, 9), where drawn


@kernel
def place(shapes: Shapes, poses: FloatArray, placed: Placed) -> None:
    """Writes the shapes at the poses (n, 4, 4) of their instances."""
    for i in range(len(poses)):
        a, b, c, d = poses[i, 0, 0], poses[i, 0, 1], poses[i, 0, 2], poses[i, 0, 3]
        e, f, g, h = poses[i, 1, 0], poses[i, 1, 1], poses[i, 1, 2], poses[i, 1, 3]
        k, m, n, p = poses[i, 2, 0], poses[i, 2, 1], poses[i, 2, 2], poses[i, 2, 3]
        for v in range(shapes.first_vertex[i], shapes.first_vertex[i + 1]):
            x, y, z = shapes.vertices[v, 0], shapes.vertices[v, 1], shapes.vertices[v, 2]
            placed.points[v, 0] = a * x + b * y + c * z + d
            placed.points[v, 1] = e * x + f * y + g * z + h
            placed.points[v, 2] = k * x + m * y + n * z + p
            x, y, z = shapes.normals[v, 0], shapes.normals[v, 1], shapes.normals[v, 2]
            placed.normals[v, 0] = a * x + b * y + c * z
            placed.normals[v, 1] = e * x + f * y + g * z
            placed.normals[v, 2] = k * x + m * y + n * z
        x, y, z = shapes.spheres[i, 0], shapes.spheres[i, 1], shapes.spheres[i, 2]
        placed.spheres[i, 0] = a * x + b * y + c * z + d
        placed.spheres[i, 1] = e * x + f * y + g * z + h
        placed.spheres[i, 2] = k * x + m * y + n * z + p
        placed.spheres[i, 3] = shapes.spheres[i, 3]


@kernel
def draw(
    shapes: Shapes,
    placed: Placed,
    visible: BoolArray,
    view: FloatArray,
    near: float,
    farthest: float,
    nearest: float,
    corners: FloatArray,
    pixels: IntArray,
    frame: Frame,
) -> None:
    """Fills `frame` with what the view sees of the visible instances.

    Faces at w < near, or with a closeness beyond the open range farthest..nearest, are not seen.
    `corners` (v, 6) and `pixels` (v, 2) are scratch.
    """
    height, width = frame.face.shape
    frame.closeness[:] = farthest
    frame.face[:] = -1
    frame.drawn[:] = False
    planes = _picture_borders(view, near, width, height)
    for i in range(len(visible)):
        if visible[i] and _reaches_in(placed.spheres, i, planes):
            first, last = shapes.first_vertex[i], shapes.first_vertex[i + 1]
            _project(placed.points, first, last, view, near, width, height, corners, pixels)
            first, last = shapes.first_face[i], shapes.first_face[i + 1]
            _draw_faces(shapes.faces, first, last, corners, pixels, near, nearest, frame)


@kernel
def _picture_borders(view: FloatArray, near: float, width: int, height: int) -> FloatArray:
    """Planes (5, 4) of the picture's borders and of `near`; unit normals point inward."""
    planes = np.empty((5, 4))
    for k in range(4):
        planes[0, k] = view[0, k]
        planes[1, k] = view[1, k]
        planes[2, k] = width * view[2, k] - view[0, k]
        planes[3, k] = height * view[2, k] - view[1, k]
        planes[4, k] = view[2, k]
    planes[4, 3] -= near
    for p in range(5):
        length = np.sqrt(planes[p, 0] ** 2 + planes[p, 1] ** 2 + planes[p, 2] ** 2)
        if length > 0.0:  # a parallel view has no `near` plane
            for k in range(4):
                planes[p, k] /= length
    return planes


@kernel
def _reaches_in(spheres: FloatArray, i: int, planes: FloatArray) -> bool:
    """Whether a bounding sphere may reach into the picture."""
    x, y, z, radius = spheres[i, 0], spheres[i, 1], spheres[i, 2], spheres[i, 3]
    for p in range(len(planes)):
        if planes[p, 0] * x + planes[p, 1] * y + planes[p, 2] * z + planes[p, 3] < -radius:
            return False
    return True


@kernel
def _project(
    points: FloatArray,
    first: int,
    last: int,
    view: FloatArray,
    near: float,
    width: int,
    height: int,
    corners: FloatArray,
    pixels: IntArray,
) -> None:
    """Writes the view's four values of each point and its image point.

    Writes also the first column and row whose centres lie beyond the point; -1 behind `near`.
    """
    for v in range(first, last):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        for k in range(4):
            corners[v, k] = view[k, 0] * x + view[k, 1] * y + view[k, 2] * z + view[k, 3]
        pixels[v, 0] = -1
        if corners[v, 2] >= near:
            inverse = 1.0 / corners[v, 2]
            column, row = corners[v, 0] * inverse, corners[v, 1] * inverse
            corners[v, 4], corners[v, 5] = column, row
            pixels[v, 0] = int(min(max(column + 0.5, 0.0), float(width)))
            pixels[v, 1] = int(min(max(row + 0.5, 0.0), float(height)))


@kernel
def _draw_faces(
    faces: IntArray,
    first: int,
    last: int,
    corners: FloatArray,
    pixels: IntArray,
    near: float,
    nearest: float,
    frame: Frame,
) -> None:
    """Draws the faces first..last where they are the nearest.

    One long loop, because every array handed to a function costs as much as a small face; its
    indices are unsigned and its innermost loop has no branches for the same reason.
    """
    closeness, face, drawn, weights = frame.closeness, frame.face, frame.drawn, frame.weights
    height, width = face.shape
    for number in range(first, last):
        t = np.uintp(number)
        a, b, c = np.uintp(faces[t, 0]), np.uintp(faces[t, 1]), np.uintp(faces[t, 2])
        left = min(pixels[a, 0], min(pixels[b, 0], pixels[c, 0]))
        if left >= 0:
            right = max(pixels[a, 0], max(pixels[b, 0], pixels[c, 0]))
            if left == right:
                continue
            top = min(pixels[a, 1], min(pixels[b, 1], pixels[c, 1]))
            bottom = max(pixels[a, 1], max(pixels[b, 1], pixels[c, 1]))
            if top == bottom or not _is_counter_clockwise(
                corners[b, 4] - corners[a, 4],
                corners[b, 5] - corners[a, 5],
                corners[c, 4] - corners[a, 4],
                corners[c, 5] - corners[a, 5],
            ):
                continue
        else:
            left, right, top, bottom = _clipped(corners, (a, b, c), near, width, height)
        p = corners[a, 0], corners[a, 1], corners[a, 2]
        q = corners[b, 0], corners[b, 1], corners[b, 2]
        r = corners[c, 0], corners[c, 1], corners[c, 2]
        ax, ay, az = _edge(q, r)
        bx, by, bz = _edge(r, p)
        cx, cy, cz = _edge(p, q)
        volume = ax * p[0] + ay * p[1] + az * p[2]
        if volume > -1e-15:  # it looks away, or is seen edge on
            continue
        inverse = 1.0 / volume
        ca, cb, cc = corners[a, 3] * inverse, corners[b, 3] * inverse, corners[c, 3] * inverse
        dx, dy = ax * ca + bx * cb + cx * cc, ay * ca + by * cb + cy * cc
        dz = az * ca + bz * cb + cz * cc
        # A pixel on a corner must not fall between all its faces, so each reaches further.
        a_0, b_0 = az - REACH * (abs(ax) + abs(ay)), bz - REACH * (abs(bx) + abs(by))
        c_0 = cz - REACH * (abs(cx) + abs(cy))
        wide, label, shows = right - left > WIDE, np.int32(t), False
        na, nb, nc = (1.0 / ax, 1.0 / bx, 1.0 / cx) if wide else (0.0, 0.0, 0.0)
        for line in range(top, bottom):
            row, y = np.uintp(line), line + 0.5
            row_a, row_b, row_c, row_d = ay * y + a_0, by * y + b_0, cy * y + c_0, dy * y + dz
            start, stop = left, right
            if wide:
                start, stop = _narrowed(na, row_a, start, stop)
                start, stop = _narrowed(nb, row_b, start, stop)
                start, stop = _narrowed(nc, row_c, start, stop)
            for place in range(start, stop):
                column, x = np.uintp(place), place + 0.5
                here, there = dx * x + row_d, closeness[row, column]
                inside = (ax * x + row_a <= 0.0) & (bx * x + row_b <= 0.0) & (cx * x + row_c <= 0.0)
                front = inside & (there < here) & (here < nearest)
                closeness[row, column] = here if front else there
                face[row, column] = label if front else face[row, column]
                shows |= front
        if shows:
            drawn[t] = True
            weights[t, 0], weights[t, 1], weights[t, 2] = ax * inverse, ay * inverse, az * inverse
            weights[t, 3], weights[t, 4], weights[t, 5] = bx * inverse, by * inverse, bz * inverse
            weights[t, 6], weights[t, 7], weights[t, 8] = cx * inverse, cy * inverse, cz * inverse


@kernel
def _is_counter_clockwise(ux: float, uy: float, vx: float, vy: float) -> bool:
    """Whether the image, y down, of a face with two edges u and v is seen from its front."""
    return ux * vy < vx * uy


@kernel
def _edge(p: Point, q: Point) -> Point:
    """Coefficients of the triple product of two corners and the image point (x, y, 1).

    It is zero on the edge, and negative inside a face that is passed round counter-clockwise.
    """
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@kernel
def _narrowed(inverse_slope: float, offset: float, start: int, stop: int) -> tuple[int, int]:
    """Columns of start..stop where x / inverse_slope + offset may be negative, one to spare."""
    if np.isinf(inverse_slope):
        return start, stop
    zero = min(max(-offset * inverse_slope, start - 2.0), stop + 2.0)
    if inverse_slope > 0.0:
        return start, min(stop, int(zero) + 2)
    return max(start, int(zero) - 1), stop


@kernel
def _clipped(
    corners: FloatArray, face: Indices, near: float, width: int, height: int
) -> tuple[int, int, int, int]:
    """Columns and rows that the part of a face in front of `near` may cover."""
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for k in range(3):
        p, q = face[k], face[(k + 1) % 3]
        if corners[p, 2] >= near:
            left, right = min(left, corners[p, 4]), max(right, corners[p, 4])
            top, bottom = min(top, corners[p, 5]), max(bottom, corners[p, 5])
        if (corners[p, 2] >= near) != (corners[q, 2] >= near):
            part = (near - corners[p, 2]) / (corners[q, 2] - corners[p, 2])
            x = (corners[p, 0] + part * (corners[q, 0] - corners[p, 0])) / near
            y = (corners[p, 1] + part * (corners[q, 1] - corners[p, 1])) / near
            left, right = min(left, x), max(right, x)
            top, bottom = min(top, y), max(bottom, y)
    if left > right:
        return 0, 0, 0, 0
    return (
        int(min(max(left - 1.0, 0.0), float(width))),
        int(min(max(right + 1.0, 0.0), float(width))),
        int(min(max(top - 1.0, 0.0), float(height))),
        int(min(max(bottom + 1.0, 0.0), float(height))),
    )
