"""What a referee asks of players and of foreign metrics, and how long they may take."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.judge.raw_estimate import RawEstimate
from olne_bench.bench.plan.entries import MetricEntry
from olne_bench.bench.plan.trial import Trial
from olne_bench.estimators.protocol import Observation, Problem

#: Longest time that a player may take in all: this many time limits, plus this time [s] for the
#: start of its process.
_PLAYER_LIMITS, _PLAYER_START = 10, 1000.0
#: Least time limit [s] of the referee's own work, as machines may be busy.
_OWN_SECONDS = 60.0

#: Is called with the name of each stage as it begins, and the time that it may take [s].
Announce = Callable[[str, float], None]


@dataclass(frozen=True)
class PlayerTask:
    """All that a player process is told before it is asked for estimates."""

    reference: str  # name or file of the estimator
    parameters: dict[str, Any]
    plugin: str  # identifies an estimator that is a plugin; empty for a built-in one
    problem: Problem  # what is known about the game
    seed: int  # of the estimator's random numbers
    time_limit: float  # [s] for set-up, and again for each estimate
    homes: tuple[str, ...] = ()  # files of plugins whose classes the problem contains
    #: one per trajectory; none if samples come one by one
    observations: tuple[Observation, ...] = ()
    lag: int | None = None  # number of latest samples that count then; None for all
    #: [s] that an estimate after a sample is told; None: a share of the limit
    budget: float | None = None
    set_up_limit: float | None = None  # [s]; None for the time limit

    @classmethod
    def of(cls, trial: Trial, problem: Problem, seed: int, **more: Any) -> "PlayerTask":
        """The task of a trial's estimator; ``more`` are fields that have a default."""
        return cls(
            reference=trial.estimator.name,
            parameters=trial.estimator.parameters,
            plugin=trial.plugin,
            problem=problem,
            seed=seed,
            time_limit=trial.time_limit,
            homes=trial.home_plugins,
            **more,
        )


@dataclass(frozen=True)
class Answer:
    """The answer of a player."""

    declined: str | None = None  # why the estimator declines the problem; None if it does not
    estimate: RawEstimate | None = None  # unchecked
    seconds: float = 0.0  # from sending the observations to receiving the estimate [s]


class PlayerFault(Exception):  # noqa: N818 (names whose fault it is)
    """A player gave no answer, or an invalid one after so many seconds: the status of the trial."""

    def __init__(self, status: str, message: str, seconds: float | None = None) -> None:
        super().__init__(message)
        self.status, self.seconds = status, seconds


class Player(Protocol):
    """Runs an estimator on whole observations."""

    def estimate(self, task: PlayerTask) -> Answer:
        """The estimator's answer, or ``PlayerFault``."""


class StreamPlayer(Protocol):
    """Runs an estimator on one motion after the other."""

    def start(self, task: PlayerTask) -> str | None:
        """Begin a motion: why the estimator declines it, None, or ``PlayerFault``."""

    def update(self, sample: np.ndarray) -> Answer:
        """The estimator's answer to the next sample (N, d), or ``PlayerFault``."""


class ForeignMetrics(Protocol):
    """Computes metrics that are foreign code."""

    def score(
        self, metric: MetricEntry, case: Judged, homes: Sequence[str], seconds: float
    ) -> float | None:
        """The score of a trial; None if it does not apply, ``MetricError`` if it is not valid."""


def silent(stage: str, seconds: float) -> None:
    """An ``Announce`` that does nothing."""


@dataclass(frozen=True)
class Staff:
    """Whom a referee has."""

    player: Any  # runs the estimator: a ``Player`` in a study of trials, else a ``StreamPlayer``
    metrics: ForeignMetrics
    announce: Announce = silent  # called as each stage begins


def own_seconds(trial: Trial) -> float:
    """Time limit of the referee's own stages [s]; foreign code gets no more than the trial's."""
    return trial.time_limit if trial.home_plugins else max(trial.time_limit, _OWN_SECONDS)


def longest_seconds(trial: Trial) -> float:
    """Longest time [s] that a player may take in all."""
    return _PLAYER_LIMITS * trial.time_limit + _PLAYER_START


def all_seconds(trial: Trial) -> float:
    """Longest time [s] that all stages of a trial may take together."""
    metrics = len(trial.metrics) * trial.time_limit
    return 3 * own_seconds(trial) + longest_seconds(trial) + metrics
