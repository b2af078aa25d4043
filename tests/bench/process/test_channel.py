"""Frames on a socket: complete ones are read, and reads neither wait nor are unbounded."""

import socket
import struct
import threading
import time

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


def elapsed(work) -> float:
    begin = time.monotonic()
    work()
    return time.monotonic() - begin


def test_waiting_ends_with_news_or_with_its_time(ends):
    channel, other = ends
    assert 0.15 <= elapsed(lambda: channel.wait(0.2)) < 5
    other.sendall(b"\0")
    assert elapsed(lambda: channel.wait(20.0)) < 10
    assert elapsed(lambda: channel.wait(-1.0)) < 10


def test_who_does_not_read_is_given_as_long_as_was_said(ends):
    channel, _ = ends

    def send() -> None:
        with pytest.raises(ClosedError):
            channel.send(b"x" * 10_000_000, seconds=0.3)

    assert 0.25 <= elapsed(send) < 5


def test_who_reads_slowly_gets_all_of_it(ends):
    channel, other = ends
    content = bytes(range(256)) * 8_000  # more than a socket holds
    arrived = bytearray()

    def read() -> None:
        time.sleep(0.1)
        while len(arrived) < len(content) + 4:
            arrived.extend(other.recv(300_000))

    reader = threading.Thread(target=read)
    reader.start()
    channel.send(content, seconds=20.0)
    reader.join()
    assert arrived == frame(content)


def test_a_frame_may_be_as_large_as_the_limit(ends, monkeypatch):
    monkeypatch.setattr("olne_bench.bench.process.channel.LARGEST", 10)
    channel, other = ends
    other.sendall(frame(b"x" * 10) + frame(b"x" * 11))
    assert channel.poll() == b"x" * 10
    with pytest.raises(GarbageError, match="of 11 bytes, at most 10 are read"):
        channel.poll()


def test_a_reset_connection_is_a_closed_one(ends):
    channel, other = ends
    channel.send(b"never read", seconds=1.0)
    other.close()
    with pytest.raises(ClosedError, match="closed its connection"):
        channel.poll()


def test_what_is_read_in_part_is_not_quiet(ends):
    channel, other = ends
    assert channel.is_quiet()
    other.sendall(b"\0")
    assert not channel.is_quiet()
    assert channel.poll() is None
    assert not channel.is_quiet()
