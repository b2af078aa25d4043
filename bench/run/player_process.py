"""The player process as the referee sees it."""

import pickle
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from olne_bench.bench.judge.trials import Answer, PlayerFault, PlayerTask
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
from olne_bench.bench.run.describe_plugins import LOAD_LIMIT
from olne_bench.bench.run.player import (
    BUDGET,
    Answered,
    Libraries,
    Prepared,
    estimate,
    libraries,
    prepare,
)
from olne_bench.errors import UserError

_PLAYER_MODULES = ("olne_bench.bench.run.player", "olne_bench.bench.run.stream_player")


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
        self._place: tuple[object, ...] | None = None
        self._child = Child()

    def estimate(self, task: PlayerTask) -> Answer:
        """Set up an estimator and make an estimate.

        Raises:
            PlayerFault: if there is neither an estimate nor a reason why it declines.
        """
        self.seat(task)
        for attempt in range(1, ATTEMPTS + 1):
            used = self._child.served > 0
            try:
                return self._attempt(task)
            except DiedError as error:
                # A previous trial may have damaged the process.
                if not (error.outside or used) or attempt == ATTEMPTS:
                    raise PlayerFault("crash", str(error)) from error
            finally:
                if task.plugin:
                    self._child.renew()  # foreign code carries nothing from a trial to the next
        raise AssertionError

    def seat(self, task: PlayerTask) -> None:
        """Have a process for the estimator of a task."""
        place = (task.plugin, task.reference, task.homes) if task.plugin else ()
        if place != self._place:
            self.stop()
            homes = (task.reference, *task.homes)
            self._child = player_child(task, homes, self._memory, self._hidden)
            self._place = place

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
                BUDGET * task.time_limit,
                kind=Answered,
                seconds=task.time_limit,
            )
        seconds = time.perf_counter() - started
        if answered.estimate is None:
            raise PlayerFault("invalid", answered.malformed, seconds)
        return Answer(estimate=answered.estimate, seconds=seconds)


def player_child(
    task: PlayerTask, homes: Sequence[str], memory: int | None, hidden: Path | None
) -> Child:
    """A process for the estimator of a task.

    A plugin's has a fork server that knows its libraries, so that a fork imports the plugin alone.
    They are asked for once, of a fork that has seen no trial.

    Args:
        task: what it is for.
        homes: references of the plugins whose code it runs.
        memory: memory limit [bytes] of the process, None for no limit.
        hidden: folder that foreign code cannot read.
    """
    if not task.plugin:
        return Child(memory=memory)
    child = Child(
        memory=memory, restricted=True, plugins=homes, hidden=hidden, modules=_PLAYER_MODULES
    )
    with suppress(ChildError, RaisedError, UserError):  # its first trial will show it
        asked = (task.reference, task.parameters)
        seconds = min(LOAD_LIMIT, task.time_limit)
        found: Libraries = child.call(libraries, *asked, kind=Libraries, seconds=seconds)
        child.load(found.names)
    child.end()
    return child


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
