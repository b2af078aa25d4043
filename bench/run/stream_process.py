"""The process of a player that follows motions, as the referee sees it."""

import pickle
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from olne_bench.bench.judge.online import StreamTask
from olne_bench.bench.judge.referee import Answer, PlayerFault
from olne_bench.bench.process.child import Child, DiedError
from olne_bench.bench.run.player import Answered, Prepared
from olne_bench.bench.run.player_process import faults_of, player_child
from olne_bench.bench.run.stream_player import begin, update

#: Share of the time limit that an update may spend, so that it can say that its time has ended.
_BUDGET = 0.8


class StreamProcess:
    """A player process for one motion after the other.

    It is replaced before another plugin, and when it dies. What is lost with it is the motion that
    it followed, and nothing else.
    """

    def __init__(self, *, memory: int | None, hidden: Path | None) -> None:
        """Nothing is started yet.

        Args:
            memory: memory limit [bytes] of the process, None for no limit.
            hidden: folder that foreign code cannot read.
        """
        self._memory, self._hidden = memory, hidden
        self._place: tuple[object, ...] | None = None
        self._child = Child()
        self._limit = self._budget = 0.0

    def start(self, task: StreamTask) -> str | None:
        """As of ``judge.online.StreamPlayer``."""
        place = (task.plugin, task.reference, task.homes) if task.plugin else ()
        if place != self._place:
            self.stop()
            homes = (task.reference, *task.homes)
            self._child = player_child(task, homes, self._memory, self._hidden)
            self._place = place
        if task.plugin:
            self._child.end()  # foreign code carries nothing from a motion to the next
        self._limit = task.time_limit
        self._budget = _BUDGET * task.time_limit if task.budget is None else task.budget
        prepared: Prepared = self._asked(
            "set-up",
            begin,
            task.reference,
            task.parameters,
            task.homes,
            pickle.dumps(task.problem),
            task.lag,
            task.seed,
            kind=Prepared,
        )
        return prepared.declined

    def update(self, sample: np.ndarray) -> Answer:
        """As of ``judge.online.StreamPlayer``."""
        if not self._child.served:  # it was retired after the last answer
            raise PlayerFault(
                "invalid", "left threads, processes or too much memory, so its process was replaced"
            )
        began = time.perf_counter()
        answered: Answered = self._asked("update", update, sample, self._budget, kind=Answered)
        seconds = time.perf_counter() - began
        if answered.estimate is None:
            raise PlayerFault("invalid", answered.malformed, seconds)
        return Answer(estimate=answered.estimate, seconds=seconds)

    def stop(self) -> None:
        """Kill the process and all its descendants."""
        self._child.stop()

    def _asked(self, stage: str, function: Callable[..., Any], *arguments: Any, kind: Any) -> Any:
        try:
            with faults_of(stage, self._limit):
                return self._child.call(function, *arguments, kind=kind, seconds=self._limit)
        except DiedError as error:
            raise PlayerFault("crash", str(error)) from error
