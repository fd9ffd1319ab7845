"""Kernels that colour a drawn frame: a sun with a soft shadow map, a sky and a ground.

Light is linear and a byte is its square root: a gamma of 2, which every machine rounds alike.
"""

from typing import NamedTuple

import numpy as np

from hide_tasks.bullet.meshes import ByteArray, FloatArray, IntArray
from hide_tasks.bullet.raster_draw import Frame, Placed, Shapes, kernel

SHADOW_BIAS = 0.003  # m towards the sun; with less, curved faces shade themselves
GRAZING = 0.15  # cosine below which the shadow is not followed down a slope
LIGHTS = 14  # values of a face's light: see _light_faces
LINES = 10  # values of a pixel while its row is coloured
DEPTH, U, V, H, SUN, AROUND, MIRROR, LIT, GAIN, GLOSS = range(LINES)


class Lighting(NamedTuple):
    """Light, linear with 1 for white, and background."""

    to_sun: FloatArray = np.array([0.55, 0.45, 1.0])  # direction, world, of any length
    sun: float = 0.64
    sky: float = 0.48  # what falls on a face that looks up
    ground: float = 0.32  # and on one that looks down
    shadow: float = 0.78  # part of the sun that a full shadow takes away
    shine: float = 0.10  # of a highlight
    wall: FloatArray = np.array([228.0, 231.0, 234.0])  # bytes; where the view goes level or up
    floor: FloatArray = np.array([165.0, 163.0, 161.0])  # and where it goes straight down


class ShadowMap(NamedTuple):
    """How high towards the sun the scene is, over the plane across the sun's direction."""

    projection: FloatArray  # (4, 4), a view of raster_draw
    height: FloatArray  # (s, s), m


@kernel
def shade(
    shapes: Shapes,
    placed: Placed,
    tints: ByteArray,
    frame: Frame,
    rays: FloatArray,
    lighting: Lighting,
    shadows: ShadowMap,
    lights: FloatArray,
    rgb: ByteArray,
) -> None:
    """Writes the colours (h, w, 3) of a drawn frame.

    `tints` (n, 3) multiply the faces' colours. `rays` (3, 4) turn (x, y, 1) into the world's
    direction of depth 1, and have the camera's position in the last column. `lights` (f, LIGHTS)
    is scratch.
    """
    height, width = frame.face.shape
    _light_faces(shapes, placed, tints, frame, rays, lighting, shadows.projection, lights)
    to_map = _pixel_to_map(rays, shadows.projection)
    line = np.zeros((LINES, width))
    heights, size = shadows.height.reshape(-1), shadows.height.shape[0]
    for row in range(height):
        _find_on_map(frame.closeness, row, to_map, line)
        _light_row(frame.face, row, lights, heights, size, line)
        _expose(lighting, line)
        _paint_row(frame.face, row, lights, line, _background(rays, lighting, row, width), rgb)


@kernel
def _light_faces(
    shapes: Shapes,
    placed: Placed,
    tints: ByteArray,
    frame: Frame,
    rays: FloatArray,
    lighting: Lighting,
    sun_view: FloatArray,
    lights: FloatArray,
) -> None:
    """Writes what the drawn faces' light depends on.

    Coefficients of (x, y, 1) for sunlight [0:3], light from all around [3:6] and likeness to a
    mirror of the sun [6:9], each over depth; and the rise of the face towards the sun from one
    texel of the shadow map to the next, along its columns [9] and rows [10]; its colour [11:14].
    """
    points, normals, weights = placed.points, placed.normals, frame.weights
    lx, ly, lz = lighting.to_sun[0], lighting.to_sun[1], lighting.to_sun[2]
    texel = 1.0 / (sun_view[0, 0] ** 2 + sun_view[0, 1] ** 2 + sun_view[0, 2] ** 2)
    for t in range(len(frame.drawn)):
        if not frame.drawn[t]:
            continue
        for k in range(9):
            lights[t, k] = 0.0
        for corner in range(3):
            v = shapes.faces[t, corner]
            nx, ny, nz = normals[v, 0], normals[v, 1], normals[v, 2]
            ex, ey = rays[0, 3] - points[v, 0], rays[1, 3] - points[v, 1]
            ez = rays[2, 3] - points[v, 2]
            distance = np.sqrt(ex * ex + ey * ey + ez * ez)
            hx, hy, hz = lx + ex / distance, ly + ey / distance, lz + ez / distance
            mirror = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
            around = lighting.ground + (0.5 + 0.5 * nz) * (lighting.sky - lighting.ground)
            sun = nx * lx + ny * ly + nz * lz
            for k in range(3):
                weight = weights[t, 3 * corner + k]
                lights[t, k] += weight * sun
                lights[t, k + 3] += weight * around
                lights[t, k + 6] += weight * mirror
        nx, ny, nz = _face_normal(points, shapes.faces, t)
        rise = -texel / max(nx * lx + ny * ly + nz * lz, GRAZING)
        for k in range(3):
            lights[t, 11 + k] = shapes.colors[t, k] * tints[shapes.instance[t], k] / 255.0
        for k in range(2):
            lights[t, 9 + k] = rise * (
                nx * sun_view[k, 0] + ny * sun_view[k, 1] + nz * sun_view[k, 2]
            )


@kernel
def _face_normal(points: FloatArray, faces: IntArray, t: int) -> tuple[float, float, float]:
    """Unit normal of a face."""
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    ux, uy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    vx, vy = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1]
    uz, vz = points[b, 2] - points[a, 2], points[c, 2] - points[a, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length


@kernel
def _pixel_to_map(rays: FloatArray, sun_view: FloatArray) -> FloatArray:
    """Matrix (3, 4) from depth * (x, y, 1) and 1 to column, row and height of the shadow map."""
    to_map = np.zeros((3, 4))
    for i in range(3):
        source = 3 if i == 2 else i
        to_map[i, 3] = sun_view[source, 3]
        for k in range(4):
            for j in range(3):
                to_map[i, k] += sun_view[source, j] * rays[j, k]
    return to_map


@kernel
def _find_on_map(closeness: FloatArray, row: int, to_map: FloatArray, line: FloatArray) -> None:
    """Writes a row's depths, and where its points are on the shadow map."""
    y = row + 0.5
    u_x, u_0, u_1 = to_map[0, 0], to_map[0, 1] * y + to_map[0, 2], to_map[0, 3] - 0.5
    v_x, v_0, v_1 = to_map[1, 0], to_map[1, 1] * y + to_map[1, 2], to_map[1, 3] - 0.5
    h_x, h_0, h_1 = to_map[2, 0], to_map[2, 1] * y + to_map[2, 2], to_map[2, 3] + SHADOW_BIAS
    for column in range(line.shape[1]):
        x, depth = column + 0.5, 1.0 / closeness[row, column]
        line[DEPTH, column] = depth
        line[U, column] = (u_x * x + u_0) * depth + u_1
        line[V, column] = (v_x * x + v_0) * depth + v_1
        line[H, column] = (h_x * x + h_0) * depth + h_1


@kernel
def _light_row(
    face: IntArray, row: int, lights: FloatArray, heights: FloatArray, size: int, line: FloatArray
) -> None:
    """Writes the light on a row's pixels, and the part of the sun, 0 to 1, that reaches them.

    A pixel's height is compared with 4 x 4 texels, each with the height that the face has there,
    so that a slope does not shade itself; they weigh as a square of 3 x 3 about the point does.
    """
    low, high, y = 1.0, size - 2.0, row + 0.5
    one, two = np.uintp(1), np.uintp(size + 3)
    three, four = np.uintp(2 * size), np.uintp(3 * size + 2)
    t = -1
    for pixel in range(face.shape[1]):
        if face[row, pixel] < 0:
            continue
        if face[row, pixel] != t:
            t = face[row, pixel]
            sun_x, sun_0 = lights[t, 0], lights[t, 1] * y + lights[t, 2]
            around_x, around_0 = lights[t, 3], lights[t, 4] * y + lights[t, 5]
            mirror_x, mirror_0 = lights[t, 6], lights[t, 7] * y + lights[t, 8]
            rise_u, rise_v = lights[t, 9], lights[t, 10]
        x, depth = pixel + 0.5, line[DEPTH, pixel]
        sun = max((sun_x * x + sun_0) * depth, 0.0)
        line[SUN, pixel] = sun
        line[AROUND, pixel] = (around_x * x + around_0) * depth
        line[MIRROR, pixel] = max((mirror_x * x + mirror_0) * depth, 0.5)
        lit, u, v = 1.0, line[U, pixel], line[V, pixel]
        if sun == 0.0:
            lit = 0.0
        elif low <= u < high and low <= v < high:
            column_u, row_v = int(u), int(v)
            fu, fv = u - column_u, v - row_v
            corner = np.uintp((row_v - 1) * size + column_u - 1)
            h = line[H, pixel] - rise_u * (fu + 1.0) - rise_v * (fv + 1.0)
            # One texel of each row and column tells whether all are in the sun, or none.
            clear = int(heights[corner + one] <= h + rise_u)
            clear += int(heights[corner + two] <= h + rise_v + 3.0 * rise_u)
            clear += int(heights[corner + three] <= h + 2.0 * rise_v)
            clear += int(heights[corner + four] <= h + 3.0 * rise_v + 2.0 * rise_u)
            if clear == 0:
                lit = 0.0
            elif clear < 4:
                lit = _filtered(heights, size, corner, fu, fv, h, rise_u, rise_v)
        line[LIT, pixel] = lit


@kernel
def _filtered(
    heights: FloatArray,
    size: int,
    corner: np.uintp,
    fu: float,
    fv: float,
    h: float,
    rise_u: float,
    rise_v: float,
) -> float:
    """Weighted part of 4 x 4 texels that are not above a face of height h at the first."""
    total = 0.0
    for j in range(4):
        weight_v = 1.0 - fv if j == 0 else fv if j == 3 else 1.0
        for i in range(4):
            clear = heights[corner + np.uintp(j * size + i)] <= h + rise_v * j + rise_u * i
            total += clear * weight_v * (1.0 - fu if i == 0 else fu if i == 3 else 1.0)
    return total / 9.0


@kernel
def _expose(lighting: Lighting, line: FloatArray) -> None:
    """Writes what a row's colours are multiplied by, and the highlight added to them."""
    sun, shadow, shine = lighting.sun, lighting.shadow, 255.0 * lighting.shine
    for column in range(line.shape[1]):
        lit = 1.0 - shadow * (1.0 - line[LIT, column])
        line[GAIN, column] = np.sqrt(line[AROUND, column] + lit * sun * line[SUN, column])
        gloss = line[MIRROR, column]
        gloss *= gloss
        gloss *= gloss
        gloss *= gloss
        gloss *= gloss
        gloss *= gloss
        line[GLOSS, column] = shine * lit * gloss


@kernel
def _background(
    rays: FloatArray, lighting: Lighting, row: int, width: int
) -> tuple[float, float, float]:
    """Colour where a row sees nothing, by how far the view goes down in the row's middle."""
    x, y = width / 2.0, row + 0.5
    dx = rays[0, 0] * x + rays[0, 1] * y + rays[0, 2]
    dy = rays[1, 0] * x + rays[1, 1] * y + rays[1, 2]
    dz = rays[2, 0] * x + rays[2, 1] * y + rays[2, 2]
    down = max(-dz / np.sqrt(dx * dx + dy * dy + dz * dz), 0.0)
    wall, floor = lighting.wall, lighting.floor
    return (
        wall[0] + down * (floor[0] - wall[0]),
        wall[1] + down * (floor[1] - wall[1]),
        wall[2] + down * (floor[2] - wall[2]),
    )


@kernel
def _paint_row(
    face: IntArray,
    row: int,
    lights: FloatArray,
    line: FloatArray,
    background: tuple[float, float, float],
    rgb: ByteArray,
) -> None:
    """Writes a row's colours."""
    t = -1
    red, green, blue = background
    for column in range(face.shape[1]):
        if face[row, column] != t:
            t = face[row, column]
            red, green, blue = background
            if t >= 0:
                red, green, blue = lights[t, 11], lights[t, 12], lights[t, 13]
        gain, gloss = (1.0, 0.5) if t < 0 else (line[GAIN, column], line[GLOSS, column] + 0.5)
        rgb[row, column, 0] = int(min(red * gain + gloss, 255.0))
        rgb[row, column, 1] = int(min(green * gain + gloss, 255.0))
        rgb[row, column, 2] = int(min(blue * gain + gloss, 255.0))
