"""Messages between two processes, as frames on a socket.

A frame is its length (4 bytes) and its content. No operation is unbounded: a reader takes what is
there and never waits for the rest of a frame, frames have a largest size, and a writer gives up at
a deadline.
"""

import select
import socket
import struct
import time
from collections.abc import Iterable

#: Largest frame that is accepted [bytes].
LARGEST = 64 * 2**20

_LENGTH = struct.Struct("!I")
_CHUNK = 2**18


class ClosedError(Exception):
    """The other side is gone."""


class GarbageError(Exception):
    """The other side has sent something that is not a frame."""


def wait_for(channels: Iterable["Channel"], seconds: float) -> None:
    """Return when there is something to read on any of some connections, or after ``seconds``."""
    poll = select.poll()
    for channel in channels:
        poll.register(channel, select.POLLIN)
    poll.poll(1e3 * seconds)


class Channel:
    """One end of a connection."""

    def __init__(self, end: socket.socket) -> None:
        """Take over a connected socket."""
        end.setblocking(False)
        self._socket = end
        self._buffer = bytearray()
        self._polls = {event: select.poll() for event in (select.POLLIN, select.POLLOUT)}
        for event, poll in self._polls.items():
            poll.register(end, event)

    def fileno(self) -> int:
        """Descriptor of the socket, for ``select`` and ``poll``."""
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()

    def send(self, content: bytes, seconds: float) -> None:
        """Send a frame.

        Raises:
            ClosedError: if the other side is gone, or does not read the frame within ``seconds``.
        """
        deadline = time.monotonic() + seconds
        rest = memoryview(_LENGTH.pack(len(content)) + content)
        while rest:
            try:
                rest = rest[self._socket.send(rest) :]
            except BlockingIOError:
                if not self._ready(select.POLLOUT, deadline - time.monotonic()):
                    raise ClosedError("does not read what it is sent") from None
            except OSError as error:
                raise ClosedError("closed its connection") from error

    def poll(self) -> bytes | None:
        """The next frame; None if it is not complete yet. Never waits.

        Raises:
            ClosedError: if the other side is gone and no complete frame is left.
            GarbageError: on a frame that is too large.
        """
        closed = False
        while (frame := self._take()) is None:
            try:
                read = self._socket.recv(_CHUNK)
            except BlockingIOError:
                return None
            except OSError:
                read, closed = b"", True
            if closed or not read:
                raise ClosedError("closed its connection")
            self._buffer += read
        return frame

    def wait(self, seconds: float) -> None:
        """Return when there is something to read, or after ``seconds``."""
        self._ready(select.POLLIN, seconds)

    def is_quiet(self) -> bool:
        """Whether everything that has arrived was read."""
        return not self._buffer and not self._ready(select.POLLIN, 0.0)

    def _take(self) -> bytes | None:
        if len(self._buffer) < _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack_from(self._buffer)
        if length > LARGEST:
            raise GarbageError(f"announced a message of {length} bytes, at most {LARGEST} are read")
        end = _LENGTH.size + length
        if len(self._buffer) < end:
            return None
        frame = bytes(self._buffer[_LENGTH.size : end])
        del self._buffer[:end]
        return frame

    def _ready(self, event: int, seconds: float) -> bool:
        return bool(self._polls[event].poll(max(0.0, 1e3 * seconds)))
