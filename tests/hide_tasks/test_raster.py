"""Depth, ids and colours are those of the geometry, and the same in every process."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from hide_tasks.bullet import meshes
from hide_tasks.bullet.cameras import Camera, camera, intrinsics_for, looking, wrist_camera
from hide_tasks.bullet.meshes import Mesh
from hide_tasks.bullet.raster import NO_INSTANCE, Images, Renderer
from hide_tasks.bullet.raster_shade import Lighting

Array = NDArray[np.float64]

TABLE_TOP = 0.752  # m
FIXED = ("front", "left_shoulder", "right_shoulder")
EXACT = 1e-4  # m
LIGHT = Lighting()
TO_SUN = LIGHT.to_sun / np.linalg.norm(LIGHT.to_sun)


def at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = (x, y, z)
    return pose


def down(x: float = 0.0, y: float = 0.0, z: float = 1.0, size: int = 64) -> Camera:
    """A camera that looks straight down, the world's x to the right in its image."""
    pose = at(x, y, z)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return Camera(size, size, intrinsics_for("front", size, size), pose)


def world_points(images: Images, cameras: list[Camera], index: int) -> Array:
    """World position (h, w, 3) of every pixel centre of one image."""
    view = cameras[index]
    rows, columns = np.indices((view.height, view.width)) + 0.5
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(view.intrinsics).T
    points = rays * images.depth[index].astype(np.float64)[..., None]
    return points @ view.camera_to_world[:3, :3].T + view.camera_to_world[:3, 3]


def desk() -> tuple[list[Mesh], Array]:
    """Table, bevelled box, cup, ball."""
    cup = meshes.lathe([(0, 0), (0.03, 0), (0.04, 0.1), (0.036, 0.1), (0.027, 0.006), (0, 0.006)])
    parts = [
        (meshes.box((1.0, 1.2, 0.04)), at(0.2, 0.0, TABLE_TOP - 0.02)),
        (meshes.box((0.1, 0.1, 0.2), bevel=0.004), at(0.3, 0.1, TABLE_TOP + 0.1)),
        (cup, at(0.2, -0.15, TABLE_TOP)),
        (meshes.sphere(0.05), at(0.1, 0.2, TABLE_TOP + 0.05)),
    ]
    return [mesh for mesh, _ in parts], np.array([pose for _, pose in parts])


def benchmark_cameras(size: int = 128) -> list[Camera]:
    """The three fixed cameras, and the wrist's with the hand held over the desk, tilted."""
    hand = at(0.2, 0.0, TABLE_TOP + 0.3)
    c, s = np.cos(0.2), np.sin(0.2)
    hand[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.diag([1.0, -1.0, -1.0])
    return [*(camera(name, size, size) for name in FIXED), wrist_camera(hand, size, size)]


def digest(images: Images) -> str:
    return hashlib.sha256(b"".join(array.tobytes() for array in images)).hexdigest()


def desk_digest() -> str:
    shapes, poses = desk()
    return digest(Renderer(shapes).render(benchmark_cameras(), poses))


@pytest.mark.parametrize("index", range(4), ids=[*FIXED, "wrist"])
def test_the_depth_of_the_table_projects_back_onto_it(index: int) -> None:
    shapes, poses = desk()
    cameras = benchmark_cameras()

    images = Renderer(shapes).render(cameras, poses)

    table = world_points(images, cameras, index)[images.ids[index] == 0]
    top = table[table[:, 2] > TABLE_TOP - 0.002]
    assert len(top) > 2000
    assert np.abs(top[:, 2] - TABLE_TOP).max() < EXACT


def test_the_depth_of_a_ball_projects_back_onto_its_faces() -> None:
    cameras = benchmark_cameras(256)
    images = Renderer([meshes.sphere(0.1, sides=200)]).render(cameras, at(0.25, 0, TABLE_TOP)[None])

    points = world_points(images, cameras, 0)[images.ids[0] == 0]

    radius = np.linalg.norm(points - (0.25, 0, TABLE_TOP), axis=1)
    assert len(points) > 500
    assert np.abs(radius - 0.1).max() < EXACT


def test_ids_name_the_nearest_instance() -> None:
    cube = meshes.box((0.1, 0.1, 0.1))
    poses = np.array([at(0, 0, 0), at(0, 0, 0.2), at(0.2, 0, 0)])

    ids = Renderer([cube] * 3).render([down()], poses).ids[0]

    assert set(ids.ravel()) == {NO_INSTANCE, 1, 2}
    assert ids[32, 32] == 1
    assert ids[0, 0] == NO_INSTANCE


def test_an_instance_lies_where_the_pinhole_projects_it() -> None:
    view = camera("left_shoulder", 256, 256)
    point = np.array([0.4, -0.1, 0.9])
    image = view.intrinsics @ view.camera_to_world[:3, :3].T @ (point - view.camera_to_world[:3, 3])

    ids = Renderer([meshes.sphere(0.03)]).render([view], at(*point)[None]).ids[0]

    rows, columns = np.nonzero(ids == 0)
    assert columns.mean() + 0.5 == pytest.approx(image[0] / image[2], abs=0.3)
    assert rows.mean() + 0.5 == pytest.approx(image[1] / image[2], abs=0.3)


def test_the_background_is_far_and_invisible_instances_are_background() -> None:
    view = down()
    renderer = Renderer([meshes.box((5, 5, 0.1))])

    images = renderer.render([view], np.eye(4)[None], visible=np.array([False]))

    assert (images.ids == NO_INSTANCE).all()
    assert np.allclose(images.depth, view.far)


def test_what_is_beyond_far_is_background() -> None:
    images = Renderer([meshes.box((9, 9, 0.1))]).render([down(z=5.0)], np.eye(4)[None])

    assert (images.ids == NO_INSTANCE).all()


def test_a_face_is_seen_from_its_front_only() -> None:
    triangle = meshes.shaded(
        np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    )
    from_below = down(z=-1.0)
    from_below.camera_to_world[:3, :3] = np.diag([1.0, 1.0, 1.0])

    images = Renderer([triangle]).render([down(), from_below], np.eye(4)[None])

    assert images.ids[0, 32, 32] == 0
    assert (images.ids[1] == NO_INSTANCE).all()


def test_a_floor_under_and_behind_the_camera_is_cut_at_the_near_plane() -> None:
    level = Camera(
        64, 64, intrinsics_for("wrist", 64, 64), looking(*np.array([[0, 0, 0.05], [1, 0, 0]]))
    )
    level = Camera(64, 64, level.intrinsics, level.camera_to_world, near=0.12, far=40.0)

    images = Renderer([meshes.box((30, 30, 0.1))]).render([level], at(0, 0, -0.05)[None])

    seen = images.ids[0] == 0
    depth = 0.05 * level.intrinsics[1, 1] / (np.arange(64) + 0.5 - 32)  # of the floor, per row
    assert (seen == ((depth > 0.12) & (depth < 15.0))[:, None]).all()
    assert seen.any() and not seen[-1].any()
    assert np.allclose(images.depth[0][seen.all(axis=1), 0], depth[seen.all(axis=1)], rtol=1e-6)


def test_inside_a_closed_box_nothing_is_seen() -> None:
    images = Renderer([meshes.box((3, 3, 3))]).render(benchmark_cameras(32), at(0, 0, 1.4)[None])

    assert (images.ids == NO_INSTANCE).all()


def test_no_pixel_is_missed_between_faces() -> None:
    """A grid whose corners and edges fall exactly on pixel centres."""
    view = down(size=64)
    step = 1.0 / view.intrinsics[0, 0]  # m per pixel on the plane z = 0
    lines = (np.arange(-40, 41) + 0.5) * step
    x, y = np.meshgrid(lines, lines)
    corner = np.arange(80 * 81).reshape(80, 81)[:, :-1].ravel()
    quads = np.stack([corner, corner + 1, corner + 82, corner, corner + 82, corner + 81], axis=-1)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)
    grid = Mesh(points, np.tile([0.0, 0, 1], (x.size, 1)), quads.reshape(-1, 3).astype(np.int32))

    images = Renderer([grid]).render([view], np.eye(4)[None])

    assert (images.ids == 0).all()
    assert np.abs(images.depth - 1.0).max() < 1e-6


def test_a_flat_face_has_the_colour_that_its_light_makes() -> None:
    expected = 180 * np.sqrt(LIGHT.sky + LIGHT.sun * TO_SUN[2]) * np.array([1.0, 0.5, 0.0])
    dull = Lighting(shine=0.0)
    color = np.array([[180, 90, 0]], dtype=np.uint8)
    dull_box, box = (Renderer([meshes.box((1, 1, 0.1))], color, lighting=x) for x in (dull, LIGHT))

    rgb, glossy = (r.render([down(z=1.2)], at(0.2, 0, 0)[None]).rgb[0] for r in (dull_box, box))

    assert np.abs(rgb[16:48, 16:48] - expected).max() <= 1
    highlight = glossy.astype(int) - rgb
    assert (highlight >= 0).all() and highlight.max() <= 255 * LIGHT.shine


def test_a_ball_is_brightest_where_it_faces_the_sun() -> None:
    renderer = Renderer([meshes.sphere(0.2, sides=60)], np.array([[150, 150, 150]], dtype=np.uint8))
    light = renderer.render([down(z=1.2)], np.eye(4)[None]).rgb[0, :, :, 0].astype(float)
    rows, columns = np.nonzero(light == light.max())
    middle = np.array([columns.mean() - 31.5, 31.5 - rows.mean()])

    toward_sun = middle / np.linalg.norm(middle) @ (TO_SUN[:2] / np.linalg.norm(TO_SUN[:2]))

    assert toward_sun > 0.98
    assert light.max() > 1.2 * light[light > 0].min()


def test_a_pillar_throws_its_shadow_away_from_the_sun() -> None:
    shapes = [meshes.box((1, 1, 0.02)), meshes.box((0.06, 0.06, 0.3))]
    poses = np.array([at(0.15, 0, 0.79), at(0.15, 0, 0.95)])
    shaded, plain = (Renderer(shapes, shadow_pixels=n) for n in (256, 0))
    view = down(0.15, 0.0, 2.2, 128)

    dark, bright = (r.render([view], poses).rgb[0].astype(float) for r in (shaded, plain))

    ratio = dark.mean(axis=2) / bright.mean(axis=2)
    floor = shaded.render([view], poses).ids[0] == 0
    rows, columns = np.nonzero(floor & (ratio < 0.8))
    away = np.array([columns.mean() - 63.5, 63.5 - rows.mean()])
    assert len(rows) > 20
    assert away / np.linalg.norm(away) @ (-TO_SUN[:2] / np.linalg.norm(TO_SUN[:2])) > 0.97
    lit = LIGHT.sky + LIGHT.sun * TO_SUN[2]
    shade = LIGHT.sky + LIGHT.sun * TO_SUN[2] * (1 - LIGHT.shadow)
    assert ratio[floor].min() == pytest.approx(np.sqrt(shade / lit), abs=0.03)


def test_nothing_shades_itself() -> None:
    shapes = [meshes.sphere(0.15, sides=40), meshes.cylinder(0.1, 0.3), meshes.box((0.2, 0.2, 0.2))]
    poses = np.array([at(0.15, -0.4, 0.95), at(0.15, 0.0, 0.95), at(0.15, 0.4, 0.95)])
    views = [camera("front"), camera("left_shoulder")]

    with_map, without = (
        Renderer(shapes, shadow_pixels=n).render(views, poses).rgb.astype(int) for n in (256, 0)
    )

    assert np.abs(with_map - without).max() <= 12
    assert np.mean(np.abs(with_map - without) > 2) < 0.002


def test_named_colours_stay_apart() -> None:
    names = {"red": (255, 0, 0), "maroon": (128, 0, 0), "orange": (255, 128, 0)}
    names |= {"rose": (255, 0, 128)}
    cubes = [meshes.box((0.1, 0.1, 0.1))] * len(names)
    poses = np.array([at(0.2 * i - 0.3, 0, 0) for i in range(len(names))])
    renderer = Renderer(cubes, np.array(list(names.values()), dtype=np.uint8))

    images = renderer.render([down(z=1.5)], poses)

    seen = np.array([np.median(images.rgb[0][images.ids[0] == i], axis=0) for i in range(4)])
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=-1) + 1000 * np.eye(4)
    assert apart.min() > 80
    assert np.abs(seen - list(names.values())).max() < 40


def test_colours_of_a_call_replace_those_of_the_instances() -> None:
    lamp = meshes.merge([(meshes.sphere(0.1), np.eye(4), (255, 255, 255))])
    renderer = Renderer([lamp], np.array([[90, 90, 90]], dtype=np.uint8))
    pose = np.eye(4)[None]

    off = renderer.render([down()], pose).rgb[0, 32, 32]
    lit = renderer.render([down()], pose, colors=np.array([[255, 240, 120]])).rgb[0, 32, 32]
    again = renderer.render([down()], pose).rgb[0, 32, 32]

    assert lit[0] > off[0] + 80 and lit[2] < lit[0] - 80
    assert (again == off).all()


def test_supersampling_smooths_colours_and_leaves_depth_and_ids() -> None:
    shapes, poses = desk()
    renderer = Renderer(shapes)
    cameras = benchmark_cameras(96)

    plain, smooth = (renderer.render(cameras, poses, supersample=n) for n in (1, 2))

    assert (plain.depth == smooth.depth).all() and (plain.ids == smooth.ids).all()
    difference = np.abs(plain.rgb.astype(int) - smooth.rgb).max(axis=-1)
    assert 0.01 < np.mean(difference > 8) < 0.15
    assert np.median(difference) <= 1


def test_the_wrist_camera_sees_the_fingertips_and_between_them_the_grasp() -> None:
    hand = at(0.3, 0.1, 1.2)
    hand[:3, :3] = np.diag([1.0, -1.0, -1.0])
    view = wrist_camera(hand)
    tips = np.array([[0, 0.04, 0.112, 1], [0, -0.04, 0.112, 1], [0, 0, 0.105, 1]])

    points = (np.linalg.inv(view.camera_to_world) @ hand @ tips.T)[:3]
    columns, rows = (view.intrinsics @ points)[:2] / points[2]

    assert (rows > 85).all() and (rows < 120).all()
    assert columns.tolist() == pytest.approx([64 + 42, 64 - 42, 64], abs=4)


def test_two_renderings_and_another_process_give_the_same_bits() -> None:
    here = desk_digest()
    code = (
        f"import sys; sys.path[:0] = {sys.path!r}; import test_raster as t; print(t.desk_digest())"
    )

    there = subprocess.run(
        [sys.executable, "-c", code],
        cwd=__file__.rpartition("/")[0],
        capture_output=True,
        text=True,
        check=True,
    )

    assert desk_digest() == here
    assert there.stdout.strip() == here


def test_an_order_of_calls_leaves_no_trace() -> None:
    shapes, poses = desk()
    renderer = Renderer(shapes)
    cameras = benchmark_cameras()
    first = digest(renderer.render(cameras, poses))

    renderer.render(benchmark_cameras(200)[::-1], poses[::-1].copy(), supersample=2)

    assert digest(renderer.render(cameras, poses)) == first


def test_wrong_sizes_are_refused() -> None:
    renderer = Renderer([meshes.sphere(0.1)] * 2)
    poses = np.tile(np.eye(4), (2, 1, 1))

    with pytest.raises(ValueError, match=r"poses of shape \(1, 4, 4\): want \(2, 4, 4\)"):
        renderer.render([down()], poses[:1])
    with pytest.raises(ValueError, match="all of one size"):
        renderer.render([down(), down(size=32)], poses)
    with pytest.raises(ValueError, match="colors of shape"):
        renderer.render([down()], poses, colors=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="No fixed camera 'overhead'"):
        camera("overhead")
