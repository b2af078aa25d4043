"""The process of a player that follows motions, as the referee sees it."""

import pickle
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from olne_bench.bench.judge.trials import Answer, PlayerFault, PlayerTask
from olne_bench.bench.process.child import DiedError
from olne_bench.bench.run.player import Answered, Prepared
from olne_bench.bench.run.player_process import PlayerProcess, faults_of
from olne_bench.bench.run.stream_player import begin, update

#: Share of the time limit that an update may spend, so that it can say that its time has ended.
_BUDGET = 0.8


class StreamProcess(PlayerProcess):
    """A player process for one motion after the other.

    It is replaced before another plugin, and when it dies. What is lost with it is the motion that
    it followed, and nothing else.
    """

    _limit = _budget = 0.0

    def start(self, task: PlayerTask) -> str | None:
        """As of ``judge.online.StreamPlayer``."""
        self.seat(task)
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

    def _asked(self, stage: str, function: Callable[..., Any], *arguments: Any, kind: Any) -> Any:
        try:
            with faults_of(stage, self._limit):
                return self._child.call(function, *arguments, kind=kind, seconds=self._limit)
        except DiedError as error:
            raise PlayerFault("crash", str(error)) from error
