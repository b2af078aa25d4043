"""Ctrl-C and its like: what is at work ends in order, instead of wherever it happens to be."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """A callable that says whether the run was asked to end.

    Attributes:
        signal: the first one that came; None before.
    """

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None

    def __call__(self) -> bool:
        return self.signal is not None

    def note(self, number: int, frame: FrameType | None) -> None:
        """A signal handler: the second signal does not wait for anything."""
        if self():
            raise KeyboardInterrupt
        self.signal = signal.Signals(number)


@contextmanager
def stop_request() -> Iterator[StopRequest]:
    """Within it, the first Ctrl-C or SIGTERM (batch systems send it) asks to stop."""
    request = StopRequest()
    former = {n: signal.signal(n, request.note) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
