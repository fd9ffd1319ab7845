import socket
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hide_tasks.contract import CAMERAS, CameraView, Observation
from workers import wire

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(),
    lambda part: st.lists(part) | st.dictionaries(st.text(), part),
    max_leaves=20,
)
dtypes = arrays.boolean_dtypes() | arrays.integer_dtypes() | arrays.floating_dtypes(sizes=(32, 64))


def observation() -> Observation:
    rng = np.random.default_rng(0)
    view = CameraView(
        rgb=rng.integers(0, 256, (128, 128, 3), dtype=np.uint8),
        depth=rng.random((128, 128), dtype=np.float32),
        intrinsics=np.eye(3),
        camera_to_world=np.eye(4),
    )
    pose = np.array([0.2, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return Observation(dict.fromkeys(CAMERAS, view), pose, 0.5, np.zeros(7), "push the button")


@given(plain)
def test_plain_values_round_trip(value: object) -> None:
    assert wire.decode(wire.encode(value)) == value


@given(
    dtypes.flatmap(lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=0, min_side=0)))
)
def test_arrays_round_trip_and_can_be_written(array: np.ndarray) -> None:
    arrived = wire.decode(wire.encode({"array": array}))["array"]

    assert arrived.dtype == array.dtype
    np.testing.assert_array_equal(arrived, array)
    assert arrived.flags.writeable


def test_an_observation_holds_the_same_after_the_journey() -> None:
    sent = observation()

    arrived = wire.unpack_observation(wire.decode(wire.encode(wire.pack_observation(sent))))

    assert arrived.instruction == sent.instruction
    np.testing.assert_array_equal(arrived.gripper_pose, sent.gripper_pose)
    np.testing.assert_array_equal(arrived.views["wrist"].depth, sent.views["wrist"].depth)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_a_wire_error(data: bytes) -> None:
    try:
        wire.decode(data)
    except wire.WireError as error:
        assert str(error).startswith("Not a message")


@pytest.mark.parametrize("value", [object(), np.array([object()]), np.array(["a"]), 2**70, {1, 2}])
def test_what_is_no_plain_value_is_not_sent(value: object) -> None:
    with pytest.raises(wire.WireError, match="cannot be sent"):
        wire.encode(value)


def test_a_false_shape_is_refused() -> None:
    import msgpack

    forged = msgpack.packb(msgpack.ExtType(1, msgpack.packb(("<f8", (1000, 1000), b"12345678"))))

    with pytest.raises(wire.WireError, match="no array of float64"):
        wire.decode(forged)


def test_messages_follow_one_another_on_a_connection() -> None:
    ours, theirs = socket.socketpair()
    sender = threading.Thread(
        target=lambda: [wire.send(theirs, {"n": n, "x": np.ones(10**5)}) for n in (1, 2)]
    )
    with ours, theirs:
        sender.start()

        assert [wire.receive(ours, within=5)["n"] for _ in range(2)] == [1, 2]

        sender.join()


def test_a_message_that_does_not_come_in_time() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(b"\0\0\0\5ab")  # the beginning of one

        with pytest.raises(TimeoutError):
            wire.receive(ours, within=0.05)


def test_the_other_side_is_gone() -> None:
    ours, theirs = socket.socketpair()
    with ours:
        theirs.close()

        with pytest.raises(EOFError):
            wire.receive(ours)


def test_an_absurd_length_is_not_waited_for() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(b"\xff\xff\xff\xff")

        with pytest.raises(wire.WireError, match="4294967295 bytes"):
            wire.receive(ours, within=5)
