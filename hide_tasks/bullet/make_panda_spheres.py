"""Fit the spheres of `panda_spheres.npz` to the convex hulls of PyBullet's Panda.

Run once, after a change of the model: `python -m hide_tasks.bullet.make_panda_spheres`.
Every hull's surface lies inside its spheres (what touches no surface is not touched either), and
no sphere stands out of its hull by more than the overhang given here. Greedy set cover: of all
spheres as large as the overhang allows, take the one that covers most of the surface still bare,
until none is.
"""

from pathlib import Path

import numpy as np
import pybullet_data
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

# Mesh, index of its frame in `frames.link_frames` (9 and 10: left and right finger), and how
# far its spheres may stand out (mm) towards -x, +x, -y, +y, -z, +z of that frame. Where the next
# link hides a side it may be much; the palm and the fingers work among things.
PARTS = [
    ("link0", 0, (30, 30, 30, 30, 60, 60)),
    ("link1", 1, (25, 25, 25, 25, 60, 60)),
    ("link2", 2, (25, 25, 60, 25, 25, 25)),
    ("link3", 3, (22, 22, 22, 22, 60, 22)),
    ("link4", 4, (22, 22, 22, 22, 22, 22)),
    ("link5", 5, (18, 18, 18, 18, 40, 18)),
    ("link6", 6, (14, 14, 14, 14, 14, 14)),
    ("link7", 7, (10, 10, 10, 10, 30, 30)),
    ("hand", 8, (7, 7, 10, 10, 30, 5)),
    ("finger", 9, (5, 5, 2, 5, 20, 3)),
]
PADDING = 0.001  # m, Bullet's collision margin around a hull
OVERLAP = 0.0005  # m between samples
POINTS = 2500  # samples of each surface
CANDIDATES = 15000  # centres tried inside each hull


def vertices(part: str) -> Array:
    """The vertices (n, 3) of a collision mesh, in the frame of its link."""
    file = Path(pybullet_data.getDataPath(), "franka_panda/meshes/collision", f"{part}.obj")
    lines = [line.split() for line in file.read_text().splitlines()]
    return np.array([[float(x) for x in line[1:4]] for line in lines if line[:1] == ["v"]])


def surface(hull: ConvexHull, count: int, rng: np.random.Generator) -> Array:
    """Points (count + corners, 3) spread evenly over a hull, and its corners."""
    corners = hull.points[hull.simplices]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = corners[rng.choice(len(areas), count, p=areas / areas.sum())]
    mix = rng.dirichlet(np.ones(3), count)
    return np.concatenate([np.einsum("ni,nij->nj", mix, chosen), hull.points[hull.vertices]])


def inflated(hull: ConvexHull, overhang: Array, rng: np.random.Generator) -> Array:
    """Spheres (n, 4) with centres inside the hull, as large as the overhang (6,) in m allows."""
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    spare = np.where(normals < 0, overhang[0::2], overhang[1::2])
    slack = (normals**2 * spare).sum(1)
    low, high = hull.points.min(0), hull.points.max(0)
    centres = rng.uniform(low, high, (CANDIDATES, 3))
    depths = -(centres @ normals.T + offsets)
    inside = depths.min(1) > 0
    return np.column_stack([centres[inside], (depths + slack).min(1)[inside]])


def gaps(points: Array, spheres: Array) -> Array:
    """How far each point lies outside each sphere (n, k), in metres."""
    squares = (points**2).sum(1)[:, None] - 2 * points @ spheres[:, :3].T
    return np.asarray(np.sqrt(squares + (spheres[:, :3] ** 2).sum(1)) - spheres[:, 3])


def fit(part: str, overhang: tuple[int, ...]) -> Array:
    """Spheres (k, 4) around one collision mesh, padded.

    Raises:
        ValueError: some of the surface is in no candidate; more candidates would be right.
    """
    rng = np.random.default_rng(7)
    hull = ConvexHull(vertices(part))
    points = surface(hull, POINTS, rng)
    candidates = inflated(hull, 1e-3 * np.array(overhang), rng)
    covers = gaps(points, candidates) <= -OVERLAP
    bare, chosen = np.ones(len(points), bool), []
    while bare.any():
        gain = covers[bare].sum(0)
        if not gain.any():
            raise ValueError(f"{bare.sum()} points of {part} are in none of {CANDIDATES} spheres")
        chosen.append(int(gain.argmax()))
        bare &= ~covers[:, chosen[-1]]
    spheres = candidates[chosen]
    missed = gaps(surface(hull, 20 * POINTS, rng), spheres).min(1).max()
    spheres[:, 3] += PADDING + max(0.0, missed)
    return np.asarray(spheres)


def main() -> None:
    """Write `panda_spheres.npz`: `spheres` (s, 4) in link frames and `frames` (s,)."""
    spheres, frames = [], []
    for part, frame, overhang in PARTS:
        one = fit(part, overhang)
        spheres.append(one)
        frames.append(np.full(len(one), frame))
        if part == "finger":
            spheres.append(one * [-1.0, -1.0, 1.0, 1.0])
            frames.append(np.full(len(one), frame + 1))
    file = Path(__file__).with_name("panda_spheres.npz")
    np.savez(file, spheres=np.concatenate(spheres), frames=np.concatenate(frames))


if __name__ == "__main__":
    main()
