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

WIDE = 8  # pixels: in wider rectangles the rows of a face are looked for before they are tested


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """`function` compiled at its first call and kept on disk.

    A kernel must not call one of another file: the disk cache looks at the caller's file alone.
    """
    return cast(Callable[P, R], numba.njit(cache=True)(function))


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
    vertices, normals, spheres = shapes.vertices, shapes.normals, shapes.spheres
    for i in range(len(poses)):
        first, last = shapes.first_vertex[i], shapes.first_vertex[i + 1]
        placed.spheres[i, 3] = spheres[i, 3]
        for k in range(3):
            a, b, c, d = poses[i, k, 0], poses[i, k, 1], poses[i, k, 2], poses[i, k, 3]
            placed.spheres[i, k] = a * spheres[i, 0] + b * spheres[i, 1] + c * spheres[i, 2] + d
            for v in range(first, last):
                x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                placed.points[v, k] = a * x + b * y + c * z + d
                x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
                placed.normals[v, k] = a * x + b * y + c * z


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
    frame: Frame,
) -> None:
    """Fills `frame` with what the view sees of the visible instances.

    Faces at w < near, or with a closeness beyond the open range farthest..nearest, are not seen.
    `corners` (v, 6) is scratch.
    """
    faces, first_vertex, first_face = shapes.faces, shapes.first_vertex, shapes.first_face
    height, width = frame.face.shape
    frame.closeness[:] = farthest
    frame.face[:] = -1
    frame.drawn[:] = False
    planes = _picture_borders(view, near, width, height)
    for i in range(len(visible)):
        if visible[i] and _reaches_in(placed.spheres, i, planes):
            _project(placed.points, first_vertex[i], first_vertex[i + 1], view, near, corners)
            for t in range(first_face[i], first_face[i + 1]):
                a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
                x0, x1, y0, y1 = _rectangle(corners, a, b, c, near, width, height)
                if x0 < x1 and y0 < y1:
                    _fill(corners, a, b, c, t, x0, x1, y0, y1, nearest, frame)


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
    points: FloatArray, first: int, last: int, view: FloatArray, near: float, corners: FloatArray
) -> None:
    """Writes the view's four values of each point and, in front of `near`, its image point."""
    for v in range(first, last):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        for k in range(4):
            corners[v, k] = view[k, 0] * x + view[k, 1] * y + view[k, 2] * z + view[k, 3]
        if corners[v, 2] >= near:
            inverse = 1.0 / corners[v, 2]
            corners[v, 4] = corners[v, 0] * inverse
            corners[v, 5] = corners[v, 1] * inverse


@kernel
def _rectangle(
    corners: FloatArray, a: int, b: int, c: int, near: float, width: int, height: int
) -> tuple[int, int, int, int]:
    """Columns x0..x1 and rows y0..y1 whose centres a face may cover; empty if it looks away."""
    if corners[a, 2] >= near and corners[b, 2] >= near and corners[c, 2] >= near:
        ax, ay, bx, by = corners[a, 4], corners[a, 5], corners[b, 4], corners[b, 5]
        cx, cy = corners[c, 4], corners[c, 5]
        if (bx - ax) * (cy - ay) >= (cx - ax) * (by - ay):
            return 0, 0, 0, 0
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
    else:
        left, right, top, bottom = _clipped_bounds(corners, (a, b, c), near)
    slack = 1e-7  # the corner weights decide what is covered; rounding here must not
    x0 = int(min(max(np.ceil(left - 0.5 - slack), 0.0), float(width)))
    x1 = int(min(max(np.floor(right + 0.5 + slack), 0.0), float(width)))
    y0 = int(min(max(np.ceil(top - 0.5 - slack), 0.0), float(height)))
    y1 = int(min(max(np.floor(bottom + 0.5 + slack), 0.0), float(height)))
    return x0, x1, y0, y1


@kernel
def _clipped_bounds(
    corners: FloatArray, face: tuple[int, int, int], near: float
) -> tuple[float, float, float, float]:
    """Left, right, top, bottom of the part of a face in front of `near`."""
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
    return left, right, top, bottom


@kernel
def _edge(corners: FloatArray, p: int, q: int) -> tuple[float, float, float]:
    """Coefficients of the triple product of two corners and the image point (x, y, 1).

    It is zero on the edge. Swapped corners give the exact negative, so that of two faces which
    share an edge one has every pixel on it.
    """
    px, py, pw = corners[p, 0], corners[p, 1], corners[p, 2]
    qx, qy, qw = corners[q, 0], corners[q, 1], corners[q, 2]
    return py * qw - pw * qy, pw * qx - px * qw, px * qy - py * qx


@kernel
def _fill(
    corners: FloatArray,
    a: int,
    b: int,
    c: int,
    t: int,
    x0: int,
    x1: int,
    y0: int,
    y1: int,
    nearest: float,
    frame: Frame,
) -> None:
    """Draws face `t` on those pixels of a rectangle that it covers and is the nearest at."""
    closeness, face, weights = frame.closeness, frame.face, frame.weights
    ax, ay, az = _edge(corners, b, c)
    bx, by, bz = _edge(corners, c, a)
    cx, cy, cz = _edge(corners, a, b)
    volume = ax * corners[a, 0] + ay * corners[a, 1] + az * corners[a, 2]
    if volume > -1e-15:  # it looks away, or is seen edge on
        return
    inverse = 1.0 / volume
    ca, cb, cc = corners[a, 3] * inverse, corners[b, 3] * inverse, corners[c, 3] * inverse
    dx, dy = ax * ca + bx * cb + cx * cc, ay * ca + by * cb + cy * cc
    dz = az * ca + bz * cb + cz * cc
    drawn = False
    for row in range(y0, y1):
        y = row + 0.5
        row_a, row_b, row_c, row_d = ay * y + az, by * y + bz, cy * y + cz, dy * y + dz
        start, stop = x0, x1
        if x1 - x0 > WIDE:
            start, stop = _narrowed(ax, row_a, start, stop)
            start, stop = _narrowed(bx, row_b, start, stop)
            start, stop = _narrowed(cx, row_c, start, stop)
        for column in range(start, stop):
            x = column + 0.5
            if ax * x + row_a <= 0.0 and bx * x + row_b <= 0.0 and cx * x + row_c <= 0.0:
                here = dx * x + row_d
                if closeness[row, column] < here < nearest:
                    closeness[row, column] = here
                    face[row, column] = t
                    drawn = True
    if drawn:
        frame.drawn[t] = True
        weights[t, 0], weights[t, 1], weights[t, 2] = ax * inverse, ay * inverse, az * inverse
        weights[t, 3], weights[t, 4], weights[t, 5] = bx * inverse, by * inverse, bz * inverse
        weights[t, 6], weights[t, 7], weights[t, 8] = cx * inverse, cy * inverse, cz * inverse


@kernel
def _narrowed(slope: float, offset: float, start: int, stop: int) -> tuple[int, int]:
    """Columns of start..stop where slope * x + offset may be negative, one to spare."""
    if slope == 0.0:
        return start, stop
    zero = min(max(-offset / slope, start - 2.0), stop + 2.0)
    if slope > 0.0:
        return start, min(stop, int(zero) + 2)
    return max(start, int(zero) - 1), stop
