"""A process of trusted code, as its parent sees it."""

import os
import socket
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from olne_bench.bench.process.arithmetic import same_arithmetic
from olne_bench.bench.process.channel import Channel
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.process.nursery import Birth, Born, search_path


class Started(Born):
    """A process with this process's rights, in the same folder.

    Attributes:
        channel: the connection to it.
    """

    def __init__(
        self,
        log: Path | None,
        memory: int | None,
        modules: Sequence[str],
        has_children: bool,
        seconds: float,
    ) -> None:
        """Start it.

        Args:
            log: file for what it prints. Default: this process's standard error.
            memory: limit [bytes] of its data, None for no limit.
            modules: what it needs to import.
            has_children: whether it starts processes itself.
            seconds: time that this may take [s].

        Raises:
            StartError: if it takes longer.
        """
        ours, theirs = socket.socketpair()
        birth = Birth(search_path(), _folder(), modules, memory=memory, has_children=has_children)
        with theirs, ExitStack() as stack:
            place = Path(os.devnull) if log is None and sys.__stderr__ is None else log
            output: Any = stack.enter_context(place.open("ab")) if place else sys.__stderr__
            try:
                super().__init__(birth, theirs, output, os.environ | same_arithmetic(), seconds)
            except StartError:
                ours.close()
                raise
        self.channel = Channel(ours)

    def stop(self) -> None:
        """End it with all its descendants."""
        super().stop()
        self.channel.close()


def _folder() -> str:
    try:
        return str(Path.cwd())
    except OSError:  # it is gone, and a fork stays where its nursery is
        return ""
