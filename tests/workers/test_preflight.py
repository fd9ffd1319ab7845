"""A policy is tried before it plays: what is tried, and what is said of it."""

from pathlib import Path

import numpy as np
import pytest

from hide_tasks.contract import CAMERAS, IMAGE_SIZE
from hide_tasks.layout import BOUNDS
from workers.policies import Hosted, Surroundings
from workers.preflight import Check, NotFit, made_up, preflight
from workers.sandbox.choice import Sandbox

POLICIES = "tests.workers.some_policies"


def tried(target: str, timeout: float = 20.0) -> list[Check]:
    return preflight(Hosted(target, Surroundings(timeout, sandbox=Sandbox.NONE)).make())


def test_a_policy_that_acts_passes_every_check() -> None:
    checks = tried(f"{POLICIES}:Stays")

    assert [check.name for check in checks] == ["load", "decision", "repetition"]
    assert {(check.outcome, check.detail) for check in checks} == {("passed", "")}
    assert all(check.seconds >= 0 for check in checks)


@pytest.mark.parametrize(
    ("target", "name", "words"),
    [
        (f"{POLICIES}:NoAct", "load", "no method act"),
        (f"{POLICIES}:Raises", "decision", "no such thing as a cup"),
        (f"{POLICIES}:Nonsense", "decision", "Not an action"),
        (f"{POLICIES}:Hangs", "decision", "took longer than 1 s"),
    ],
)
def test_the_first_thing_that_fails_ends_it(target: str, name: str, words: str) -> None:
    with pytest.raises(NotFit, match=words) as caught:
        tried(target, timeout=1.0 if "Hangs" in target else 20.0)

    assert (caught.value.checks[-1].name, caught.value.checks[-1].outcome) == (name, "failed")
    assert all(check.outcome == "passed" for check in caught.value.checks[:-1])


def test_a_policy_that_acts_otherwise_the_second_time_is_noted(tmp_path: Path) -> None:
    file = tmp_path / "restless.py"
    file.write_text(
        "import random\n"
        "class Restless:\n"
        "    def reset(self, instruction, policy_seed): pass\n"
        "    def act(self, observation):\n"
        "        position = (0.2, random.random(), 1.0)\n"
        "        return {'kind': 'keyframe', 'position': position,\n"
        "                'quaternion': (1.0, 0.0, 0.0, 0.0), 'opening': 1.0}\n"
    )

    checks = tried(f"{file}:Restless")

    assert [check.outcome for check in checks] == ["passed", "passed", "noted"]
    assert "another action" in checks[-1].detail


def test_what_is_shown_lies_within_the_scene() -> None:
    seen = made_up()

    assert set(seen.views) == set(CAMERAS)
    for view in seen.views.values():
        assert view.rgb.shape == (IMAGE_SIZE, IMAGE_SIZE, 3)
        pixels = np.stack(np.meshgrid(*[np.arange(IMAGE_SIZE) + 0.5] * 2), axis=-1)
        rays = np.concatenate([pixels, np.ones((IMAGE_SIZE, IMAGE_SIZE, 1))], axis=-1)
        local = rays @ np.linalg.inv(view.intrinsics).T * view.depth[..., None]
        points = local @ view.camera_to_world[:3, :3].T + view.camera_to_world[:3, 3]
        low, high = np.array(BOUNDS).T
        within = ((points > low) & (points < high)).all(axis=-1)
        assert within.mean() > 0.5
