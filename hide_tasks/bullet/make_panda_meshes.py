"""Writes panda_meshes.npz: the Panda of pybullet_data, light enough to be drawn on a CPU.

Run once, as `python -m hide_tasks.bullet.make_panda_meshes`; the result is committed. The shapes
are Franka Emika's (Apache 2.0, panda_meshes.LICENSE.txt) with a tenth of their triangles.
"""

import shutil
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

import fast_simplification
import numpy as np
import pybullet_data
from numpy.typing import NDArray
from PIL import Image

from hide_tasks.bullet.meshes import PANDA_FILE, FloatArray, Mesh, Rgb, shaded, weld

SOURCE = Path(pybullet_data.getDataPath()) / "franka_panda"
LICENSE = PANDA_FILE.with_suffix(".LICENSE.txt")

# Triangles a link may keep; the wrist camera sees the hand and the fingers from 10 cm.
BUDGET = {
    "panda_link1": 750,
    "panda_link2": 750,
    "panda_link3": 1000,
    "panda_link4": 1000,
    "panda_link5": 1300,
    "panda_link6": 1700,
    "panda_hand": 1600,
    "panda_leftfinger": 624,
    "panda_rightfinger": 624,
}
WHITE: Rgb = (236, 238, 240)
DARK: Rgb = (62, 64, 70)
LEAST_PART = 12  # triangles; smaller parts are left as they are


class Part(NamedTuple):
    """The triangles of one material."""

    vertices: FloatArray
    faces: NDArray[np.int64]
    color: Rgb


def main() -> None:
    """Reads panda.urdf, writes the mesh file and copies the licence beside it."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for link in ElementTree.parse(SOURCE / "panda.urdf").getroot().findall("link"):
        visual = link.find("visual")
        if visual is not None:
            name = link.attrib["name"]
            packed = _packed(_link(name, visual))
            arrays |= {f"{name}/{key}": value for key, value in packed.items()}
    np.savez_compressed(PANDA_FILE, **arrays)  # type: ignore[arg-type]
    shutil.copyfile(SOURCE / "LICENSE.txt", LICENSE)


def _link(name: str, visual: ElementTree.Element) -> Mesh:
    """One link's mesh in its own frame, within its budget of triangles."""
    mesh = visual.find("geometry/mesh")
    assert mesh is not None
    parts = read_obj(SOURCE / mesh.attrib["filename"].removeprefix("package://"))
    sizes = np.array([len(part.faces) for part in parts])
    shares = np.sqrt(sizes)  # a small part that lost as much as a large one would lose its shape
    targets = np.minimum(sizes, BUDGET.get(name, sizes.sum()) * shares / shares.sum())
    parts = [_simplified(part, int(n)) for part, n in zip(parts, targets, strict=True)]
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    vertices = np.concatenate([part.vertices for part in parts])
    faces = [part.faces + start for part, start in zip(parts, offsets, strict=True)]
    colors = [np.tile(np.array(part.color, dtype=np.uint8), (len(part.faces), 1)) for part in parts]
    turned = _rotation(visual.find("origin"))
    return shaded(vertices @ turned.T, np.concatenate(faces), np.concatenate(colors))


def read_obj(path: Path) -> list[Part]:
    """Parts of an OBJ file, one a material, in the arm's colours."""
    lines = [line.split() for line in path.read_text().splitlines()]
    points = np.array([words[1:4] for words in lines if words[:1] == ["v"]], dtype=np.float64)
    uv = np.array([words[1:3] for words in lines if words[:1] == ["vt"]], dtype=np.float64)
    corners: dict[str, list[list[str]]] = {}
    material = ""
    for words in lines:
        if words[:1] == ["usemtl"]:
            material = words[1]
        elif words[:1] == ["f"]:
            corners.setdefault(material, []).append([*"/".join(words[1:4]).split("/")])
    materials = _materials(path.with_suffix(".mtl"))
    return [_part(points, uv, np.array(c), materials.get(m)) for m, c in corners.items()]


def _part(
    points: FloatArray, uv: FloatArray, corners: NDArray[np.str_], material: FloatArray | None
) -> Part:
    """The part of one material: welded, and coloured by the material and the texture."""
    indices = corners.reshape(len(corners), 3, -1)
    used, faces = np.unique(indices[:, :, 0].astype(np.int64) - 1, return_inverse=True)
    textured = indices.shape[2] > 1 and np.all(indices[:, :, 1] != "")
    grain = _texture(uv[indices[:, :, 1].astype(np.int64) - 1].mean(axis=1)) if textured else 1.0
    return Part(points[used], faces.reshape(-1, 3), _color(material, grain))


def _color(material: FloatArray | None, grain: float) -> Rgb:
    """White shell, dark joint, or what is neither: the light ring and the signs."""
    if material is None:
        return WHITE
    if np.ptp(material) > 0.2:
        red, green, blue = (int(255 * channel) for channel in material)
        return red, green, blue
    return DARK if grain * material.mean() < 0.6 else WHITE


def _materials(path: Path) -> dict[str, FloatArray]:
    """Diffuse colour of each material, 0 to 1; empty if there is no such file."""
    materials: dict[str, FloatArray] = {}
    name = ""
    for words in map(str.split, path.read_text().splitlines() if path.exists() else []):
        if words[:1] == ["newmtl"]:
            name = words[1]
        elif words[:1] == ["Kd"]:
            materials[name] = np.array(words[1:], dtype=np.float64)
    return materials


def _texture(uv: FloatArray) -> float:
    """Mean brightness, 0 to 1, of the arm's texture at points (n, 2)."""
    image = np.asarray(Image.open(SOURCE / "meshes/visual/colors.png").convert("L")) / 255.0
    size = np.array(image.shape)[::-1]
    columns, rows = ((uv * (1, -1) % 1.0) * (size - 1)).astype(int).T
    return float(image[rows, columns].mean())


def _simplified(part: Part, target: int) -> Part:
    """The part with `target` triangles."""
    points, faces = weld(part.vertices, part.faces)
    target = max(target, LEAST_PART)
    if target < len(faces):
        points, faces = fast_simplification.simplify(
            points.astype(np.float32), faces, target_count=target, agg=3
        )
    return Part(np.asarray(points, dtype=np.float64), np.asarray(faces), part.color)


def _rotation(origin: ElementTree.Element | None) -> FloatArray:
    """Rotation (3, 3) of a visual's origin, about z alone, which is all that the arm uses."""
    roll, pitch, yaw = map(float, origin.attrib["rpy"].split()) if origin is not None else (0,) * 3
    assert roll == pitch == 0.0
    return np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])


def _packed(mesh: Mesh) -> dict[str, NDArray[np.generic]]:
    """A mesh as small arrays: see meshes.load_panda."""
    assert mesh.colors is not None
    palette, materials = np.unique(mesh.colors, axis=0, return_inverse=True)
    return {
        "vertices": mesh.vertices.astype(np.float32),
        "normals": np.round(mesh.normals * 127).astype(np.int8),
        "faces": mesh.faces.astype(np.uint16),
        "materials": materials.reshape(-1).astype(np.uint8),
        "palette": palette,
    }


if __name__ == "__main__":
    main()
