"""Run trials for a check: those that play them cannot tell it from a run."""

from collections.abc import Generator, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.run.executor import run_trials

#: As the file of a run that holds what estimators print.
_LOG = "workers.log"


@dataclass(frozen=True)
class Machine:
    """How trials are run.

    Attributes:
        jobs: number of trials at the same time.
        memory: memory limit [bytes] of each process that runs foreign code.
        hidden: folder that foreign code cannot read.
    """

    jobs: int
    memory: int
    hidden: Path


def row_of(trial: Trial, outcome: Outcome) -> dict[str, Any]:
    """The row of a trial, as tables have it."""
    return trial.labels | asdict(outcome) | outcome.scores


def run_all(
    trials: Iterable[Trial], machine: Machine
) -> Generator[tuple[Trial, Outcome], None, None]:
    """Run trials in places that are named as those of a run, and yield them as they end."""
    with TemporaryDirectory() as place:
        yield from run_trials(
            trials,
            jobs=machine.jobs,
            memory=machine.memory,
            hidden=machine.hidden,
            log=Path(place) / _LOG,
        )
