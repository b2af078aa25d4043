"""A process of trusted code, as its parent sees it."""

import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from olne_bench.bench.process.arithmetic import same_arithmetic
from olne_bench.bench.process.channel import Channel
from olne_bench.bench.process.family import kill_family
from olne_bench.bench.process.fork_server import search_path


class Started:
    """A process with this process's rights, in the same folder.

    Attributes:
        channel: the connection to it.
        pid: its process id.
    """

    def __init__(self, log: Path | None, memory: int | None) -> None:
        """Start it.

        Args:
            log: file for what it prints. Default: this process's standard error.
            memory: limit [bytes] of its data, None for no limit.
        """
        ours, theirs = socket.socketpair()
        boot = f"import sys; sys.path[:] = {search_path()!r}; "
        boot += "from olne_bench.bench.process.inside import serve; "
        boot += f"serve({theirs.fileno()}, {os.getpid()}, {memory})"
        with theirs, ExitStack() as stack:
            output = stack.enter_context(log.open("ab")) if log else None
            self._process = subprocess.Popen(
                [sys.executable, "-u", "-c", boot],
                stdin=subprocess.DEVNULL,
                stdout=output or sys.__stderr__,
                stderr=output or sys.__stderr__,
                env=os.environ | same_arithmetic(),
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # it gets no Ctrl-C from the terminal
            )
        self.channel, self.pid = Channel(ours), self._process.pid

    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def exit_code(self, seconds: float) -> int | None:
        """Its exit code, negative for a signal; None if it is still running after ``seconds``."""
        try:
            return self._process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            return None

    def stop(self) -> None:
        """End it with all its descendants."""
        kill_family(self.pid)
        self._process.wait()
        self.channel.close()
