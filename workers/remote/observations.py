"""Observations as a remote policy declared them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from hide_tasks.contract import CAMERAS, CameraView, Observation
from workers.remote.maps import INSTRUCTION, PARTS, Entry, ObservationMap, Said, Seen


def told(observation: Observation, declared: ObservationMap) -> dict[str, Any]:
    """The observation's entries that a policy declared, and nothing else."""
    return {
        name: {inner: _entry(observation, one) for inner, one in entry.items()}
        if isinstance(entry, dict)
        else _entry(observation, entry)
        for name, entry in declared.items()
    }


def _entry(observation: Observation, entry: Entry) -> Any:
    if isinstance(entry, Said):
        return entry.value
    if entry.source == (INSTRUCTION,):
        return _listed(observation.instruction, entry.axes)
    value = _numbers(observation, entry)
    return value.reshape((1,) * entry.axes + value.shape)


def _listed(text: str, axes: int) -> Any:
    return [_listed(text, axes - 1)] if axes else text


def _numbers(observation: Observation, seen: Seen) -> NDArray[Any]:
    if seen.part:
        return _of_camera(observation.views[seen.camera], seen)
    rows = [np.atleast_1d(_vector(observation, name)) for name in seen.source]
    return np.concatenate(rows).astype(seen.dtype)


def _of_camera(view: CameraView, seen: Seen) -> NDArray[Any]:
    value: NDArray[Any] = getattr(view, seen.part)
    if seen.part == "rgb":
        sized = _resized(value, seen.size, Image.Resampling.BILINEAR)
        return np.ascontiguousarray(sized.transpose(2, 0, 1)) if seen.layout == "chw" else sized
    if seen.part == "depth":
        value = _resized(value, seen.size, Image.Resampling.NEAREST)
    return value.astype(seen.dtype)


def _resized(image: NDArray[Any], size: int | None, resampling: Image.Resampling) -> NDArray[Any]:
    if size is None or image.shape[:2] == (size, size):
        return image
    return np.asarray(Image.fromarray(image).resize((size, size), resampling))


def _vector(observation: Observation, name: str) -> Any:
    pose = observation.gripper_pose
    if name == "gripper_position":
        return pose[:3]
    if name == "gripper_quaternion":
        return pose[3:]
    if name == "gripper_rotation_vector":
        return Rotation.from_quat(pose[3:]).as_rotvec()
    if name == "gripper_closing":
        return 1.0 - observation.gripper_opening
    return getattr(observation, name)


class BadObservation(ValueError):
    """A message holds no observation; it names the first entry that is wrong."""


KINDS: dict[str, str] = {"rgb": "u1", "depth": "f4", "intrinsics": "f8", "camera_to_world": "f8"}
SHAPES: dict[str, tuple[int | None, ...]] = {
    "rgb": (None, None, 3),
    "depth": (None, None),
    "intrinsics": (3, 3),
    "camera_to_world": (4, 4),
}
LARGEST = 1024  # pixels of a side


def observation_of(message: Mapping[str, Any]) -> Observation:
    """The observation in a message that has what `maps.everything` declares.

    Raises:
        BadObservation: an entry is missing, or of another kind or shape.
    """
    views = {}
    for camera in _cameras_in(message):
        parts = {
            part: _array(message, f"{camera}/{part}", KINDS[part], SHAPES[part]) for part in PARTS
        }
        if parts["rgb"].shape[:2] != parts["depth"].shape:
            raise BadObservation(f"{camera}/rgb and {camera}/depth differ in size")
        views[camera] = CameraView(**parts)
    instruction = message.get(INSTRUCTION)
    if not isinstance(instruction, str):
        raise BadObservation(f"{INSTRUCTION} is {type(instruction).__name__}; expected a text")
    return Observation(
        views=views,
        gripper_pose=_array(message, "gripper_pose", "f8", (7,)),
        gripper_opening=float(_array(message, "gripper_opening", "f8", (1,))[0]),
        joint_positions=_array(message, "joint_positions", "f8", (7,)),
        instruction=instruction,
    )


def _cameras_in(message: Mapping[str, Any]) -> list[str]:
    """Those of which a part is there; the first if there is none, to be missed."""
    named = {name.partition("/")[0] for name in message if isinstance(name, str)}
    return [camera for camera in CAMERAS if camera in named] or [CAMERAS[0]]


def _array(
    message: Mapping[str, Any], name: str, kind: str, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    value = message.get(name)
    expected = f"an array of {np.dtype(kind)} with shape {shape}".replace("None", "any")
    if not isinstance(value, np.ndarray):
        found = "missing" if value is None else type(value).__name__
        raise BadObservation(f"{name} is {found}; expected {expected}")
    fits = len(value.shape) == len(shape) and all(
        0 < there <= LARGEST if wanted is None else there == wanted
        for there, wanted in zip(value.shape, shape, strict=True)
    )
    if value.dtype != np.dtype(kind) or not fits:
        raise BadObservation(f"{name} is {value.dtype} {value.shape}; expected {expected}")
    return value
