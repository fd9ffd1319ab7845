"""Meshes are closed, look outward, have the size that was asked for, and shade as they should."""

import numpy as np
import pytest

from hide_tasks.bullet import meshes
from hide_tasks.bullet.meshes import Mesh

CUP = [(0, 0), (0.03, 0), (0.04, 0.1), (0.036, 0.1), (0.027, 0.006), (0, 0.006)]
SOLIDS = {
    "box": meshes.box((0.1, 0.2, 0.3)),
    "bevelled box": meshes.box((0.1, 0.2, 0.3), bevel=0.01),
    "cylinder": meshes.cylinder(0.05, 0.2),
    "bevelled cylinder": meshes.cylinder(0.05, 0.2, bevel=0.005),
    "sphere": meshes.sphere(0.1),
    "tube": meshes.tube(0.03, 0.05, 0.1),
    "cone": meshes.cone(0.05, 0.1),
    "frustum": meshes.cone(0.05, 0.1, top_radius=0.02),
    "cup": meshes.lathe(CUP),
}
PANDA_LINKS = {
    *(f"panda_link{i}" for i in range(8)),
    "panda_hand",
    "panda_leftfinger",
    "panda_rightfinger",
}

solids = pytest.mark.parametrize("mesh", SOLIDS.values(), ids=SOLIDS.keys())


def face_normals(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def polygon(radius: float, sides: int) -> float:
    return sides / 2 * radius**2 * np.sin(2 * np.pi / sides)


@solids
def test_a_solid_is_closed(mesh: Mesh) -> None:
    _, faces = meshes.weld(mesh.vertices, mesh.faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])

    there = {(int(a), int(b)) for a, b in edges}

    assert len(there) == len(edges)
    assert {(b, a) for a, b in there} == there


@solids
def test_normals_are_units_and_look_where_their_faces_look(mesh: Mesh) -> None:
    agreement = np.einsum("fci,fi->fc", mesh.normals[mesh.faces], face_normals(mesh))

    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-5)
    assert agreement.min() > np.cos(meshes.CREASE)


@pytest.mark.parametrize(
    ("name", "volume"),
    [
        ("box", 0.1 * 0.2 * 0.3),
        ("cylinder", polygon(0.05, 24) * 0.2),
        ("tube", (polygon(0.05, 32) - polygon(0.03, 32)) * 0.1),
        ("cone", polygon(0.05, 24) * 0.1 / 3),
        ("frustum", polygon(1, 24) * 0.1 / 3 * (0.05**2 + 0.05 * 0.02 + 0.02**2)),
    ],
)
def test_the_enclosed_volume_is_the_solid_s(name: str, volume: float) -> None:
    assert SOLIDS[name].volume == pytest.approx(volume, rel=1e-6)


def test_a_fine_sphere_and_a_fine_cup_enclose_what_round_ones_do() -> None:
    outer = np.pi * 0.1 / 3 * (0.03**2 + 0.03 * 0.04 + 0.04**2)
    inner = np.pi * 0.094 / 3 * (0.027**2 + 0.027 * 0.036 + 0.036**2)

    assert meshes.sphere(0.1, sides=120).volume == pytest.approx(4 / 3 * np.pi * 1e-3, rel=2e-3)
    assert meshes.lathe(CUP, sides=120).volume == pytest.approx(outer - inner, rel=2e-3)


@pytest.mark.parametrize("name", ["box", "bevelled box", "cylinder", "sphere", "tube", "cone"])
def test_a_solid_is_centred(name: str) -> None:
    vertices = SOLIDS[name].vertices

    assert np.allclose(vertices.min(axis=0) + vertices.max(axis=0), 0.0, atol=1e-9)


def test_a_bevel_keeps_the_size_and_takes_the_edges_off() -> None:
    sharp, blunt = SOLIDS["box"], SOLIDS["bevelled box"]

    assert np.allclose(np.ptp(blunt.vertices, axis=0), (0.1, 0.2, 0.3))
    assert 0.98 * sharp.volume < blunt.volume < sharp.volume


def test_a_box_is_shaded_flat_and_a_ball_round() -> None:
    box, ball = SOLIDS["box"], SOLIDS["sphere"]

    assert len(box.vertices) == 24
    assert np.allclose(box.normals[box.faces], face_normals(box)[:, None])
    assert np.allclose(ball.normals, ball.vertices / 0.1, atol=0.02)


def test_a_cylinder_is_round_on_its_side_and_flat_on_its_caps() -> None:
    mesh = SOLIDS["cylinder"]
    side = np.abs(mesh.normals[:, 2]) < 0.5

    radial = mesh.vertices[side, :2] / 0.05
    assert np.allclose(mesh.normals[side, :2], radial, atol=1e-5)
    assert np.allclose(np.abs(mesh.normals[~side]), (0, 0, 1), atol=1e-6)


def test_merging_moves_and_colours_the_parts() -> None:
    up = np.eye(4)
    up[2, 3] = 1.0
    cube = meshes.box((0.1, 0.1, 0.1))

    both = meshes.merge([(cube, np.eye(4), (255, 0, 0)), (cube, up, None)])

    assert both.volume == pytest.approx(2 * cube.volume)
    assert both.vertices[:, 2].max() == pytest.approx(1.05)
    assert both.colors is not None
    assert both.colors[:12].tolist() == [[255, 0, 0]] * 12
    assert both.colors[12:].tolist() == [[255, 255, 255]] * 12
    assert meshes.merge([(both, up, None)]).colors.tolist() == both.colors.tolist()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: meshes.box((0.1, 0.0, 0.1)), "three lengths"),
        (lambda: meshes.box((0.1, 0.1, 0.1), bevel=0.05), "bevel"),
        (lambda: meshes.tube(0.05, 0.03, 0.1), "inner < outer"),
        (lambda: meshes.lathe([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1)]), "closed line"),
    ],
)
def test_an_impossible_solid_is_refused(wrong, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        wrong()


def test_the_panda_is_complete_and_light() -> None:
    panda = meshes.load_panda()

    assert panda.keys() == PANDA_LINKS
    assert 8_000 < sum(len(mesh.faces) for mesh in panda.values()) < 11_000
    assert meshes.PANDA_FILE.stat().st_size < 600_000
    assert meshes.PANDA_FILE.with_suffix(".LICENSE.txt").read_text().count("Apache License")


def test_the_panda_s_shells_are_white_and_its_joints_dark() -> None:
    colors = np.concatenate([mesh.colors for mesh in meshes.load_panda().values()])
    brightness = colors.mean(axis=1)

    assert np.mean(brightness > 220) > 0.4
    assert np.mean(brightness < 80) > 0.2


def test_the_panda_s_links_look_outward_and_lie_in_their_link_s_frame() -> None:
    panda = meshes.load_panda()

    assert all(mesh.volume > 0 for mesh in panda.values())
    assert panda["panda_link0"].vertices[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    for side, name in ((1, "panda_leftfinger"), (-1, "panda_rightfinger")):
        finger = panda[name].vertices
        assert finger[:, 2].max() == pytest.approx(0.054, abs=1e-3)
        assert (finger[:, 1] * side).min() > -1e-3
