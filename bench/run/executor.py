"""Run trials in processes of this machine, each with a hard time limit.

A trial that hangs is killed at its limit. If a trial takes its process down, only that trial is
lost: the process is replaced and the others continue.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby, islice
from pathlib import Path

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.process.channel import wait_for
from olne_bench.bench.process.child import TICK
from olne_bench.bench.run.referee import RefereeProcess

#: Number of groups of trials among which a new referee looks for one of another scenario.
_AHEAD = 50


def never() -> bool:
    """A ``stop`` that never asks a run to stop."""
    return False


def run_trials(
    trials: Iterable[Trial],
    *,
    jobs: int,
    log: Path | None = None,
    memory: int | None = None,
    hidden: Path | None = None,
    stop: Callable[[], bool] = never,
) -> Iterator[tuple[Trial, Outcome]]:
    """Run trials in parallel; yield each with its outcome as it ends.

    Args:
        trials: what to run; read lazily.
        jobs: number of trials at the same time.
        log: file for what estimators print. Default: standard error.
        memory: memory limit [bytes] of each process that runs foreign code, None for no limit.
        hidden: folder that foreign code cannot read, as it holds the run.
        stop: called several times a second; once it is true, only ended trials are yielded.

    Raises:
        UserError: if processes do not start, or the code changes during the run.
    """
    shares = _Shares(trials)
    referees: list[RefereeProcess] = [
        RefereeProcess(log=log, memory=memory, hidden=hidden) for _ in range(jobs)
    ]
    try:
        for referee in referees:
            if (first := shares.next(referee)) is not None:
                referee.assign(first)
        while busy := [referee for referee in referees if referee.trial is not None]:
            stopping = stop()
            if not stopping:
                wait_for([referee.channel for referee in busy], TICK)
            ended = []
            for referee in busy:
                at_work = referee.trial
                outcome = referee.poll()
                if at_work is None or outcome is None:
                    continue
                ended.append((at_work, outcome))
                following = None if stopping else shares.next(referee)
                if following is not None:
                    referee.assign(following)  # it works while its last outcome is stored
            yield from ended
            if stopping:
                return
    finally:
        for referee in referees:
            referee.stop()


class _Shares:
    """Trials for several referees: each keeps to one draw, as truths and solvers are kept there."""

    def __init__(self, trials: Iterable[Trial]) -> None:
        self._groups = (deque(group) for _, group in groupby(trials, _group))
        self._passed: deque[deque[Trial]] = deque()  # groups that were passed over
        self._own: dict[RefereeProcess, deque[Trial]] = {}

    def next(self, referee: RefereeProcess) -> Trial | None:
        """The next trial for a referee: of its draw, of another, of one that others are at."""
        if not self._own.get(referee):
            others = max(self._own.values(), key=len, default=deque())
            group = None if referee in self._own else self._elsewhere()
            if group is None:
                group = self._passed.popleft() if self._passed else next(self._groups, others)
            self._own[referee] = group
        own = self._own[referee]
        return own.popleft() if own else None

    def _elsewhere(self) -> deque[Trial] | None:
        """A group of a scenario that nobody is at, as two would wait for what one compiles."""
        taken = {own[0].scenario.label for own in self._own.values() if own}
        for group in () if self._passed else islice(self._groups, _AHEAD):
            if group[0].scenario.label not in taken:
                return group
            self._passed.append(group)
        return None


def _group(trial: Trial) -> tuple[object, ...]:
    """What trials have in common that one process should run: a draw, or solvers of one game."""
    if trial.scenario.family:
        return trial.suite, trial.scenario.label, trial.plugin, trial.seed
    return trial.suite, trial.scenario.label, trial.sensor.label, trial.estimator.label
