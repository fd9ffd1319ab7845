"""Keyframe verbs for blocks: from above, the fingers along two of their faces."""

import math

import numpy as np

from hide_tasks.assets.block import Block
from hide_tasks.motion.general import move, top_down
from hide_tasks.poses import Array, yaw_of
from hide_tasks.task import Move

STANDOFF = 0.10  # m above a block before it is grasped (RLBench stack_blocks)
LIFT = 0.20  # m (RLBench stack_blocks)


def above(block: Block) -> Move:
    """Over a block with open fingers."""
    return move(lambda: _over(block, STANDOFF))


def grasp(block: Block) -> Move:
    """Close the fingers on a block."""
    return move(lambda: _over(block, 0.0), opened=False, touching=True)


def lift(block: Block, height: float = LIFT) -> Move:
    """Raise a held block."""
    return move(lambda: _over(block, height), opened=False)


def carry_over(place: Array, height: float, yaw: float = 0.0) -> Move:
    """Bring a held block over a point (3,) where its middle will come to be."""
    return move(lambda: top_down(place + np.array([0.0, 0.0, height]), yaw), opened=False)


def let_go(place: Array, yaw: float = 0.0) -> Move:
    """Open the fingers with a held block's middle at a point (3,)."""
    return move(lambda: top_down(place, yaw), touching=True)


def rise_from(place: Array, height: float, yaw: float = 0.0) -> Move:
    """Straight up from a point (3,) with open fingers."""
    return move(lambda: top_down(place + np.array([0.0, 0.0, height]), yaw))


def grip_yaw(block: Block) -> float:
    """How the tool is turned to grasp a block, rad: at most an eighth of a turn either way."""
    yaw = yaw_of(block.pose())
    return yaw - round(yaw / (math.pi / 2)) * math.pi / 2


def _over(block: Block, height: float) -> Array:
    return top_down(np.array(block.position) + np.array([0.0, 0.0, height]), grip_yaw(block))
