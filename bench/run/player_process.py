"""The player process as the referee sees it."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from olne_bench.bench.judge.players import Answer, PlayerFault, PlayerTask
from olne_bench.bench.process.child import (
    ATTEMPTS,
    Child,
    ChildError,
    DiedError,
    LeftProcessesError,
    MisspokeError,
    RaisedError,
    TimedOutError,
)
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.run import player
from olne_bench.bench.run.describe_plugins import LOAD_LIMIT
from olne_bench.bench.run.player import BUDGET, Libraries, Said, told
from olne_bench.errors import UserError


class PlayerProcess:
    """Player processes, one after the other, each for one plugin or the built-in estimators.

    Foreign code gets its own process, in a sandbox, so that it cannot affect others. A process that
    dies or is left in doubt is replaced; a motion that it followed is lost with it, and nothing
    else.
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
        self._limit = self._budget = 0.0

    def estimate(self, task: PlayerTask) -> Answer:
        """Set up an estimator and make an estimate.

        Raises:
            PlayerFault: if there is neither an estimate nor a reason why it declines.
        """
        self._seat(task)
        for attempt in range(1, ATTEMPTS + 1):
            used = self._child.served > 0
            try:
                declined = self._prepare(task)
                if declined is not None:
                    return Answer(declined=declined)
                return self._answer("estimate", player.estimate, task.observations)
            except DiedError as error:
                # A previous trial may have damaged the process.
                if not (error.outside or used) or attempt == ATTEMPTS:
                    raise PlayerFault("crash", str(error)) from error
            finally:
                if task.plugin:
                    self._child.renew()  # foreign code carries nothing from a trial to the next
        raise AssertionError

    def start(self, task: PlayerTask) -> str | None:
        """As of ``judge.players.StreamPlayer``."""
        self._seat(task)
        if task.plugin:
            self._child.end()  # foreign code carries nothing from a motion to the next
        with _death_as_fault():
            return self._prepare(task)

    def update(self, sample: np.ndarray) -> Answer:
        """As of ``judge.players.StreamPlayer``."""
        if not self._child.served:  # it was retired after the last answer
            raise PlayerFault(
                "invalid", "left threads, processes or too much memory, so its process was replaced"
            )
        with _death_as_fault():
            return self._answer("update", player.update, sample)

    def stop(self) -> None:
        """Kill the process and all its descendants."""
        self._child.stop()

    def _seat(self, task: PlayerTask) -> None:
        """Have a process for the estimator of a task."""
        place = (task.plugin, task.reference, task.homes) if task.plugin else ()
        if place != self._place:
            self.stop()
            homes = (task.reference, *task.homes)
            self._child = player_child(task, homes, self._memory, self._hidden)
            self._place = place

    def _prepare(self, task: PlayerTask) -> str | None:
        """Why the estimator declines the problem; None if it does not."""
        self._limit = task.time_limit if task.set_up_limit is None else task.set_up_limit
        self._budget = BUDGET * task.time_limit if task.budget is None else task.budget
        declined = self._asked("set-up", player.prepare, *told(task)).declined
        self._limit = task.time_limit
        return declined

    def _answer(self, stage: str, function: Callable[..., Said], seen: Any) -> Answer:
        began = time.perf_counter()
        said = self._asked(stage, function, seen, self._budget)
        seconds = time.perf_counter() - began
        if said.estimate is None:
            raise PlayerFault("invalid", said.malformed, seconds)
        return Answer(estimate=said.estimate, seconds=seconds)

    def _asked(self, stage: str, function: Callable[..., Said], *arguments: Any) -> Said:
        with _faults_of(stage, self._limit):
            said: Said = self._child.call(function, *arguments, kind=Said, seconds=self._limit)
            return said


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
    child = Child(memory=memory, restricted=True, plugins=homes, hidden=hidden)
    child.modules = (player.__name__,)
    with suppress(ChildError, RaisedError, UserError):  # its first trial will show it
        asked = (task.reference, task.parameters)
        seconds = min(LOAD_LIMIT, task.time_limit)
        found: Libraries = child.call(player.libraries, *asked, kind=Libraries, seconds=seconds)
        child.load(found.names)
    child.end()
    return child


@contextmanager
def _death_as_fault() -> Iterator[None]:
    """A process that dies while it follows a motion is the player's fault."""
    try:
        yield
    except DiedError as error:
        raise PlayerFault("crash", str(error)) from error


@contextmanager
def _faults_of(stage: str, limit: float) -> Iterator[None]:
    """Make the player's fault of what goes wrong in its process, but for its death."""
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
