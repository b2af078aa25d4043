"""Messages: anything that does not fit the schema is refused."""

import pickle

import msgspec
import numpy as np
import pytest

from olne_bench.bench.process.messages import (
    Array,
    Raised,
    Ready,
    Result,
    Stage,
    decode_message,
    decode_value,
    encode,
    pack,
    unpack,
)


@pytest.mark.parametrize(
    "message",
    [Ready(), Stage("scoring", 2.5), Raised(3, "user", "bad"), Result(4, msgspec.Raw(b"\x05"))],
)
def test_messages_come_back(message):
    assert encode(decode_message(encode(message))) == encode(message)


@pytest.mark.parametrize(
    "frame",
    [
        b"",
        b"\xc1",
        b"garbage",
        pickle.dumps(print),
        msgspec.msgpack.encode({"type": "result"}),
        msgspec.msgpack.encode({"type": "unknown", "token": 1}),
        msgspec.msgpack.encode({"type": "stage", "name": "x", "seconds": "long"}),
        msgspec.msgpack.encode({"type": "ready", "more": 1}),
        msgspec.msgpack.encode([1, 2, 3]),
        b"\x91" * 100_000,
        encode(Ready()) + b"\0",
    ],
)
def test_what_is_no_message_is_refused(frame):
    with pytest.raises(ValueError, match="not a message"):
        decode_message(frame)


def test_a_value_of_another_kind_is_refused():
    with pytest.raises(ValueError, match="malformed result"):
        decode_value(msgspec.Raw(encode("text")), float)
    assert decode_value(msgspec.Raw(encode(2.5)), float) == 2.5


@pytest.mark.parametrize(
    "array",
    [np.arange(6.0).reshape(2, 3), np.array(4.0), np.zeros((0, 3)), np.full((2, 2), np.nan)],
)
def test_arrays_come_back_bit_by_bit(array):
    copy = unpack(pack(array))
    assert copy.shape == array.shape
    assert copy.tobytes() == array.tobytes()
    copy[...] = 1  # it can be written to


def test_arrays_are_double_and_dense():
    turned = np.arange(6, dtype=np.float32).reshape(2, 3).T
    assert np.array_equal(unpack(pack(turned)), turned)


@pytest.mark.parametrize("shape", [(3,), (2, -1), (-1,)])
def test_a_shape_that_does_not_fit_is_refused(shape):
    with pytest.raises(ValueError, match=r"reshape|negative|dimension"):
        unpack(Array(shape, np.zeros(4).tobytes()))
    with pytest.raises(ValueError, match="buffer"):
        unpack(Array((1,), b"1234567"))
