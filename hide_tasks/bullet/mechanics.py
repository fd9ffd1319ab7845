"""What the joints of an asset do by themselves: spring back, stick, snap shut, lock each other."""

from collections.abc import Sequence
from typing import Any

import pybullet as bullet

from hide_tasks.assets.asset import Asset, Joint
from hide_tasks.bullet.client import Client

LOCK = 1000.0  # N with which an interlocked joint stays shut
SHUT = 2e-4  # m or rad: nearer than this it is put at exactly zero
SLOW = 0.01  # m/s or rad/s


def rest_motors(client: Client, body: int, asset: Asset) -> None:
    """Set up what every joint does when nobody touches it: spring back, or stick."""
    for index, link in enumerate(asset.links[1:]):
        if link.joint and link.joint.spring:
            _pull(client, body, index, link.joint.spring)
        elif link.joint:
            _stick(client, body, index, link.joint.friction)


class Mechanics:
    """Detents and interlocks of one asset. Changes motors only when something changes."""

    def __init__(self, client: Client, body: int, asset: Asset):
        self.client, self.body = client, body
        self.joints = {i: link.joint for i, link in enumerate(asset.links[1:]) if link.joint}
        self.interlocked = asset.interlocked
        self.modes = dict.fromkeys(self.joints, "free")

    def act(self, states: Sequence[Any], held_link: int | None) -> None:
        """React to the joints' states as read after a step."""
        opened = self._opened(states) if self.interlocked else None
        for index, joint in self.joints.items():
            state = states[index]
            self._set(index, self._mode(index, joint, state[0], held_link, opened))
            if self.modes[index] == "shut" and 0 != state[0] < SHUT and abs(state[1]) < SLOW:
                self.client.resetJointState(self.body, index, 0.0)

    def _opened(self, states: Sequence[Any]) -> int | None:
        opened = (i for i, joint in self.joints.items() if states[i][0] > joint.detent)
        return next(opened, None)

    def _mode(
        self, index: int, joint: Joint, reading: float, held_link: int | None, opened: int | None
    ) -> str:
        if opened is not None and opened != index:
            return "locked"
        if reading < joint.detent and held_link != index + 1:
            return "shut"
        return "free"

    def _set(self, index: int, mode: str) -> None:
        if self.modes[index] == mode:
            return
        self.modes[index] = mode
        if mode == "free":
            _stick(self.client, self.body, index, self.joints[index].friction)
        else:
            force = self.joints[index].snap if mode == "shut" else LOCK
            _pull(self.client, self.body, index, force)


def _pull(client: Client, body: int, index: int, force: float) -> None:
    client.setJointMotorControl2(
        body, index, bullet.POSITION_CONTROL, targetPosition=0, force=force
    )


def _stick(client: Client, body: int, index: int, force: float) -> None:
    client.setJointMotorControl2(
        body, index, bullet.VELOCITY_CONTROL, targetVelocity=0, force=force
    )
