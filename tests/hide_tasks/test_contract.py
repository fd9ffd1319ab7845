import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hide_tasks.contract import (
    EpisodeResult,
    Failure,
    InvalidAction,
    Keyframe,
    Stop,
    parse_action,
)

number = st.floats(-2, 2, allow_nan=False)


@given(st.tuples(number, number, number), st.floats(0, 1), st.booleans(), st.booleans())
def test_an_action_survives_its_dictionary_form(position, opening, ignore, stop):
    action = Keyframe(
        position=position,
        quaternion=(1, 0, 0, 0),
        opening=opening,
        ignore_collisions=ignore,
        stop=stop,
    )

    assert parse_action(action.model_dump()) == action
    assert Keyframe.model_validate_json(action.model_dump_json()) == action


@pytest.mark.parametrize(
    ("answer", "word"),
    [
        (None, "NoneType"),
        ({}, "kind"),
        ({"kind": "dance"}, "dance"),
        ({"kind": "keyframe", "position": (0, 0), "quaternion": (0, 0, 0, 1)}, "position"),
        ({"kind": "keyframe", "position": (0, 0, math.nan), "quaternion": (0, 0, 0, 1)}, "finite"),
        ({"kind": "keyframe", "position": (0, 0, 1), "quaternion": (0, 0, 0, 0)}, "length zero"),
        (
            {"kind": "keyframe", "position": (0, 0, 1), "quaternion": (0, 0, 0, 1), "opening": 2},
            "opening",
        ),
        ({"kind": "joint_position", "chunk": [[0.0] * 7]}, "expected 8"),
        ({"kind": "ee_delta", "chunk": [[0.0] * 8]}, "expected 7"),
        ({"kind": "ee_delta", "chunk": []}, "chunk"),
        ({"kind": "joint_position", "chunk": [[math.inf] * 8]}, "finite"),
        ({"kind": "ee_delta", "chunk": [[1e160] * 7]}, "less than"),
        ({"kind": "keyframe", "position": (0, 0, 1), "quaternion": (1e308,) * 4}, "less than"),
    ],
)
def test_what_is_no_action_is_told_and_why(answer, word):
    with pytest.raises(InvalidAction, match=word):
        parse_action(answer)


def test_a_keyframes_pose_has_a_unit_quaternion():
    pose = Keyframe(position=(0, 0, 1), quaternion=(0, 0, 0, 4)).pose

    assert pose.tolist() == [0, 0, 1, 0, 0, 0, 1]


def test_stop_is_an_action_of_its_own():
    assert parse_action({"kind": "stop"}) == Stop()


def result(**fields):
    return EpisodeResult(
        **{
            "task": "t",
            "split": "test",
            "index": 0,
            "variation": {},
            "instruction": "",
            "success": True,
            "exact": True,
            "failure": None,
            "decisions": 1,
            "stage": "",
            "scene_hash": "",
            "final_state_hash": "",
            **fields,
        }
    )


def test_verdicts_that_contradict_each_other_are_refused():
    assert result().exact
    with pytest.raises(ValueError, match="exact episode"):
        result(success=False)
    with pytest.raises(ValueError, match="failure"):
        result(failure=Failure.OVERCOUNT)
    with pytest.raises(ValueError, match="failure"):
        result(exact=False)
