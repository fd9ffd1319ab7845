"""A layout made real: PyBullet bodies, their joints' mechanics, collision boxes and meshes.

A scene is built for one episode and closed after it, never restored: continuing from a saved
state differs from the uninterrupted run.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from hide_tasks.assets.asset import Asset, Joint, Link, Shape
from hide_tasks.bullet import meshes
from hide_tasks.bullet.client import Client
from hide_tasks.bullet.mechanics import SLOW, Mechanics, rest_motors
from hide_tasks.bullet.meshes import Mesh
from hide_tasks.layout import TABLE_TOP, Layout
from hide_tasks.poses import Array, matrix, pose

HZ = 240  # physics steps per second; 120 is too coarse for liquid
ITERATIONS = 50
TABLE = (1.2, 1.8, 0.04)  # m; its middle is TABLE_CENTER
TABLE_CENTER = (0.25, 0.0)


@dataclass(frozen=True)
class Part:
    """A rigid thing that is drawn: its name, its mesh."""

    name: str
    mesh: Mesh


class BulletBody:
    """An asset's body. Joint readings are taken once per physics step."""

    def __init__(self, client: Client, asset: Asset):
        self.client, self.asset = client, asset
        self.held_link: int | None = None
        self.readings = [link.joint.start if link.joint else 0.0 for link in asset.links]
        self.id = _create(client, asset)
        self.joints = list(range(len(asset.links) - 1))
        joints = [link.joint for link in asset.links[1:] if link.joint]
        self.limits = [(i, joint.lower, joint.upper) for i, joint in enumerate(joints, 1)]
        self.states: Sequence[Any] = ()
        rest_motors(client, self.id, joints)
        snaps = any(joint.detent for joint in joints)
        self.mechanics = Mechanics(client, self.id, asset) if snaps else None

    def refresh(self) -> None:
        """Read the joints; let springs, detents and interlocks act on what was read."""
        self.states = states = self.client.getJointStates(self.id, self.joints)
        for link, low, high in self.limits:
            reading = states[link - 1][0]
            self.readings[link] = low if reading < low else high if reading > high else reading
        if self.mechanics:
            self.mechanics.act(states, self.held_link)

    def joint(self, link: int) -> float:
        """The link's reading, clamped to its limits: Bullet's limits are soft."""
        return self.readings[link]

    def position(self) -> tuple[float, float, float]:
        """The base's position in the world."""
        x, y, z = self.client.getBasePositionAndOrientation(self.id)[0]
        return x, y, z

    def pose(self, link: int = 0) -> Array:
        """The link's pose (7,) in the world."""
        position, rotation = self.client.getBasePositionAndOrientation(self.id)
        base = np.array([*position, *rotation])
        if link == 0:
            return base
        return _jointed(base, self.asset.links[link].joint, self.readings[link])

    def held(self) -> bool:
        """True while the gripper holds a link."""
        return self.held_link is not None


def _jointed(base: Array, joint: Joint | None, reading: float) -> Array:
    assert joint is not None and joint.kind == "slide", "hinges arrive with the first hinged asset"
    moved = matrix(base) @ np.array([*(np.array(joint.axis) * reading), 1.0])
    return np.concatenate([moved[:3], base[3:]])


class Scene:
    """Table and assets in a PyBullet world of their own."""

    def __init__(self, layout: Layout):
        self.client = Client()
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=1 / HZ, numSolverIterations=ITERATIONS, deterministicOverlappingPairs=1
        )
        self.client.setGravity(0, 0, -9.81)
        self.table = self._table()
        self.assets = layout.assets
        self.bodies = [BulletBody(self.client, asset) for asset in self.assets]
        for asset, body in zip(self.assets, self.bodies, strict=True):
            asset.body = body
        self.moving = [body for body in self.bodies if body.joints]
        self.free = [body for body in self.bodies if body.asset.links[0].mass > 0]

    def close(self) -> None:
        """Free the world."""
        self.client.disconnect()

    def refresh(self) -> None:
        """Called after every physics step."""
        for body in self.moving:
            body.refresh()

    def still(self) -> bool:
        """True when no free body or joint moves faster than 1 cm/s."""
        for body in self.free:
            velocity, turning = self.client.getBaseVelocity(body.id)
            if max(map(abs, velocity)) > 0.01 or max(map(abs, turning)) > 0.1:
                return False
        return all(abs(state[1]) < SLOW for body in self.moving for state in body.states)

    def parts(self) -> list[Part]:
        """What is drawn, in the order of `poses`."""
        table = meshes.merge(
            [
                (meshes.box(TABLE, 0.004), np.eye(4), (198, 182, 160)),
                *(
                    (meshes.box((0.06, 0.06, 0.71)), _at(x, y, -0.375), (120, 110, 98))
                    for x, y in _LEGS
                ),
            ]
        )
        floor = meshes.merge([(meshes.box((8.0, 8.0, 0.01)), np.eye(4), (150, 152, 156))])
        named = _numbered([type(asset).__name__.lower() for asset in self.assets])
        return [
            Part("floor", floor),
            Part("table", table),
            *(
                Part(f"{name}/{link.name}", _mesh(link.shapes))
                for name, asset in zip(named, self.assets, strict=True)
                for link in asset.links
            ),
        ]

    def poses(self) -> NDArray[np.float64]:
        """(n, 4, 4) world transforms of the parts."""
        placed = [_FLOOR, _TABLE]
        for body in self.bodies:
            placed += [matrix(body.pose(link)) for link in range(len(body.asset.links))]
        return np.array(placed)

    def state(self) -> Iterator[float]:
        """Every position and velocity of every body, for the final state's hash."""
        for body in self.bodies:
            for vector in self.client.getBasePositionAndOrientation(body.id):
                yield from vector
            for vector in self.client.getBaseVelocity(body.id):
                yield from vector
            for joint in body.joints:
                yield from self.client.getJointState(body.id, joint)[:2]

    def _table(self) -> int:
        half = [length / 2 for length in TABLE]
        shape = self.client.createCollisionShape(bullet.GEOM_BOX, halfExtents=half)
        body = self.client.createMultiBody(0, shape, basePosition=_TABLE[:3, 3].tolist())
        self.client.changeDynamics(body, -1, lateralFriction=0.8)
        return int(body)


def _at(x: float, y: float, z: float) -> Array:
    return matrix(pose(x, y, z))


_TABLE = _at(*TABLE_CENTER, TABLE_TOP - TABLE[2] / 2)
_FLOOR = _at(0.25, 0.0, -0.005)
_LEGS = [(x, y) for x in (-0.53, 0.53) for y in (-0.83, 0.83)]


def _numbered(names: list[str]) -> list[str]:
    return [f"{n}_{names[:i].count(n)}" if names.count(n) > 1 else n for i, n in enumerate(names)]


@lru_cache(maxsize=256)
def _mesh(shapes: tuple[Shape, ...]) -> Mesh:
    makers = {
        "box": lambda s: meshes.box(s.size, s.bevel),
        "cylinder": lambda s: meshes.cylinder(s.size[0], s.size[1], bevel=s.bevel),
        "sphere": lambda s: meshes.sphere(s.size[0]),
        "lathe": lambda s: meshes.lathe(list(zip(s.size[::2], s.size[1::2], strict=True))),
    }
    return meshes.merge(
        [(makers[s.kind](s), matrix(np.array(s.at)), s.color) for s in shapes if s.seen]
    )


def _collision(client: Client, link: Link) -> int:
    solid = [shape for shape in link.shapes if shape.solid]
    if not solid:
        return -1
    kinds = {"box": bullet.GEOM_BOX, "cylinder": bullet.GEOM_CYLINDER, "sphere": bullet.GEOM_SPHERE}
    boxes = [[length / 2 for length in s.size] if s.kind == "box" else [0.0] * 3 for s in solid]
    return int(
        client.createCollisionShapeArray(
            shapeTypes=[kinds[s.kind] for s in solid],
            halfExtents=boxes,
            radii=[0.0 if s.kind == "box" else s.size[0] for s in solid],
            lengths=[s.size[1] if s.kind == "cylinder" else 0.0 for s in solid],
            collisionFramePositions=[s.at[:3] for s in solid],
            collisionFrameOrientations=[s.at[3:] for s in solid],
        )
    )


def _create(client: Client, asset: Asset) -> int:
    base, *children = asset.links
    count = len(children)
    kinds = {"slide": bullet.JOINT_PRISMATIC, "hinge": bullet.JOINT_REVOLUTE}
    joints = [link.joint for link in children if link.joint]
    body = client.createMultiBody(
        baseMass=base.mass,
        baseCollisionShapeIndex=_collision(client, base),
        basePosition=asset.at[:3].tolist(),
        baseOrientation=asset.at[3:].tolist(),
        linkMasses=[link.mass for link in children],
        linkCollisionShapeIndices=[_collision(client, link) for link in children],
        linkVisualShapeIndices=[-1] * count,
        linkPositions=[[0, 0, 0]] * count,
        linkOrientations=[[0, 0, 0, 1]] * count,
        linkInertialFramePositions=[[0, 0, 0]] * count,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * count,
        linkParentIndices=[0] * count,
        linkJointTypes=[kinds[joint.kind] for joint in joints],
        linkJointAxis=[joint.axis for joint in joints],
    )
    for index, link in enumerate(asset.links, -1):
        client.changeDynamics(body, index, lateralFriction=link.friction)
        if link.joint:
            client.changeDynamics(
                body, index, jointLowerLimit=link.joint.lower, jointUpperLimit=link.joint.upper
            )
            client.resetJointState(body, index, link.joint.start)
    return int(body)
