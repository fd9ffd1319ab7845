"""The scene as boxes for the planner, and what is in the hand as spheres."""

import numpy as np

from hide_tasks.assets.asset import Shape
from hide_tasks.bullet.collision import Obstacles
from hide_tasks.bullet.frames import tip_pose
from hide_tasks.bullet.robot import Robot
from hide_tasks.bullet.scene import TABLE, TABLE_CENTER, BulletBody
from hide_tasks.layout import TABLE_TOP
from hide_tasks.poses import Array, matrix


def of(robot: Robot) -> tuple[Obstacles, Array]:
    """Every solid part that is not in the hand, and (m, 4) spheres in the tip's frame that are."""
    held = robot.grasped
    placed = [(_table(), np.array(TABLE) / 2)]
    carried: list[tuple[Array, Array]] = []
    for body in (body for body in robot.scene.bodies if body.asset.avoided):
        for link, part in enumerate(body.asset.links):
            boxes = _boxes(body, link, [shape for shape in part.shapes if shape.solid])
            if held is None or held[0] is not body:
                placed += boxes
            elif held[1] == 0:  # a loose thing comes along with all that is on it
                carried += boxes
            elif held[1] != link:
                placed += boxes
    centers = np.array([transform[:3, 3] for transform, _ in placed])
    rotations = np.array([transform[:3, :3] for transform, _ in placed])
    return Obstacles(centers, rotations, np.array([half for _, half in placed])), _spheres(
        robot, carried
    )


def _table() -> Array:
    transform = np.eye(4)
    transform[:3, 3] = (*TABLE_CENTER, TABLE_TOP - TABLE[2] / 2)
    return transform


def _boxes(body: BulletBody, link: int, shapes: list[Shape]) -> list[tuple[Array, Array]]:
    if not shapes:
        return []
    base = matrix(body.pose(link))
    return [(base @ matrix(np.array(shape.at)), _half(shape)) for shape in shapes]


def _half(shape: Shape) -> Array:
    if shape.kind == "box":
        return np.array(shape.size) / 2
    if shape.kind == "cylinder":
        radius, height = shape.size
        return np.array([radius, radius, height / 2])
    return np.full(3, shape.size[0])


def _spheres(robot: Robot, boxes: list[tuple[Array, Array]]) -> Array:
    """One sphere per cell of a 3 x 3 x 3 grid in every carried box."""
    if not boxes:
        return np.empty((0, 4))
    to_tip = np.linalg.inv(tip_pose(robot.joints))
    found = []
    for transform, half in boxes:
        cells = np.stack(np.meshgrid(*[[-2 / 3, 0, 2 / 3]] * 3), axis=-1).reshape(-1, 3) * half
        local = to_tip @ transform
        radius = float(half.min()) / 3
        found += [(*(local[:3, :3] @ cell + local[:3, 3]), radius) for cell in cells]
    return np.array(found)
