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
from hide_tasks.assets.seat import Seat
from hide_tasks.bullet import meshes
from hide_tasks.bullet.client import Client
from hide_tasks.bullet.mechanics import SLOW, Mechanics, rest_motors
from hide_tasks.bullet.meshes import Mesh
from hide_tasks.layout import TABLE_TOP, Layout
from hide_tasks.poses import (
    Array,
    compose,
    from_rotation_vector,
    matrix,
    point,
    pose,
    rotation_matrix,
)

HZ = 240  # physics steps per second; 120 is too coarse for liquid
ITERATIONS = 50
TABLE = (1.2, 1.8, 0.04)  # m; its middle is TABLE_CENTER
TABLE_CENTER = (0.25, 0.0)
UNSEEN = 1e-6  # scale of what is not to be seen: it covers no pixel
SMALL = 0.01  # m: a ball of less is drawn with fewer faces


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
        self.joints = list(range(len(asset.links) - 1))  # Bullet's numbers of the links
        joints = [(i, link.joint) for i, link in enumerate(asset.links) if link.joint]
        self.limits = [(i, joint.lower, joint.upper) for i, joint in joints]
        self.states: Sequence[Any] = ()
        rest_motors(client, self.id, asset)
        snaps = any(joint.detent for _, joint in joints)
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

    def load(self, link: int = 0) -> float:
        """How hard other things press on the link, N."""
        touching = self.client.getContactPoints(bodyA=self.id, linkIndexA=link - 1)
        return float(sum(point[9] for point in touching))

    def place(self, pose: Array) -> None:
        """Put the base at a pose (7,), at rest."""
        self.client.resetBasePositionAndOrientation(self.id, pose[:3].tolist(), pose[3:].tolist())
        self.client.resetBaseVelocity(self.id, [0, 0, 0], [0, 0, 0])

    def held(self) -> bool:
        """True while the gripper holds a link."""
        return self.held_link is not None


def _jointed(base: Array, joint: Joint | None, reading: float) -> Array:
    if joint is None:
        return base
    along = np.array(joint.axis, dtype=np.float64) * reading
    if joint.kind == "slide":
        return np.concatenate([point(base, *along), base[3:]])
    origin, turned = np.array(joint.origin, dtype=np.float64), from_rotation_vector(along)
    moved = origin - rotation_matrix(turned) @ origin
    return compose(base, np.concatenate([moved, turned]))


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
        self.lively = [asset for asset in self.assets if type(asset).act is not Asset.act]
        self.seats = layout.seats

    def close(self) -> None:
        """Free the world."""
        self.client.disconnect()

    def refresh(self) -> None:
        """Called after every physics step."""
        for body in self.moving:
            body.refresh()
        for seat in self.seats:
            if seat.taken and seat.firm:
                self._keep(seat)
        for asset in self.lively:
            asset.act()

    def let_go(self, body: BulletBody) -> None:
        """Called when the gripper let go of a body: it may come to stand in a seat."""
        for seat in self.seats:
            sits = seat.offers(body.pose()) if seat.thing is body.asset else None
            if sits is not None:
                body.place(sits)
                seat.taken = True

    def seated_firmly(self, body: BulletBody) -> bool:
        """True while a firm seat keeps the body where it is."""
        return any(s.firm and s.taken and s.thing is body.asset for s in self.seats)

    def _keep(self, seat: Seat) -> None:
        if seat.thing.body.held():
            seat.taken = False
        else:
            seat.thing.body.place(seat.at)

    def still(self) -> bool:
        """True when no free body or joint moves faster than 1 cm/s."""
        for body in self.free:
            velocity, turning = self.client.getBaseVelocity(body.id)
            if max(map(abs, velocity)) > 0.01 or max(map(abs, turning)) > 0.1:
                return False
        if not all(asset.at_rest for asset in self.lively):
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
            placed += [_drawn(body.asset, link) for link in range(len(body.asset.links))]
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


def _drawn(asset: Asset, link: int) -> Array:
    at = asset.drawn(link)
    if at is not None:
        return matrix(at)
    nowhere = np.diag([UNSEEN, UNSEEN, UNSEEN, 1.0])
    nowhere[:3, 3] = asset.at[:3]
    return nowhere


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
        "sphere": lambda s: meshes.sphere(s.size[0], sides=10 if s.size[0] < SMALL else 20),
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
    origin = _origin(link)
    return int(
        client.createCollisionShapeArray(
            shapeTypes=[kinds[s.kind] for s in solid],
            halfExtents=boxes,
            radii=[0.0 if s.kind == "box" else s.size[0] for s in solid],
            lengths=[s.size[1] if s.kind == "cylinder" else 0.0 for s in solid],
            collisionFramePositions=[(np.array(s.at[:3]) - origin).tolist() for s in solid],
            collisionFrameOrientations=[s.at[3:] for s in solid],
        )
    )


def _origin(link: Link) -> Array:
    """Where Bullet has the link's frame: on the hinge's axis."""
    hinged = link.joint is not None and link.joint.kind == "hinge"
    return np.array(link.joint.origin if hinged and link.joint else (0.0, 0.0, 0.0))


def _middle(link: Link) -> list[float]:
    """A hinged link's centre of mass in Bullet's frame of it; gravity does not turn a slide."""
    solid = [shape for shape in link.shapes if shape.solid and shape.kind == "box"]
    if not solid or link.joint is None or link.joint.kind != "hinge":
        return [0.0, 0.0, 0.0]
    volumes = [float(np.prod(shape.size)) for shape in solid]
    middle = np.average([shape.at[:3] for shape in solid], axis=0, weights=volumes)
    return [float(x) for x in middle - _origin(link)]


def _create(client: Client, asset: Asset) -> int:
    base, *children = asset.links
    count = len(children)
    body = client.createMultiBody(
        baseMass=base.mass,
        baseCollisionShapeIndex=_collision(client, base),
        basePosition=asset.at[:3].tolist(),
        baseOrientation=asset.at[3:].tolist(),
        linkMasses=[link.mass for link in children],
        linkCollisionShapeIndices=[_collision(client, link) for link in children],
        linkVisualShapeIndices=[-1] * count,
        linkPositions=[_origin(link).tolist() for link in children],
        linkOrientations=[[0, 0, 0, 1]] * count,
        linkInertialFramePositions=[_middle(link) for link in children],
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * count,
        linkParentIndices=[0] * count,
        linkJointTypes=[_KINDS[link.joint.kind if link.joint else None] for link in children],
        linkJointAxis=[link.joint.axis if link.joint else (0, 0, 1) for link in children],
    )
    for index, link in enumerate(asset.links, -1):
        client.changeDynamics(body, index, lateralFriction=link.friction)
        if link.damping:
            client.changeDynamics(body, index, linearDamping=link.damping)
        if link.joint:
            client.changeDynamics(
                body, index, jointLowerLimit=link.joint.lower, jointUpperLimit=link.joint.upper
            )
            client.resetJointState(body, index, link.joint.start)
    return int(body)


_KINDS = {
    "slide": bullet.JOINT_PRISMATIC,
    "hinge": bullet.JOINT_REVOLUTE,
    None: bullet.JOINT_FIXED,
}
