"""The Panda: follows joint paths, opens and closes its fingers, holds what both of them touch.

Grasping follows RLBench: when the fingers close on a graspable link it is fixed to the hand. Of
the ways to do so this one drifted least (0.00 mm in 50 transports): close, look for the link
within 2 mm of both fingers, fix it, stop squeezing, let hand and link pass through each other.
"""

import atexit
import itertools
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pybullet as bullet
import pybullet_data

from hide_tasks.assets.asset import Asset
from hide_tasks.bullet import frames, joint_space, kinematics, meshes, transforms
from hide_tasks.bullet.scene import HZ, BulletBody, Part, Scene
from hide_tasks.layout import TABLE_TOP
from hide_tasks.poses import Array, matrix

ARM = list(range(7))
HAND, FINGERS, TIP = 8, (9, 10), 11
WIDTH = 0.04  # m that each finger opens
FORCES = [87.0] * 7  # N m
POSITION_GAINS, VELOCITY_GAINS = [0.3] * 7, [1.0] * 7
GRIP = 20.0  # N
GRADE = 2e-4  # m by which the fingers can hold wider: where the arm was shows in micrometres
DIGITS = 3  # of the opening: 0.08 mm
HOLD = 300.0  # N at which a held thing gives way
NEAR = 0.002  # m between finger and link that counts as touching
JOINT_SPEED = 1.6  # rad/s, peak
TIP_SPEED = 0.6  # m/s, peak
RAMP = 2 / 3  # of a dense row, until its target is told in full; at once, things would be jerked
SETTLED = 2e-3  # rad from the target: put exactly there, so that no history is left in it
BLOCKED = 0.02  # rad from the target: something was in the way
LINKS = ("panda_link0", *(f"panda_link{i}" for i in range(1, 8)))


@lru_cache(maxsize=1)
def _urdf() -> str:
    """A file with the Panda without its visual meshes, which the renderer has already."""
    folder = Path(pybullet_data.getDataPath(), "franka_panda")
    text = (folder / "panda.urdf").read_text()
    text = re.sub(r"<visual>.*?</visual>", "", text, flags=re.DOTALL)
    text = text.replace("package://", f"{folder}/")
    handle, path = tempfile.mkstemp(suffix=".urdf")
    with os.fdopen(handle, "w") as file:
        file.write(text)
    atexit.register(Path(path).unlink, missing_ok=True)
    return path


class Robot:
    """One Panda in a scene. `step` advances the world by one physics step."""

    def __init__(self, scene: Scene, step: Callable[[], None]):
        self.scene, self.client, self.step = scene, scene.client, step
        self.id: int = self.client.loadURDF(_urdf(), frames.BASE.tolist(), useFixedBase=True)
        self._constraint: int | None = None
        self._grasped: tuple[BulletBody, int] | None = None
        self._mimic()
        self._place(kinematics.HOME)
        for finger in FINGERS:
            self.client.resetJointState(self.id, finger, WIDTH)
        self.open_fingers = True
        self._drive_fingers(WIDTH)

    # --- readings ---

    @property
    def joints(self) -> Array:
        """(7,) rad."""
        return np.array([state[0] for state in self.client.getJointStates(self.id, ARM)])

    @property
    def tip_pose(self) -> Array:
        """(7,) of the tip in the world."""
        return transforms.matrix_to_pose(frames.tip_pose(self.joints))

    @property
    def tip_height(self) -> float:
        """Of the tip above the table, m."""
        state = self.client.getLinkState(self.id, TIP)
        return float(state[4][2]) - TABLE_TOP

    @property
    def opening(self) -> float:
        """0 shut, 1 open."""
        return round(float(np.clip(self._gap() / (2 * WIDTH), 0.0, 1.0)), DIGITS)

    @property
    def grasped(self) -> tuple[BulletBody, int] | None:
        """The body and link in the hand."""
        return self._grasped

    def holds(self, asset: Asset) -> bool:
        """True while the gripper holds the asset."""
        return self._grasped is not None and self._grasped[0].asset is asset

    # --- motions ---

    def follow(self, path: Array) -> bool:
        """True when the arm came to the end of a joint path (n, 7); else it was blocked."""
        for target in timed(path):
            self._aim(target)
            self.step()
        self._settle(path[-1])
        arrived = bool(np.abs(self.joints - path[-1]).max() <= BLOCKED)
        if not arrived:
            self._aim(self.joints)
        return arrived

    def rest(self) -> None:
        """Put the arm exactly where it was sent, if it is there but for what gravity does."""
        if np.abs(self.joints - self.target).max() < SETTLED:
            self._place(self.target)

    def servo(self, target: Array, steps: int) -> None:
        """Send the joints evenly to a target, then let the arm catch up; so many physics steps."""
        start, goal = self.target, np.clip(target, joint_space.LOWER, joint_space.UPPER)
        for step in range(1, steps + 1):
            self._aim(start + (goal - start) * min(step / (RAMP * steps), 1.0))
            self.step()

    def set_fingers(self, opened: bool) -> None:
        """Open or close the fingers, letting go of or taking hold of what is between them."""
        if opened == self.open_fingers:
            return
        self.open_fingers = opened
        if opened:
            self._open()
        else:
            self._close()

    # --- parts ---

    def parts(self) -> list[Part]:
        """What is drawn, in the order of `poses`."""
        return [Part(f"robot/{name}", mesh) for name, mesh in _panda().items()]

    def poses(self) -> Iterator[Array]:
        """The world transforms (4, 4) of the parts."""
        states = self.client.getLinkStates(self.id, list(range(TIP)))
        for name in _panda():
            index = _link_index(name)
            if index < 0:
                yield _BASE
            else:
                yield matrix(np.array([*states[index][4], *states[index][5]]))

    def state(self) -> Iterator[float]:
        """Every joint's position and velocity, for the final state's hash."""
        for joint in (*ARM, *FINGERS):
            yield from self.client.getJointState(self.id, joint)[:2]

    # --- inside ---

    def _mimic(self) -> None:
        gear = self.client.createConstraint(
            self.id, 9, self.id, 10, bullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        self.client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)

    def _place(self, joints: Array) -> None:
        for joint, value in zip(ARM, joints.tolist(), strict=True):
            self.client.resetJointState(self.id, joint, value)
        self._aim(joints)

    def _aim(self, joints: Array) -> None:
        self.target = joints
        self.client.setJointMotorControlArray(
            self.id,
            ARM,
            bullet.POSITION_CONTROL,
            targetPositions=joints.tolist(),
            forces=FORCES,
            positionGains=POSITION_GAINS,
            velocityGains=VELOCITY_GAINS,
        )

    def _settle(self, target: Array) -> None:
        for step in range(HZ // 4):
            self.step()
            if step % 4 == 3:
                states = self.client.getJointStates(self.id, ARM)
                off = max(abs(s[0] - t) for s, t in zip(states, target.tolist(), strict=True))
                if off < SETTLED / 2 and max(abs(s[1]) for s in states) < 0.01:
                    return

    def _drive_fingers(self, width: float, force: float = GRIP) -> None:
        self.client.setJointMotorControlArray(
            self.id,
            list(FINGERS),
            bullet.POSITION_CONTROL,
            targetPositions=[width] * 2,
            forces=[force] * 2,
        )

    def _run_fingers(self, width: float, seconds: float) -> None:
        self._drive_fingers(width)
        for step in range(int(seconds * HZ)):
            self.step()
            states = self.client.getJointStates(self.id, list(FINGERS))
            if step > 12 and max(abs(state[1]) for state in states) < 1e-3:
                break

    def _close(self) -> None:
        self._run_fingers(0.0, 0.4)
        found = self._between_fingers()
        if found is None:
            self._put_fingers(0.0)
            return
        body, link = found
        if self.scene.seated_firmly(body):
            self.rest()  # how it lies in the hand is the same for every posture of the arm
        self._grasped, body.held_link = found, link
        self._constraint = self._fix(body, link)
        self._stand_fingers(round(self._gap() / (2 * GRADE)) * GRADE)
        self._let_pass(body, link, passing=True)

    def _open(self) -> None:
        grasped, self._grasped = self._grasped, None
        if self._constraint is not None:
            self.client.removeConstraint(self._constraint)
            self._constraint = None
        self._run_fingers(WIDTH, 0.4)
        self._put_fingers(WIDTH)
        if grasped:
            body, link = grasped
            body.held_link = None
            self._let_pass(body, link, passing=False)
            self.scene.let_go(body)

    def _gap(self) -> float:
        """m between the fingers."""
        return float(sum(s[0] for s in self.client.getJointStates(self.id, list(FINGERS))))

    def _stand_fingers(self, width: float) -> None:
        """Both fingers stand there and stay, however the arm bends them."""
        for finger in FINGERS:
            self.client.resetJointState(self.id, finger, width)
        self._drive_fingers(width)

    def _put_fingers(self, width: float) -> None:
        states = self.client.getJointStates(self.id, list(FINGERS))
        if all(abs(state[0] - width) < 1e-3 for state in states):
            for finger in FINGERS:
                self.client.resetJointState(self.id, finger, width)

    def _between_fingers(self) -> tuple[BulletBody, int] | None:
        for body in self.scene.bodies:
            touched = [
                {
                    point[4] + 1
                    for point in self.client.getClosestPoints(
                        self.id, body.id, NEAR, linkIndexA=finger
                    )
                }
                for finger in FINGERS
            ]
            for link in sorted(touched[0] & touched[1]):
                if body.asset.links[link].graspable:
                    return body, link
        return None

    def _fix(self, body: BulletBody, link: int) -> int:
        hand = self.client.getLinkState(self.id, HAND)[0:2]
        thing = (
            self.client.getBasePositionAndOrientation(body.id)
            if link == 0
            else self.client.getLinkState(body.id, link - 1)[0:2]
        )
        inverse = self.client.invertTransform(*hand)
        position, rotation = self.client.multiplyTransforms(*inverse, *thing)
        constraint = self.client.createConstraint(
            self.id,
            HAND,
            body.id,
            link - 1,
            bullet.JOINT_FIXED,
            [0, 0, 0],
            position,
            [0, 0, 0],
            rotation,
        )
        self.client.changeConstraint(constraint, maxForce=HOLD)
        return int(constraint)

    def _let_pass(self, body: BulletBody, link: int, *, passing: bool) -> None:
        links = range(len(body.asset.links)) if link == 0 else [link]
        for part, other in itertools.product((HAND, *FINGERS), links):
            self.client.setCollisionFilterPair(self.id, body.id, part, other - 1, int(not passing))


_BASE = np.eye(4)
_BASE[:3, 3] = frames.BASE


@lru_cache(maxsize=1)
def _panda() -> dict[str, meshes.Mesh]:
    return meshes.load_panda()


def _link_index(name: str) -> int:
    """PyBullet's index of a link of the URDF; -1 is the base."""
    fixed = {"panda_hand": HAND, "panda_leftfinger": 9, "panda_rightfinger": 10}
    return fixed.get(name, int(name[-1]) - 1 if name[-1].isdigit() else -1)


def timed(path: Array) -> Iterator[Array]:
    """The joint targets of every physics step along a path, on a minimum-jerk profile."""
    tips = np.array([frames.tip_pose(joints)[:3, 3] for joints in path])
    turned = np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0)
    moved = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    seconds = np.maximum(turned / JOINT_SPEED, moved / TIP_SPEED)
    length = np.concatenate([[0.0], np.cumsum(seconds)])
    steps = max(int(np.ceil(1.875 * length[-1] * HZ)), 8)
    u = np.arange(1, steps + 1) / steps
    along = (10 * u**3 - 15 * u**4 + 6 * u**5) * length[-1]
    if length[-1] == 0.0:
        return iter([path[-1]] * steps)
    columns = [np.interp(along, length, path[:, joint]) for joint in range(7)]
    return iter(np.stack(columns, axis=1))
