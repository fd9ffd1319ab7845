import contextlib

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from tests.workers.remote.peers import brief
from workers.remote.arrays import MAX_MESSAGE, BadMessage, pack, unpack

NUMBERS = st_np.array_shapes(min_dims=0, max_side=4).flatmap(
    lambda shape: st.sampled_from(["?", "u1", "i2", "<i8", ">f4", "f8"]).flatmap(
        lambda kind: st_np.arrays(kind, shape)
    )
)


@given(NUMBERS)
def test_an_array_comes_back_as_it_was(array) -> None:
    back = unpack(pack({"a": array}))["a"]

    assert (back.dtype, back.shape, back.tobytes()) == (array.dtype, array.shape, array.tobytes())
    assert back.flags.writeable


def test_numbers_of_numpy_come_back_as_numbers() -> None:
    message = {"x": np.float32(0.5), "y": np.bool_(True), "z": np.int64(-3)}

    assert unpack(pack(message)) == {"x": 0.5, "y": True, "z": -3}


def array(dtype: object = "<f4", shape: object = (2,), data: object = bytes(8)) -> bytes:
    fields = {b"__ndarray__": True, b"data": data, b"dtype": dtype, b"shape": shape}
    return msgpack.packb({"actions": fields})


@pytest.mark.parametrize(
    "data",
    [
        array("O"),
        array("|O"),
        array("V4"),
        array("<c8", (1,)),
        array("<U1"),
        array("M8[s]", (1,)),
        array("(1000000,)f4"),
        array("f4,f4", (1,)),
        array("f4" * 50),
        array(None),
        array(b"<f4"),
        array(shape=(3,)),
        array(shape=(-2, -1)),
        array(shape=(2**62, 4)),
        array(shape=(2.0,)),
        array(shape=(True, 2)),
        array(shape=2),
        array(shape=(1,) * 9 + (2,)),
        array(data="8 letters"),
        array(data=None),
        msgpack.packb({b"__ndarray__": True}),
        msgpack.packb({b"__npgeneric__": True, b"dtype": "O", b"data": 1}),
        msgpack.packb({b"__npgeneric__": True, b"dtype": "f8", b"data": "1"}),
        msgpack.packb([1, 2]),
        msgpack.packb({"a": [{}] * 20_000}),
        msgpack.packb({"a": [[]] * 20_000}),
        msgpack.packb({1: 2}),
        msgpack.packb({"t": msgpack.ExtType(5, b"1")})[:-1],
        b"\x91" * 100_000 + b"\x01",
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"",
        b"\xc1",
        pack({"a": 1}) + b"\x01",
        b"\x81\xa1a\xa1\xff",
        bytes(MAX_MESSAGE + 1),
    ],
    ids=brief,
)
def test_what_is_no_message_of_plain_numbers_is_refused(data: bytes) -> None:
    with pytest.raises(BadMessage):
        unpack(data)


@given(st.binary(max_size=300))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    with contextlib.suppress(BadMessage):
        assert isinstance(unpack(data), dict)


@pytest.mark.parametrize("value", [np.array([object()]), object(), 1j, np.zeros(MAX_MESSAGE, "u1")])
def test_what_cannot_be_read_is_not_sent(value) -> None:
    with pytest.raises(BadMessage):
        pack({"a": value})
