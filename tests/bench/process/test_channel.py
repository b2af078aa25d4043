"""Frames on a socket: complete ones are read, and reads neither wait nor are unbounded."""

import socket
import struct

import pytest

from olne_bench.bench.process.channel import LARGEST, Channel, ClosedError, GarbageError


@pytest.fixture
def ends():
    ours, theirs = socket.socketpair()
    yield Channel(ours), theirs
    ours.close()
    theirs.close()


def frame(content: bytes) -> bytes:
    return struct.pack("!I", len(content)) + content


def test_frames_arrive_in_order_and_whole(ends):
    channel, other = ends
    other.sendall(frame(b"first") + frame(b"") + frame(b"x" * 90_000))
    assert channel.poll() == b"first"
    assert channel.poll() == b""
    while (last := channel.poll()) is None:
        channel.wait(1.0)
    assert last == b"x" * 90_000
    assert channel.poll() is None
    assert channel.is_quiet()


@pytest.mark.parametrize("cut", [1, 3, 4, 6])
def test_half_a_frame_is_not_waited_for(ends, cut):
    channel, other = ends
    other.sendall(frame(b"hello")[:cut])
    assert channel.poll() is None
    assert not channel.is_quiet()
    other.sendall(frame(b"hello")[cut:])
    assert channel.poll() == b"hello"


def test_a_frame_of_the_largest_size_is_announced_and_a_larger_one_refused(ends):
    channel, other = ends
    other.sendall(struct.pack("!I", LARGEST))
    assert channel.poll() is None
    other.sendall(b"")
    second, third = socket.socketpair()
    third.sendall(struct.pack("!I", LARGEST + 1))
    with pytest.raises(GarbageError, match="at most"):
        Channel(second).poll()
    second.close()
    third.close()


def test_what_was_sent_before_the_end_is_read(ends):
    channel, other = ends
    other.sendall(frame(b"last words") + b"\0")
    other.close()
    assert channel.poll() == b"last words"
    with pytest.raises(ClosedError, match="closed its connection"):
        channel.poll()


def test_a_side_that_does_not_read_is_given_up(ends):
    channel, _ = ends
    with pytest.raises(ClosedError, match="does not read"):
        channel.send(b"x" * 50_000_000, seconds=0.1)


def test_a_closed_side_cannot_be_sent_to(ends):
    channel, other = ends
    other.close()
    with pytest.raises(ClosedError, match="closed its connection"):
        channel.send(b"x" * 1_000_000, seconds=1.0)


def test_two_channels_talk():
    ours, theirs = socket.socketpair()
    one, two = Channel(ours), Channel(theirs)
    one.send(b"question", seconds=1.0)
    two.wait(1.0)
    assert two.poll() == b"question"
    one.close()
    two.close()
