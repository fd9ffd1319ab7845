"""Hashes of what the simulator computed."""

import hashlib
import struct
from itertools import chain

from hide_tasks.bullet.world import World


def final_state_hash(world: World) -> str:
    """SHA-256 over all positions and velocities; repeats bit for bit on one class of machine."""
    values = list(chain(world.robot.state(), world.scene.state()))
    return hashlib.sha256(struct.pack(f"<{len(values)}d", *values)).hexdigest()
