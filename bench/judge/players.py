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
    """All that a player process is told before it is asked for estimates.

    Attributes:
        reference: name or file of the estimator.
        parameters: parameters of the estimator.
        plugin: identifies an estimator that is a plugin; empty for a built-in one.
        problem: what is known about the game.
        seed: seed of the estimator's random numbers.
        time_limit: time [s] for set-up, and again for each estimate.
        homes: files of plugins whose classes the problem contains.
        observations: one for each trajectory; none if samples are handed out one by one.
        lag: number of latest samples that count then; None for all.
        budget: time [s] that an estimate after a sample is told to keep to; None for a share of the
            time limit.
        set_up_limit: time [s] for set-up; None for the time limit.
    """

    reference: str
    parameters: dict[str, Any]
    plugin: str
    problem: Problem
    seed: int
    time_limit: float
    homes: tuple[str, ...] = ()
    observations: tuple[Observation, ...] = ()
    lag: int | None = None
    budget: float | None = None
    set_up_limit: float | None = None

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
    """The answer of a player.

    Attributes:
        declined: why the estimator declines the problem; None if it does not.
        estimate: the unchecked estimate.
        seconds: time from sending the observations to receiving the estimate [s].
    """

    declined: str | None = None
    estimate: RawEstimate | None = None
    seconds: float = 0.0


class PlayerFault(Exception):  # noqa: N818 (names whose fault it is)
    """A player gave no answer.

    Attributes:
        status: status of the trial.
        seconds: as in ``Answer``, if an invalid estimate was returned.
    """

    def __init__(self, status: str, message: str, seconds: float | None = None) -> None:
        super().__init__(message)
        self.status, self.seconds = status, seconds


class Player(Protocol):
    """Runs an estimator on whole observations."""

    def estimate(self, task: PlayerTask) -> Answer:
        """The estimator's answer.

        Raises:
            PlayerFault: if there is none.
        """


class StreamPlayer(Protocol):
    """Runs an estimator on one motion after the other."""

    def start(self, task: PlayerTask) -> str | None:
        """Begin a motion; why the estimator declines the problem, or None.

        Raises:
            PlayerFault: if it does neither.
        """

    def update(self, sample: np.ndarray) -> Answer:
        """The estimator's answer to the next sample (N, d).

        Raises:
            PlayerFault: if there is none.
        """


class ForeignMetrics(Protocol):
    """Computes metrics that are foreign code."""

    def score(
        self, metric: MetricEntry, case: Judged, homes: Sequence[str], seconds: float
    ) -> float | None:
        """The score of a trial; None if the metric does not apply.

        Raises:
            MetricError: if the metric fails or returns no valid score.
        """


def silent(stage: str, seconds: float) -> None:
    """An ``Announce`` that does nothing."""


@dataclass(frozen=True)
class Staff:
    """Whom a referee has.

    Attributes:
        player: runs the estimator: a ``Player`` in a study of trials, else a ``StreamPlayer``.
        metrics: computes foreign metrics.
        announce: called as each stage begins.
    """

    player: Any
    metrics: ForeignMetrics
    announce: Announce = silent


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
