"""Replies of remote policies as actions, or what is wrong with them."""

from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hide_tasks.contract import MAX_CHUNK, InvalidAction
from workers.remote.maps import ActionMap
from workers.remote.words import plain_text


def actions_of(reply: Mapping[Any, Any], declared: ActionMap) -> list[Any]:
    """The decisions in a reply, in order and in dictionary form; the play loop checks their values.

    Raises:
        InvalidAction: the reply has none, or they are not as they were declared.
    """
    for name in declared.names:
        if name not in reply:
            found = plain_text(", ".join(sorted(map(str, reply))[:10])) or "nothing"
            raise InvalidAction(f"the reply has no '{name}'; it has {found}")
    values = {name: reply[name] for name in declared.names}
    if declared.kind == "action":
        return list(values.values())
    rows = _rows(values, declared)[: declared.execute]
    if declared.kind == "keyframe":
        return [_keyframe(row, declared) for row in rows]
    chunk = rows if declared.kind == "joint_position" else _deltas(rows, declared)
    chunk = np.column_stack([chunk[:, :-1], _opening(rows[:, -1], declared)])
    return [{"kind": declared.kind, "chunk": chunk.tolist()}]


def _rows(values: Mapping[str, object], declared: ActionMap) -> NDArray[np.float64]:
    """(rows, columns), as declared and finite."""
    named = " and ".join(f"'{name}'" for name in values)
    expected = f"({declared.rows or f'1 to {MAX_CHUNK}'}, {declared.columns})"
    parts = [_part(name, value, declared, expected) for name, value in values.items()]
    shapes = " and ".join(str(value.shape) for value in values.values() if _is_array(value))
    counts = (declared.rows,) if declared.rows else range(1, MAX_CHUNK + 1)
    fits = all(part.ndim == 2 and len(part) == len(parts[0]) for part in parts)
    rows = np.concatenate(parts, axis=1) if fits else None
    if rows is None or rows.shape[1] != declared.columns or len(rows) not in counts:
        raise InvalidAction(f"{named} has shape {shapes}; expected {expected}")
    if not np.isfinite(rows).all():
        raise InvalidAction(f"{named} holds NaN or infinite values")
    return rows.astype(np.float64)


def _part(name: str, value: object, declared: ActionMap, expected: str) -> NDArray[Any]:
    """An array of a reply without its axes of length one; a single row as rows."""
    if not _is_array(value) or value.dtype.kind not in "fiu":
        kind = f"array of {value.dtype}" if _is_array(value) else type(value).__name__
        raise InvalidAction(f"'{name}' is {kind}; expected numbers of shape {expected}")
    axes = (1,) * declared.axes
    if value.shape[: declared.axes] != axes:
        raise InvalidAction(f"'{name}' has shape {value.shape}; expected {axes} and {expected}")
    value = value.reshape(value.shape[declared.axes :])
    return value[None] if value.ndim == 1 and not declared.join else value


def _is_array(value: object) -> TypeGuard[NDArray[Any]]:
    return isinstance(value, np.ndarray)


def _keyframe(row: NDArray[np.float64], declared: ActionMap) -> dict[str, Any]:
    end = declared.columns - len(declared.flags) - 1  # of position and rotation
    flags = zip(declared.flags, row[end + 1 :] > 0.5, strict=True)
    return {
        "kind": "keyframe",
        "position": row[:3].tolist(),
        "quaternion": _quaternion(row[3:end], declared).tolist(),
        "opening": float(_opening(row[end], declared)),
        **{name: bool(value) for name, value in flags},
    }


def _quaternion(values: NDArray[np.float64], declared: ActionMap) -> NDArray[np.float64]:
    """x y z w."""
    if declared.turn == "quaternion_xyzw":
        return values
    if declared.turn == "quaternion_wxyz":
        return np.roll(values, -1)
    quaternion: NDArray[np.float64] = _rotation(values, declared).as_quat()
    return quaternion


def _rotation(values: NDArray[np.float64], declared: ActionMap) -> Any:
    if declared.turn == "euler_xyz":
        return Rotation.from_euler("xyz", values)
    return Rotation.from_rotvec(values)


def _deltas(rows: NDArray[np.float64], declared: ActionMap) -> NDArray[np.float64]:
    moved, turned = rows[:, :3] * declared.position_scale, rows[:, 3:6] * declared.rotation_scale
    if declared.turn == "euler_xyz":
        turned = _rotation(turned, declared).as_rotvec()
    return np.column_stack([moved, turned, rows[:, 6]])


def _opening(column: Any, declared: ActionMap) -> Any:
    """0 shut, 1 open; what a network gives beyond its ends is cut off."""
    return np.clip((column - declared.shut) / (declared.open - declared.shut), 0.0, 1.0)
