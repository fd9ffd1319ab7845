"""A policy that is told the truth holds it to be true; one that is not told does not."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from hide_tasks import suite
from hide_tasks.bullet.world import World
from hide_tasks.contract import Belief
from hide_tasks.script import steps
from seek_model import told
from seek_model.told import KINDS, Told
from tests.seek_model.checkpoints import tiny_checkpoint
from tests.seek_model.tiny import tiny

TASK = "reopen_drawer"
WINDOW = 1


def beliefs(tmp_path: Path, kind: Told, name: str = "seek-small") -> Iterator[tuple[int, Belief]]:
    """Along the expert's run: how many stages are done, and what the policy believes."""
    memory = {"window": WINDOW, "commit": "always"} if name == "seek-small" else {}
    policy = told.load(tiny_checkpoint(tmp_path / "some.safetensors", tiny(name, **memory)), kind)
    spec = suite.episode(TASK, "val", 0)
    with World(suite.build(spec)) as world:
        policy.bind(world, spec)
        policy.reset(world.task.instruction, 0)
        for step in steps(world.task, None):
            policy.act(world.observe())
            yield step.number, policy.belief()
            world.execute(step.keyframe)


@pytest.mark.parametrize("kind", ["true_counts", "both"])
def test_true_counts_follow_the_world(tmp_path: Path, kind: Told) -> None:
    seen = list(beliefs(tmp_path, kind))

    assert len({count for count, _ in seen}) > 2
    off = [abs(belief.stage_count - count) for count, belief in seen]
    assert max(off) <= 1, "several counts are right where reaching a thing changes nothing hidden"


def test_a_true_anchor_is_the_last_decision_that_changed_what_is_hidden(tmp_path: Path) -> None:
    spec = suite.episode(TASK, "val", 0)
    hidden = []
    with World(suite.build(spec)) as world:
        for step in steps(world.task, None):
            hidden.append(world.task.hidden_state())
            world.execute(step.keyframe)
    changed = [i for i in range(len(hidden) - 1) if hidden[i + 1] != hidden[i]]

    for decision, (_, belief) in enumerate(beliefs(tmp_path, "true_anchors")):
        last = max((i for i in changed if i < decision), default=None)
        left = last is not None and last < decision - WINDOW
        assert belief.anchor_index == (last if left else None)


def test_who_is_not_told_counts_by_itself(tmp_path: Path) -> None:
    own = [belief.stage_count for _, belief in beliefs(tmp_path, "own")]
    true = [belief.stage_count for _, belief in beliefs(tmp_path, "true_counts")]
    assert own != true


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_memory_there_is_nothing_to_tell(tmp_path: Path, kind: Told) -> None:
    assert all(belief is None for _, belief in beliefs(tmp_path, kind, "sam2act-small"))
