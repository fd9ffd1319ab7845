"""What a remote policy sees and how it acts, declared: by whoever registers it, or by its server.

Nothing here is guessed. An entry that fits nothing is refused before the first episode, and so is
an answer that differs from its declaration.
"""

import json
from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue, model_validator

from hide_tasks.contract import CAMERAS, MAX_CHUNK

PARTS = ("rgb", "depth", "intrinsics", "camera_to_world")  # of each camera
IMAGES = ("rgb", "depth")
VECTORS = {  # their lengths
    "gripper_pose": 7,  # position, then quaternion x y z w
    "gripper_position": 3,  # m, world
    "gripper_quaternion": 4,  # x y z w
    "gripper_rotation_vector": 3,  # rad
    "gripper_opening": 1,  # 0 shut, 1 open
    "gripper_closing": 1,  # 1 shut, 0 open
    "joint_positions": 7,  # rad
}
INSTRUCTION = "instruction"
RESERVED = ("endpoint", "session_id", "request_id", "is_first")  # ours in every message
MOST_ENTRIES = 64
ROTATIONS = {"quaternion_xyzw": 4, "quaternion_wxyz": 4, "rotation_vector": 3, "euler_xyz": 3}

Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[\x21-\x7e]+$")]
Rotation = Literal["quaternion_xyzw", "quaternion_wxyz", "rotation_vector", "euler_xyz"]
Flag = Literal["ignore_collisions", "stop"]
Scale = Annotated[float, Field(gt=0, le=1000)]


class _Declared(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, serialize_by_alias=True
    )


def _listed(value: object) -> object:
    return (value,) if isinstance(value, str) else value


class Seen(_Declared):
    """One entry of an observation: an image, a matrix, the instruction, or numbers in a row.

    Sources are CAMERA.rgb, CAMERA.depth (m), CAMERA.intrinsics, CAMERA.camera_to_world, the names
    in VECTORS, and instruction.
    """

    source: Annotated[
        tuple[str, ...],
        BeforeValidator(_listed, json_schema_input_type=str | tuple[str, ...]),
        Field(alias="from", min_length=1, max_length=8),
    ]
    size: Annotated[int, Field(ge=16, le=512)] | None = None  # pixels both ways; None: 128
    layout: Literal["hwc", "chw"] = "hwc"  # of rgb
    axes: Annotated[int, Field(ge=0, le=3)] = 0  # of length one in front, or lists round a text
    dtype: Literal["float32", "float64"] = "float32"  # of all but rgb

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for one in self.source:
            _require_source(one)
        alone = [one for one in self.source if one not in VECTORS]
        if alone and len(self.source) > 1:
            raise ValueError(f"{alone[0]} stands alone; only {', '.join(VECTORS)} are joined")
        if self.size is not None and self.part not in IMAGES:
            raise ValueError(f"{self.source[0]} has no size; only images have")
        if self.layout == "chw" and self.part != "rgb":
            raise ValueError(f"{self.source[0]} has no channels; only rgb has")
        return self

    @property
    def camera(self) -> str:
        """The camera, if it is of one."""
        return self.source[0].partition(".")[0]

    @property
    def part(self) -> str:
        """rgb, depth, intrinsics or camera_to_world; empty if it is of no camera."""
        return self.source[0].partition(".")[2]


def _require_source(name: str) -> None:
    camera, _, part = name.partition(".")
    if name in VECTORS or name == INSTRUCTION or (camera in CAMERAS and part in PARTS):
        return
    raise ValueError(
        f"no source '{name}'; there are {INSTRUCTION}, {', '.join(VECTORS)}, and of each camera "
        f"({', '.join(CAMERAS)}) {', '.join(PARTS)}, as in front.rgb"
    )


class Said(_Declared):
    """One entry that is the same in every observation, such as the name of a robot."""

    value: Annotated[str, Field(max_length=200)] | bool | int | float


Entry = Seen | Said
Entries = Annotated[dict[Name, Entry], Field(min_length=1, max_length=MOST_ENTRIES)]
ObservationMap = Annotated[
    dict[Name, Entry | Entries], Field(min_length=1, max_length=MOST_ENTRIES)
]


class ActionMap(_Declared):
    """What a reply is.

    `action` is our own form: the dictionary of one action, of any kind. The others are arrays of
    rows (rows, columns), or one row:

    keyframe        position (m, world), rotation, opening, then a column for each of `flags`;
                    every row is a decision
    joint_position  seven joints (rad), opening; at 20 Hz
    ee_delta        displacement (m) and rotation in the world frame, opening; at 20 Hz
    """

    kind: Literal["action", "keyframe", "joint_position", "ee_delta"] = "action"
    key: Name | None = None  # in the reply; None: action, or actions for an array
    join: Annotated[tuple[Name, ...], Field(max_length=16)] = ()  # arrays that are one side by side
    axes: Annotated[int, Field(ge=0, le=2)] = 0  # of length one in front of (rows, columns)
    rotation: Rotation | None = None  # None: quaternion_xyzw, for ee_delta rotation_vector
    flags: Annotated[tuple[Flag, ...], Field(max_length=2)] = ()  # true above 0.5
    open: float = 1.0  # the opening's column when the fingers are open; beyond is cut off
    shut: float = 0.0  # and when they are shut
    position_scale: Scale = 1.0  # m for 1 in the columns of ee_delta
    rotation_scale: Scale = 1.0  # rad for 1
    rows: Annotated[int, Field(ge=1, le=MAX_CHUNK)] | None = None  # None: any number
    execute: Annotated[int, Field(ge=1, le=MAX_CHUNK)] | None = None  # the first so many; all

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        turns = {"keyframe": tuple(ROTATIONS), "ee_delta": ("rotation_vector", "euler_xyz")}
        if self.rotation and self.rotation not in turns.get(self.kind, ()):
            raise ValueError(f"{self.kind} has no rotation as {self.rotation}")
        if self.flags and (self.kind != "keyframe" or len(set(self.flags)) < len(self.flags)):
            raise ValueError("flags are further columns of keyframes, each once")
        if self.kind != "ee_delta" and (self.position_scale, self.rotation_scale) != (1.0, 1.0):
            raise ValueError("position_scale and rotation_scale are of ee_delta alone")
        if self.join and (self.key or self.kind == "action" or len(self.join) == 1):
            raise ValueError("join names two arrays or more, of rows, and then there is no key")
        if self.axes and self.kind == "action":
            raise ValueError("an action of our own form has no axes")
        if self.open == self.shut:
            raise ValueError("open and shut are the same number")
        if self.rows and self.execute and self.execute > self.rows:
            raise ValueError(f"execute {self.execute} of {self.rows} rows")
        return self

    @property
    def turn(self) -> Rotation:
        """How rows tell rotations."""
        return self.rotation or (
            "rotation_vector" if self.kind == "ee_delta" else "quaternion_xyzw"
        )

    @property
    def columns(self) -> int:
        """Numbers in a row."""
        if self.kind == "joint_position":
            return 8
        return 3 + ROTATIONS[self.turn] + 1 + len(self.flags)

    @property
    def names(self) -> tuple[str, ...]:
        """Where the reply has it."""
        return self.join or (self.key or ("action" if self.kind == "action" else "actions"),)


class Declaration(_Declared):
    """What a server of our dialect says of itself, under `hide` in its metadata."""

    protocol: Literal[1] = 1
    model: Annotated[str, Field(max_length=100, pattern=r"^[\x20-\x7e]*$")] = ""
    observation: ObservationMap
    action: ActionMap = ActionMap()
    stateful: bool = True  # it keeps sessions apart
    max_sessions: Annotated[int, Field(ge=1, le=256)] = 1

    @model_validator(mode="after")
    def _names_are_free(self) -> Self:
        require_free_names(self.observation)
        return self

    def message(self) -> dict[str, JsonValue]:
        """As the metadata has it."""
        return {"hide": self.model_dump(mode="json", exclude_defaults=True) | {"protocol": 1}}


def cameras_in(observation: ObservationMap) -> tuple[str, ...]:
    """The cameras that entries of an observation come from."""
    groups = [e if isinstance(e, dict) else {"": e} for e in observation.values()]
    entries = [entry for group in groups for entry in group.values()]
    named = {entry.camera for entry in entries if isinstance(entry, Seen)}
    return tuple(name for name in CAMERAS if name in named)


def require_free_names(observation: ObservationMap) -> None:
    """Does nothing unless an observation's entry has a name of ours.

    Raises:
        ValueError: it has.
    """
    if taken := set(RESERVED) & set(observation):
        raise ValueError(f"the names {', '.join(sorted(taken))} are the protocol's own")


def as_toml(wire: str, observation: ObservationMap, action: ActionMap) -> str:
    """A file of maps, as `hide eval --maps` reads it; of flat observations."""
    lines = [f"wire = {json.dumps(wire)}", "", "[observation]"]
    for name, entry in observation.items():
        if isinstance(entry, dict):
            raise TypeError(f"{name} is a group")
        lines.append(f"{json.dumps(name)} = {_inline(entry)}")
    said = action.model_dump(mode="json", exclude_defaults=True) | {"kind": action.kind}
    lines += ["", "[action]", *(f"{name} = {json.dumps(value)}" for name, value in said.items())]
    return "\n".join(lines) + "\n"


def _inline(entry: Entry) -> str:
    said = entry.model_dump(mode="json", exclude_defaults=True)
    return "{" + ", ".join(f"{name} = {json.dumps(value)}" for name, value in said.items()) + "}"


def everything(cameras: Sequence[str] = CAMERAS) -> ObservationMap:
    """An observation as the contract has it, of these cameras, nothing rounded."""
    images = {f"{camera}/{part}": f"{camera}.{part}" for camera in cameras for part in IMAGES}
    geometry = {f"{camera}/{part}": f"{camera}.{part}" for camera in cameras for part in PARTS[2:]}
    exact = [*geometry, "gripper_pose", "gripper_opening", "joint_positions"]
    named = {name: Seen.model_validate({"from": source}) for name, source in images.items()}
    for name in exact:
        source = geometry.get(name, name)
        named[name] = Seen.model_validate({"from": source, "dtype": "float64"})
    return {**named, INSTRUCTION: Seen.model_validate({"from": INSTRUCTION})}
