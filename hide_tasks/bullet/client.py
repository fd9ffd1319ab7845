"""A physics world of one's own in this process."""

from functools import partial
from typing import Any

import pybullet

from hide_tasks.bullet import quietly


class Client:
    """PyBullet's functions, bound to one world; looking one up costs nothing the second time."""

    def __init__(self) -> None:
        with quietly():
            self.id: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(pybullet, name), physicsClientId=self.id)
        setattr(self, name, function)
        return function
