"""What crosses a process border: observations, actions, episodes, decisions, verdicts.

World frame: metres, x away from the robot, y to its left, z up; the table top is at z = 0.752.
Quaternions are x y z w. A pose is (x, y, z, qx, qy, qz, qw) of the gripper's tip: its z axis
points out of the gripper, the fingers close along its y axis.
Everything here imports numpy and pydantic alone, so any process can speak it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Literal, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

CAMERAS = ("front", "left_shoulder", "right_shoulder", "wrist")
IMAGE_SIZE = 128  # pixels, both ways
CONTROL_HZ = 20  # rate of the dense action modes
MAX_CHUNK = 200  # rows of one dense action: 10 s

Split = Literal["train", "val", "test", "test100"]
Rules = Literal["hide", "parity"]
ActionMode = Literal["keyframe", "joint_position", "ee_delta"]


class Category(StrEnum):
    """The paper's three kinds of memory (section 3.2)."""

    REPETITION_COUNTING = "RC"
    HISTORICAL_STATE_RECALL = "HSR"
    EXECUTION_PROGRESS = "EPT"


class Failure(StrEnum):
    """Why an episode is not exact. Shared by all tasks; one name has one meaning."""

    # Counting
    UNDERCOUNT = "undercount"  # stopped or ran out before the requested count
    OVERCOUNT = "overcount"  # one repetition too many; cannot be undone
    # Recall
    WRONG_RECALL = "wrong_recall"  # acted on another place than the one seen before
    # Progress
    REPEATED_STEP = "repeated_step"  # did again what had been done
    SKIPPED_STEP = "skipped_step"  # left out a step, or came to it too early
    UNFINISHED = "unfinished"  # nothing wrong so far, but not everything was done
    # Execution
    WRONG_OBJECT = "wrong_object"  # handled a distractor
    DROPPED_OBJECT = "dropped_object"  # the object left the workspace or fell
    NOT_PLACED = "not_placed"  # the object never reached its goal
    NOT_WITHDRAWN = "not_withdrawn"  # the arm stayed at the object
    UNREACHABLE_POSE = "unreachable_pose"  # the last pose asked for has no configuration or path
    # Policy
    POLICY_ERROR = "policy_error"  # the policy raised, or its process died
    POLICY_INVALID = "policy_invalid"  # NaN, wrong shape, unknown kind of action
    POLICY_TIMEOUT = "policy_timeout"  # no answer in time


class MotionOutcome(StrEnum):
    """What became of one decision's motion."""

    ARRIVED = "arrived"
    BLOCKED = "blocked"  # something was in the way; the arm stands where it was stopped
    OUT_OF_REACH = "out_of_reach"  # no joint configuration gives the pose; did not move
    GOAL_IN_COLLISION = "goal_in_collision"  # every configuration collides; did not move
    NO_PATH = "no_path"  # no free path was found; did not move
    NONE = "none"  # the action asked for no motion

    @property
    def moved(self) -> bool:
        """True when a plan was found and carried out, as far as it went."""
        return self in (MotionOutcome.ARRIVED, MotionOutcome.BLOCKED)

    @property
    def failed(self) -> bool:
        """True when no plan was found."""
        return not self.moved and self is not MotionOutcome.NONE


class InvalidAction(ValueError):
    """A policy's answer is not an action; the message says what was wrong and what is right."""


class PolicyFailure(Exception):
    """A policy did not give an action.

    Attributes:
        failure: which of the policy failures it was.
    """

    def __init__(self, failure: Failure, message: str):
        super().__init__(message)
        self.failure = failure


# --- observations -------------------------------------------------------------------------------


@dataclass(frozen=True)
class CameraView:
    """One RGB-D image with its geometry."""

    rgb: NDArray[np.uint8]  # (h, w, 3)
    depth: NDArray[np.float32]  # (h, w) metres along the optical axis
    intrinsics: NDArray[np.float64]  # (3, 3); pixel centres are at +0.5
    camera_to_world: NDArray[np.float64]  # (4, 4); x right, y down, z forward


@dataclass(frozen=True)
class Observation:
    """What a policy sees: no clock, no seed, no index, no variation, nothing hidden."""

    views: Mapping[str, CameraView]  # one per camera of the task, in the order of CAMERAS
    gripper_pose: NDArray[np.float64]  # (7,)
    gripper_opening: float  # 0 shut, 1 open (8 cm)
    joint_positions: NDArray[np.float64]  # (7,) rad
    instruction: str


# --- actions ------------------------------------------------------------------------------------


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Number = Annotated[float, Field(ge=-1e3, le=1e3)]  # no pose or joint of this robot is beyond
Vector3 = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Row = tuple[Number, ...]
Opening = Annotated[float, Field(ge=0.0, le=1.0)]


class Keyframe(_Frozen):
    """Bring the tip to a pose along a planned path, then set the fingers."""

    kind: Literal["keyframe"] = "keyframe"
    position: Vector3  # metres, world
    quaternion: Quaternion  # x y z w, any length but zero
    opening: Opening = 1.0  # open from 0.5 on
    ignore_collisions: bool = False  # the planner may touch things
    stop: bool = False  # the episode ends after this action

    @model_validator(mode="after")
    def _has_orientation(self) -> Self:
        if math.hypot(*self.quaternion) < 1e-6:
            raise ValueError("quaternion has length zero; expected x y z w of a rotation")
        return self

    @property
    def pose(self) -> NDArray[np.float64]:
        """(7,) with a unit quaternion."""
        quaternion = np.array(self.quaternion) / math.hypot(*self.quaternion)
        return np.concatenate([self.position, quaternion])

    @classmethod
    def at(cls, pose: NDArray[np.float64], **fields: Any) -> Self:
        """A keyframe at a pose (7,)."""
        x, y, z, *quaternion = (float(value) for value in pose)
        return cls(position=(x, y, z), quaternion=tuple(quaternion), **fields)


class JointPosition(_Frozen):
    """Joint targets at 20 Hz; each row is seven joints (rad) and the opening."""

    kind: Literal["joint_position"] = "joint_position"
    chunk: Annotated[tuple[Row, ...], Field(min_length=1, max_length=MAX_CHUNK)]
    stop: bool = False

    @model_validator(mode="after")
    def _has_shape(self) -> Self:
        _require_width(self.chunk, 8, "seven joints and the opening")
        return self


class EEDelta(_Frozen):
    """Tip displacements at 20 Hz; each row is dx dy dz (m), a rotation vector (rad), the opening.

    Both parts are expressed in the world frame; the rotation is applied on the left.
    """

    kind: Literal["ee_delta"] = "ee_delta"
    chunk: Annotated[tuple[Row, ...], Field(min_length=1, max_length=MAX_CHUNK)]
    stop: bool = False

    @model_validator(mode="after")
    def _has_shape(self) -> Self:
        _require_width(self.chunk, 7, "a displacement, a rotation vector and the opening")
        return self


class Stop(_Frozen):
    """End the episode without moving."""

    kind: Literal["stop"] = "stop"
    stop: Literal[True] = True


Action = Annotated[Keyframe | JointPosition | EEDelta | Stop, Field(discriminator="kind")]
_ACTION: TypeAdapter[Keyframe | JointPosition | EEDelta | Stop] = TypeAdapter(Action)


def _require_width(chunk: tuple[tuple[float, ...], ...], width: int, meaning: str) -> None:
    for row in chunk:
        if len(row) != width:
            raise ValueError(f"a row has {len(row)} numbers; expected {width}: {meaning}")


def parse_action(value: object) -> "Keyframe | JointPosition | EEDelta | Stop":
    """The action in a policy's answer: an action already, or its dictionary form.

    Raises:
        InvalidAction: with every field that is wrong.
    """
    if isinstance(value, Keyframe | JointPosition | EEDelta | Stop):
        return value
    try:
        return _ACTION.validate_python(value)
    except ValidationError as error:
        faults = "; ".join(_fault(value, one["loc"], one["msg"]) for one in error.errors()[:4])
        raise InvalidAction(
            f"Not an action: {faults}. Expected a keyframe, a dense chunk or stop."
        ) from None


def _fault(value: object, place: tuple[int | str, ...], message: str) -> str:
    return f"{'.'.join(map(str, place)) or type(value).__name__}: {message}"


# --- policies -----------------------------------------------------------------------------------


class Attention(_Frozen):
    """How much of its look back a policy spends on one memory."""

    view: Annotated[str, Field(max_length=40)]  # of the policy's own views
    slot: Annotated[str, Field(max_length=40)]  # the memory looked at, e.g. "window 1"
    weight: Annotated[float, Field(ge=0.0, le=1.0)]  # a view's weights sum to 1


class Belief(_Frozen):
    """What a policy believes of the hidden state, if it says so.

    A decision is named by its number in the episode, from 0.
    """

    stage_count: int | None = None  # how many stages it holds to be done
    boundary: Annotated[float, Field(ge=0.0, le=1.0)] | None = None  # that one ends here
    window: Annotated[tuple[int, ...], Field(max_length=64)] | None = None  # recent decisions
    anchor_index: int | None = None  # the older decision that it looks back at
    anchor_similarity: float | None = None
    attention: Annotated[tuple[Attention, ...], Field(max_length=512)] = ()


@runtime_checkable
class Policy(Protocol):
    """Anything that plays an episode. One instance plays many, one after the other.

    A policy may also have `belief() -> Belief | None`, asked after every action.
    """

    def reset(self, instruction: str, policy_seed: int) -> None:
        """Forget everything; `policy_seed` is opaque and fixed per episode."""

    def act(self, observation: Observation) -> Any:
        """The next action, or its dictionary form."""


# --- episodes -----------------------------------------------------------------------------------

Value = str | int | float | bool | None
Variation = dict[str, Value]
HiddenState = dict[str, Value | list[Value]]


class EpisodeSpec(_Frozen):
    """Which episode: (suite version, task, split, index) and what follows from it."""

    suite: str = "hide"
    version: int = 1
    task: str
    split: Split
    index: Annotated[int, Field(ge=0)]
    variation: Variation
    draw: int = 0  # which layout draw the expert could solve

    def twin(self, variation: Variation) -> "EpisodeSpec":
        """The same scene with another hidden history."""
        return self.model_copy(update={"variation": {**self.variation, **variation}})

    @property
    def name(self) -> str:
        """The episode's name in files and messages, e.g. 'search_drawer-test-007'."""
        return f"{self.task}-{self.split}-{self.index:03d}"


class Event(_Frozen):
    """Something that a task counts, when it happened."""

    time: float  # simulated seconds since the start
    name: str
    total: int


class DecisionRecord(_Frozen):
    """One decision: the action, what became of it, and the hidden state after it."""

    decision: int
    time: float  # simulated seconds at its end
    action: Action
    outcome: MotionOutcome
    retried: bool = False  # the first plan failed and was tried again
    path: str = ""  # how it moved: straight, joint, rrt, dense
    stage: str  # what the task calls for now
    hidden: HiddenState
    checks: dict[str, bool]
    success: bool  # the checks held at some step up to now
    events: list[Event] = []
    violations: list[Failure] = []
    belief: Belief | None = None


class Timing(_Frozen):
    """Where an episode's wall time went, in seconds."""

    physics: float = 0.0
    rendering: float = 0.0
    planning: float = 0.0
    policy: float = 0.0
    recording: float = 0.0  # that the witnesses took, up to the verdict
    total: float = 0.0
    steps: int = 0  # physics steps
    renders: int = 0  # observations


class Start(_Frozen):
    """What is true before the first decision."""

    stage: str
    hidden: HiddenState
    checks: dict[str, bool]
    success: bool = False
    belief: Belief | None = None


class EpisodeResult(_Frozen):
    """The verdicts of one episode and all that identifies it."""

    task: str
    split: Split
    index: int
    variation: Variation
    instruction: str
    success: bool  # the paper's: the checks held at some step within the budget
    exact: bool  # success, no violation, still true at the end
    failure: Failure | None  # None only if exact
    detail: str = ""  # the error message if a policy failed; that the budget was spent
    decisions: int
    stage: str  # the stage the world called for at the end
    scene_hash: str
    final_state_hash: str
    recording: str | None = None  # file name within the run's folder
    timing: Timing = Timing()

    @model_validator(mode="after")
    def _verdicts_agree(self) -> Self:
        if self.exact and not self.success:
            raise ValueError("an exact episode is a successful one")
        if self.exact != (self.failure is None):
            raise ValueError("failure is empty only if the episode is exact")
        return self
