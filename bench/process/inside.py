"""The loop of a child process: take a piece of work, do it and answer, until the parent ends.

A child is kept after its work, because solvers are slow to build. If it is in a doubtful state
afterwards, it says so and is replaced.
"""

import contextlib
import gc
import io
import os
import pickle
import resource
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msgspec import Raw

from olne_bench.bench.process.channel import Channel, ClosedError, GarbageError
from olne_bench.bench.process.family import adopt_orphans, kill_descendants
from olne_bench.bench.process.messages import Raised, Ready, Result, Stage, encode
from olne_bench.bench.text import clip, describe_error
from olne_bench.errors import UserError

#: Share of the memory limit that a process may keep between two pieces of work.
_KEPT_MEMORY = 0.5
#: How long a parent may take to read a message [s].
_SEND_SECONDS = 60.0

#: How often a process checks that it has a parent [s].
_PARENT_SECONDS = 1.0

_say: Callable[[Any], None] | None = None


def announce(stage: str, seconds: float) -> None:
    """Tell the parent that another stage of the work begins, and how long it may take [s].

    Without a parent, as in tests, this does nothing.
    """
    if _say is not None:
        _say(Stage(stage, seconds))


def serve(descriptor: int, parent: int, memory: int | None) -> None:
    """Serve a parent until it closes the connection, in a new process of trusted code.

    Args:
        descriptor: descriptor of the connection to the parent.
        parent: the parent's process id.
        memory: limit [bytes] of this process's data, None for no limit.
    """
    adopt_orphans()
    threading.Thread(target=_end_without_parent, args=(parent,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the driver
    if memory is not None:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    serve_forked(descriptor, memory)


def serve_forked(descriptor: int, memory: int | None) -> None:
    """Serve a parent until it closes the connection, in a process that is set up already.

    Args:
        descriptor: descriptor of the connection to the parent.
        memory: limit [bytes] of this process's data, None for no limit.
    """
    global _say
    # A log that cannot be written to is not a failure.
    sys.stdout = sys.stderr = io.TextIOWrapper(_BestEffort(1, "w"), write_through=True)
    own = os.getpid()
    channel = Channel(socket.socket(fileno=descriptor))

    def say(message: Any) -> None:
        if os.getpid() != own:  # foreign code forked, and its child came back here
            os._exit(0)
        channel.send(encode(message), _SEND_SECONDS)

    _say = say
    with contextlib.suppress(ClosedError, GarbageError):
        _work(channel, say, memory)
    kill_descendants(own)


def _work(channel: Channel, say: Callable[[Any], None], memory: int | None) -> None:
    """Take work until the connection is closed, which raises ``ClosedError``."""
    ready = False
    while True:
        while (request := channel.poll()) is None:
            channel.wait(3600.0)
        token, function, arguments = pickle.loads(request)
        if not ready:  # the function's module is imported only now
            gc.freeze()  # imported objects stay; collecting through them would take time
            say(Ready())
            ready = True
        say(_answer(token, function, arguments, memory))


def _end_without_parent(parent: int) -> None:
    """End this process and its descendants once its parent is gone."""
    own = os.getpid()
    while os.getppid() == parent:
        time.sleep(_PARENT_SECONDS)
    kill_descendants(own)
    os._exit(1)


def _answer(
    token: int, function: Callable[..., Any], arguments: tuple[Any, ...], memory: int | None
) -> Result | Raised:
    threads = threading.active_count()
    try:
        value = encode(function(*arguments))
    except UserError as error:
        return Raised(token, "user", clip(str(error)))
    except MemoryError as error:
        return Raised(token, "memory", describe_error(error))
    except BaseException as error:  # foreign code may raise anything; no child gets Ctrl-C
        return Raised(token, "other", describe_error(error))
    left_threads = threading.active_count() > threads
    full = memory is not None and _held_memory() > _KEPT_MEMORY * memory
    return Result(token, Raw(value), retire=left_threads or full)


class _BestEffort(io.FileIO):
    def write(self, data: Any) -> int:
        with contextlib.suppress(OSError):
            super().write(data)
        return len(data)


def _held_memory() -> int:
    """Memory [bytes] that counts towards ``RLIMIT_DATA``; 0 if the system does not provide it."""
    try:
        pages = Path("/proc/self/statm").read_text().split()[5]
    except OSError:
        return 0
    return int(pages) * resource.getpagesize()
