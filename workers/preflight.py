"""What is tried of a policy before it plays: loaded, asked, and asked the same again.

No simulator is needed: the observation is made up, a bare table seen from above, of real size.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from hide_tasks.contract import (
    CAMERAS,
    IMAGE_SIZE,
    CameraView,
    InvalidAction,
    Observation,
    PolicyFailure,
    parse_action,
)
from hide_tasks.layout import TABLE_TOP
from workers.policy_process import LOAD_LIMIT, NotStarted, PolicyProcess

INSTRUCTION = "push the maroon button, twice"
SEED = 0
HEIGHT = 0.8  # m of every camera over the table
FOCAL = 160.0  # pixels: about what the shoulders' cameras have

Name = Literal["conversion", "header", "load", "decision", "repetition"]


class Check(BaseModel):
    """One thing that was tried."""

    model_config = ConfigDict(frozen=True)

    name: Name
    outcome: Literal["passed", "noted", "failed"]  # noted: odd, and no reason to refuse it
    seconds: float
    detail: str = ""


class NotFit(Exception):
    """A policy that cannot play; `checks` ends with what failed."""

    def __init__(self, checks: list[Check]):
        super().__init__(checks[-1].detail)
        self.checks = checks


def preflight(
    policy: PolicyProcess,
    load_limit: float = LOAD_LIMIT,
    cameras: Sequence[str] = CAMERAS,
) -> list[Check]:
    """Tries a policy that has not been started; its process is gone afterwards.

    Args:
        cameras: of the suite that it is for.

    Raises:
        NotFit: it cannot be loaded, or gives no valid action in time.
    """
    checks: list[Check] = []
    try:
        with _checked(checks, "load"):
            policy.load(load_limit)
        with _checked(checks, "decision"):
            first = _decision(policy, cameras)
        with _checked(checks, "repetition") as note:
            if _decision(policy, cameras) != first:
                note("the same observation and seed gave another action")
    finally:
        policy.close()
    return checks


@contextmanager
def _checked(checks: list[Check], name: Name) -> Iterator[Callable[[str], None]]:
    """Adds what comes of a block; what it gives notes something odd.

    Raises:
        NotFit: the block failed.
    """
    begun = monotonic()
    notes: list[str] = []

    def add(outcome: Literal["passed", "noted", "failed"], detail: str) -> None:
        seconds = round(monotonic() - begun, 3)
        checks.append(Check(name=name, outcome=outcome, seconds=seconds, detail=detail))

    try:
        yield notes.append
    except (PolicyFailure, InvalidAction, NotStarted) as error:
        add("failed", str(error))
        raise NotFit(checks) from None
    add("noted" if notes else "passed", "; ".join(notes))


def _decision(policy: PolicyProcess, cameras: Sequence[str]) -> str:
    """The first action of an episode, as text."""
    policy.reset(INSTRUCTION, SEED)
    action = parse_action(policy.act(made_up(cameras)))
    return json.dumps(action.model_dump(mode="json"), sort_keys=True)


def made_up(cameras: Sequence[str] = CAMERAS) -> Observation:
    """The arm over a bare table, as no task shows it, seen by these cameras."""
    rng = np.random.default_rng(SEED)
    return Observation(
        views={name: _view(rng, 0.1 * number) for number, name in enumerate(cameras)},
        gripper_pose=np.array([0.28, 0.0, TABLE_TOP + 0.7, 1.0, 0.0, 0.0, 0.0]),
        gripper_opening=1.0,
        joint_positions=np.array([0.0, 0.2, 0.0, -1.9, 0.0, 2.1, 0.8]),
        instruction=INSTRUCTION,
    )


def _view(rng: np.random.Generator, aside: float) -> CameraView:
    """Straight down, so far to the left of the table's middle."""
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[:3, 3] = 0.25, aside, TABLE_TOP + HEIGHT
    middle = IMAGE_SIZE / 2
    return CameraView(
        rgb=rng.integers(90, 160, (IMAGE_SIZE, IMAGE_SIZE, 3), dtype=np.uint8),
        depth=np.full((IMAGE_SIZE, IMAGE_SIZE), HEIGHT, dtype=np.float32),
        intrinsics=np.array([[FOCAL, 0.0, middle], [0.0, FOCAL, middle], [0.0, 0.0, 1.0]]),
        camera_to_world=down,
    )
