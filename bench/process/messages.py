"""Messages of a child to its parent: data of a fixed form, checked when it is read.

The parent does not trust its child. Messages are MessagePack, read against a schema, and cannot
execute anything, so a forged message is at worst a wrong answer.
"""

from typing import Any

import msgspec
import numpy as np

from olne_bench.errors import UserError


class StartError(UserError):
    """Processes do not start on this machine, so no work can be done."""


class Ready(msgspec.Struct, tag="ready", forbid_unknown_fields=True):
    """The child has imported everything."""


class Stage(msgspec.Struct, tag="stage", forbid_unknown_fields=True):
    """Another stage of the work begins; ``seconds`` is its time limit."""

    name: str
    seconds: float


class Result(msgspec.Struct, tag="result", forbid_unknown_fields=True):
    """The work is done; ``retire`` says that the process is not fit for more."""

    token: int
    value: msgspec.Raw
    retire: bool = False


class Raised(msgspec.Struct, tag="raised", forbid_unknown_fields=True):
    """The work ended in an exception: bad input (``user``), too little memory, or anything else."""

    token: int
    kind: str
    message: str


Message = Ready | Stage | Result | Raised


class Array(msgspec.Struct, forbid_unknown_fields=True):
    """An array of float64 in C order."""

    shape: tuple[int, ...]
    data: bytes


def pack(array: np.ndarray) -> Array:
    """Turn an array into the form that messages have."""
    dense = np.asarray(array, dtype=np.float64, order="C")
    return Array(dense.shape, dense.tobytes())


def unpack(array: Array) -> np.ndarray:
    """The array of a message.

    Raises:
        ValueError: if shape and data do not fit each other.
    """
    if min(array.shape, default=0) < 0:
        raise ValueError(f"negative dimensions in the shape {array.shape}")
    return np.frombuffer(array.data, dtype=np.float64).reshape(array.shape).copy()


def encode(value: Any) -> bytes:
    """A message as bytes."""
    return msgspec.msgpack.encode(value)


def decode_message(frame: bytes) -> Message:
    """Read a message from a frame.

    Raises:
        ValueError: if the frame holds no message.
    """
    try:
        return _DECODER.decode(frame)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"sent something that is not a message: {error}") from error


def decode_value(value: msgspec.Raw, kind: Any) -> Any:
    """Read the value of a result.

    Raises:
        ValueError: if it is not of that kind.
    """
    try:
        return msgspec.msgpack.decode(value, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"sent a malformed result: {error}") from error


_DECODER: msgspec.msgpack.Decoder[Message] = msgspec.msgpack.Decoder(Message)
