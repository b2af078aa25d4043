"""The player process as the referee sees it."""

import pickle
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from olne_bench.bench.judge.referee import Answer, PlayerFault, PlayerTask
from olne_bench.bench.process.child import (
    ATTEMPTS,
    Child,
    ChildError,
    DiedError,
    LeftProcessesError,
    MisspokeError,
    RaisedError,
    StartError,
    TimedOutError,
)
from olne_bench.bench.run.player import Answered, Prepared, estimate, prepare
from olne_bench.errors import UserError

#: Share of the time limit that an estimate may spend, so that it can say that its time has ended.
_BUDGET = 0.8


class PlayerProcess:
    """Player processes, one after the other, each for one plugin or the built-in estimators.

    Foreign code gets its own process, in a sandbox, so that it cannot affect others.
    """

    def __init__(self, *, memory: int | None, hidden: Path | None) -> None:
        """Nothing is started yet.

        Args:
            memory: memory limit [bytes] of a process, None for no limit.
            hidden: folder that foreign code cannot read.
        """
        self._memory, self._hidden = memory, hidden
        self._plugin: str | None = None
        self._child = Child()

    def estimate(self, task: PlayerTask) -> Answer:
        """Set up an estimator and make an estimate.

        Raises:
            PlayerFault: if there is neither an estimate nor a reason why it declines.
        """
        if task.plugin != self._plugin:
            self.stop()
            foreign = task.plugin != ""
            self._child = Child(memory=self._memory, restricted=foreign, hidden=self._hidden)
            self._plugin = task.plugin
        for attempt in range(1, ATTEMPTS + 1):
            used = self._child.served > 0
            try:
                return self._attempt(task)
            except DiedError as error:
                # A previous trial may have damaged the process.
                if not (error.outside or used) or attempt == ATTEMPTS:
                    raise PlayerFault("crash", str(error)) from error
        raise AssertionError

    def stop(self) -> None:
        """Kill the process and all its descendants."""
        self._child.stop()

    def _attempt(self, task: PlayerTask) -> Answer:
        with faults_of("set-up", task.time_limit):
            prepared: Prepared = self._child.call(
                prepare,
                task.reference,
                task.parameters,
                task.homes,
                pickle.dumps(task.problem),
                len(task.observations),
                kind=Prepared,
                seconds=task.time_limit,
            )
        if prepared.declined is not None:
            return Answer(declined=prepared.declined)
        started = time.perf_counter()
        with faults_of("estimate", task.time_limit):
            answered: Answered = self._child.call(
                estimate,
                task.observations,
                task.seed,
                _BUDGET * task.time_limit,
                kind=Answered,
                seconds=task.time_limit,
            )
        seconds = time.perf_counter() - started
        if answered.estimate is None:
            raise PlayerFault("invalid", answered.malformed, seconds)
        return Answer(estimate=answered.estimate, seconds=seconds)


@contextmanager
def faults_of(stage: str, limit: float) -> Iterator[None]:
    """What goes wrong in a player's process as the player's fault, but for its death.

    Args:
        stage: name of its work.
        limit: time limit of it [s].

    Raises:
        PlayerFault: if the work has no valid result.
        DiedError: if the process died.
        StartError: if it did not start.
    """
    try:
        yield
    except TimedOutError as error:
        raise PlayerFault("timeout", f"killed after {limit:g} s of {stage}") from error
    except (LeftProcessesError, MisspokeError) as error:
        raise PlayerFault("invalid", str(error)) from error
    except (DiedError, StartError):
        raise
    except (ChildError, RaisedError, UserError) as error:
        raise PlayerFault("crash", str(error)) from error
