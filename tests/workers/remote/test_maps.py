"""Declarations, what they make of observations, and what they take for actions."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from hide_tasks.contract import (
    CAMERAS,
    CameraView,
    EEDelta,
    InvalidAction,
    Observation,
    parse_action,
)
from workers.remote import arrays
from workers.remote.actions import actions_of
from workers.remote.maps import ActionMap, Declaration, Seen, cameras_in, everything
from workers.remote.observations import BadObservation, observation_of, told

TURN = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])


def observation() -> Observation:
    rng = np.random.default_rng(3)
    views = {
        name: CameraView(
            rng.integers(0, 256, (128, 128, 3), np.uint8),
            rng.random((128, 128), np.float32),
            rng.random((3, 3)),
            rng.random((4, 4)),
        )
        for name in CAMERAS
    }
    pose = np.array([0.1, 0.2, 0.9, *TURN.as_quat()])
    return Observation(views, pose, 0.25, rng.random(7), "press the button twice")


def one(source: object, **changes: Any) -> Any:
    """What a policy sees of it."""
    seen = Seen.model_validate({"from": source, **changes})
    return told(observation(), {"x": seen})["x"]


# --- observations ---


def test_everything_crosses_the_wire_unchanged() -> None:
    before = observation()

    after = observation_of(arrays.unpack(arrays.pack(told(before, everything()))))

    for camera in CAMERAS:
        for part, value in vars(before.views[camera]).items():
            found = getattr(after.views[camera], part)
            assert (found.dtype, found.tobytes()) == (value.dtype, value.tobytes())
    assert after.gripper_pose.tolist() == before.gripper_pose.tolist()
    assert after.joint_positions.tolist() == before.joint_positions.tolist()
    assert (after.gripper_opening, after.instruction) == (0.25, before.instruction)


def test_an_observation_of_one_camera_crosses_the_wire() -> None:
    before = observation()
    del before.views["left_shoulder"], before.views["right_shoulder"], before.views["wrist"]

    after = observation_of(told(before, everything(["front"])))

    assert list(after.views) == ["front"]
    assert (after.views["front"].rgb == before.views["front"].rgb).all()


def test_a_map_tells_its_cameras() -> None:
    wrist = Seen.model_validate({"from": "wrist.rgb"})
    joints = Seen.model_validate({"from": "joint_positions"})

    assert cameras_in({"a": {"b": wrist}, "c": joints}) == ("wrist",)
    assert cameras_in(everything()) == CAMERAS


def test_images() -> None:
    rgb, depth = observation().views["wrist"].rgb, observation().views["wrist"].depth

    assert np.array_equal(one("wrist.rgb"), rgb)
    assert np.array_equal(one("wrist.rgb", layout="chw"), rgb.transpose(2, 0, 1))
    assert one("wrist.rgb", size=224).shape == (224, 224, 3)
    assert one("wrist.rgb", size=224).dtype == np.uint8
    assert one("wrist.rgb", size=64, layout="chw").shape == (3, 64, 64)
    assert np.array_equal(one("wrist.depth", size=256)[::2, ::2], depth)


def test_numbers_are_joined_in_the_order_of_their_names() -> None:
    state = one(["gripper_position", "gripper_rotation_vector", "gripper_closing"])

    assert state.dtype == np.float32
    assert state == pytest.approx([0.1, 0.2, 0.9, *TURN.as_rotvec(), 0.75])
    assert one("gripper_quaternion", dtype="float64").tolist() == TURN.as_quat().tolist()


def test_entries_may_stand_inside_another() -> None:
    inner = Seen.model_validate({"from": "instruction"})

    assert told(observation(), {"language": {"task": inner}}) == {
        "language": {"task": "press the button twice"}
    }


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"from": "hidden_state"}, "no source 'hidden_state'; there are instruction"),
        ({"from": "back.rgb"}, "no source 'back.rgb'"),
        ({"from": "front.ids"}, "no source 'front.ids'"),
        ({"from": ["front.rgb", "wrist.rgb"]}, "front.rgb stands alone"),
        ({"from": ["joint_positions", "instruction"]}, "instruction stands alone"),
        ({"from": []}, "at least 1 item"),
        ({"from": "joint_positions", "size": 64}, "joint_positions has no size"),
        ({"from": "front.depth", "layout": "chw"}, "front.depth has no channels"),
        ({"from": "front.rgb", "size": 100_000}, "less than or equal to 512"),
        ({"from": "front.rgb", "quality": 3}, "Extra inputs"),
        ({"from": "front.rgb", "axes": 4}, "less than or equal to 3"),
    ],
)
def test_an_entry_that_fits_nothing_is_refused(field: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Seen.model_validate(field)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("front/rgb", None, "front/rgb is missing"),
        ("front/rgb", "picture", "front/rgb is str"),
        ("front/rgb", np.zeros((8, 8, 4), np.uint8), r"front/rgb is uint8 \(8, 8, 4\)"),
        ("front/rgb", np.zeros((8, 8, 3), np.uint8), "front/rgb and front/depth differ in size"),
        ("front/depth", np.zeros((128, 128)), "front/depth is float64"),
        ("gripper_pose", np.zeros(6), r"gripper_pose is float64 \(6,\); expected"),
        ("joint_positions", np.zeros(7, np.float32), "joint_positions is float32"),
        ("instruction", 3, "instruction is int"),
    ],
)
def test_a_message_without_an_observation(name: str, value: object, message: str) -> None:
    sent = {**told(observation(), everything()), name: value}

    with pytest.raises(BadObservation, match=message):
        observation_of(sent)


def test_entries_may_stand_in_groups_with_axes_in_front_and_beside_what_never_changes() -> None:
    declared = Declaration.model_validate(
        {
            "observation": {
                "video": {"front": {"from": "front.rgb", "axes": 2}},
                "language": {"task": {"from": "instruction", "axes": 2}},
                "arm": {"from": "joint_positions", "axes": 1},
                "robot": {"value": "panda"},
                "rate": {"value": 20},
            }
        }
    ).observation

    seen = told(observation(), declared)

    assert seen["video"]["front"].shape == (1, 1, 128, 128, 3)
    assert seen["language"] == {"task": [["press the button twice"]]}
    assert seen["arm"].shape == (1, 7)
    assert (seen["robot"], seen["rate"]) == ("panda", 20)


# --- actions ---


def action(row: object, **declared: Any) -> Any:
    """The first action of a reply of one row."""
    return parse_action(
        actions_of({"actions": np.array(row)}, ActionMap.model_validate(declared))[0]
    )


@pytest.mark.parametrize(
    ("rotation", "numbers"),
    [
        ("quaternion_xyzw", TURN.as_quat()),
        ("quaternion_wxyz", np.roll(TURN.as_quat(), 1)),
        ("rotation_vector", TURN.as_rotvec()),
        ("euler_xyz", TURN.as_euler("xyz")),
    ],
)
def test_rotations_of_keyframes(rotation: str, numbers) -> None:
    found = action([0.1, 0.2, 0.9, *numbers, 1.0], kind="keyframe", rotation=rotation)

    assert Rotation.from_quat(found.quaternion).approx_equal(TURN, atol=1e-12)
    assert (found.position, found.opening, found.stop) == ((0.1, 0.2, 0.9), 1.0, False)


def test_flags_of_keyframes() -> None:
    row = [0.1, 0.2, 0.9, 0, 0, 0, 1, 0.0, 0.9, 0.1]

    found = action(row, kind="keyframe", flags=["stop", "ignore_collisions"])

    assert (found.opening, found.stop, found.ignore_collisions) == (0.0, True, False)


@pytest.mark.parametrize(
    ("open_", "shut", "said", "opening"),
    [
        (1, 0, 0.3, 0.3),
        (0, 1, 0.3, 0.7),
        (-1, 1, 1.0, 0.0),
        (-1, 1, -1.2, 1.0),
        (0.04, 0, 0.02, 0.5),
    ],
)
def test_conventions_of_fingers(open_: float, shut: float, said: float, opening: float) -> None:
    found = action([0.0] * 7 + [said], kind="joint_position", open=open_, shut=shut)

    assert found.chunk[0][7] == pytest.approx(opening)


def test_scaled_displacements() -> None:
    declared = {"kind": "ee_delta", "position_scale": 0.05, "rotation_scale": 0.5}

    found = action([[1.0, 0, -1, 0, 0, 1, 1]] * 4, **declared, execute=2)

    assert isinstance(found, EEDelta)
    assert np.array(found.chunk) == pytest.approx(np.array([[0.05, 0, -0.05, 0, 0, 0.5, 1]] * 2))


def test_displacements_with_euler_angles() -> None:
    found = action([0.0] * 3 + [0.3, -0.2, 1.0, 0], kind="ee_delta", rotation="euler_xyz")

    assert found.chunk[0][3:6] == pytest.approx(TURN.as_rotvec())


def test_arrays_are_joined_side_by_side() -> None:
    declared = ActionMap.model_validate(
        {"kind": "joint_position", "join": ["arm", "hand"], "axes": 1, "execute": 2}
    )
    arm, hand = np.arange(28.0).reshape(1, 4, 7) / 100, np.full((1, 4, 1), 0.5)

    [found] = actions_of({"hand": hand, "arm": arm, "more": 1}, declared)

    assert np.array(found["chunk"]) == pytest.approx(np.hstack([arm[0], hand[0]])[:2])
    with pytest.raises(InvalidAction, match="no 'hand'; it has arm"):
        actions_of({"arm": arm}, declared)
    with pytest.raises(InvalidAction, match=r"'arm' has shape \(4, 7\); expected \(1,\) and"):
        actions_of({"arm": arm[0], "hand": hand}, declared)


def test_the_number_of_rows_is_held_to_if_it_was_declared() -> None:
    rows = np.zeros((8, 8))
    declared = ActionMap(kind="joint_position", rows=10, execute=5)

    with pytest.raises(InvalidAction, match=r"shape \(8, 8\); expected \(10, 8\)"):
        actions_of({"actions": rows}, declared)


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"kind": "velocity"}, "Input should be"),
        ({"kind": "joint_position", "rotation": "euler_xyz"}, "no rotation as euler_xyz"),
        ({"kind": "ee_delta", "rotation": "quaternion_xyzw"}, "no rotation as quaternion_xyzw"),
        ({"kind": "joint_position", "flags": ["stop"]}, "flags are further columns of keyframes"),
        ({"kind": "keyframe", "flags": ["stop", "stop"]}, "each once"),
        ({"kind": "keyframe", "position_scale": 2}, "of ee_delta alone"),
        ({"open": 1, "shut": 1}, "the same number"),
        ({"rows": 4, "execute": 5}, "execute 5 of 4 rows"),
        ({"rows": 201}, "less than or equal to 200"),
        ({"open": float("nan")}, "finite number"),
        ({"kind": "keyframe", "join": ["pose"]}, "join names two arrays or more"),
        ({"kind": "keyframe", "join": ["pose", "grip"], "key": "x"}, "there is no key"),
        ({"join": ["pose", "grip"]}, "of rows"),
        ({"axes": 1}, "our own form has no axes"),
    ],
)
def test_an_action_that_fits_nothing_is_refused(declared: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ActionMap.model_validate(declared)


def test_a_declaration_comes_back_from_its_message() -> None:
    declared = Declaration(
        model="mine",
        observation=everything(),
        action=ActionMap(kind="keyframe", rotation="euler_xyz"),
        max_sessions=4,
    )

    back = arrays.unpack(arrays.pack(declared.message()))["hide"]

    assert Declaration.model_validate(back) == declared
