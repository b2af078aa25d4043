"""Handle Ctrl-C and SIGTERM, so that a run ends in order."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """A callable that says whether the run was asked to end.

    Attributes:
        signal: the first signal that arrived; None before.
    """

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None

    def __call__(self) -> bool:
        return self.signal is not None

    def note(self, number: int, frame: FrameType | None) -> None:
        """Signal handler: the first signal is noted, the second one interrupts at once."""
        if self():
            raise KeyboardInterrupt
        self.signal = signal.Signals(number)


@contextmanager
def stop_request() -> Iterator[StopRequest]:
    """Within this context, the first Ctrl-C or SIGTERM (sent by batch systems) asks to stop."""
    request = StopRequest()
    former = {n: signal.signal(n, request.note) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
