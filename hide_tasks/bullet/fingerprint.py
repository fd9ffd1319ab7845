"""Hashes of what the simulator computed, and the class of machine that they are valid on."""

import hashlib
import platform
import struct
from importlib.metadata import version
from itertools import chain

from hide_tasks.bullet.world import World


def final_state_hash(world: World) -> str:
    """SHA-256 over all positions and velocities; repeats bit for bit on one class of machine."""
    values = list(chain(world.robot.state(), world.scene.state()))
    return hashlib.sha256(struct.pack(f"<{len(values)}d", *values)).hexdigest()


def machine() -> dict[str, str]:
    """What the final state may depend on: libc's mathematics differ between classes of CPU."""
    return {
        "architecture": platform.machine(),
        "libc": " ".join(platform.libc_ver()),
        "fma": str("fma" in _cpu_flags()),
        **{name: version(name) for name in ("pybullet", "numpy", "numba")},
    }


def _cpu_flags() -> set[str]:
    try:
        with open("/proc/cpuinfo") as file:
            line = next((line for line in file if line.startswith("flags")), "")
    except OSError:
        return set()
    return set(line.split())
