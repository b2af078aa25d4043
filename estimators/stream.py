"""Estimates while a motion goes on: one sample after the other, and past samples only.

A stream has seen the samples up to now, and each further one yields an estimate. So it cannot know
what comes later. An estimator makes a stream of a problem by its method ``start``; one that has
only ``estimate`` becomes one by ``Windows``, which estimates from all samples so far, the others
missing.

With a lag, only the latest samples count. Open-loop equilibria are consistent in time: the rest of
a motion is the equilibrium of the game that is left, from the state where it begins. So a window
is the beginning of a shorter game of the same weights, whose x_1 is the state at the oldest sample
that counts.
"""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from olne_bench.estimators.protocol import Estimate, Estimator, Observation, Problem
from olne_bench.games.observation import observation_size

#: Least lag: a game has two states at least.
LEAST_LAG = 2


class Stream(Protocol):
    """Estimates of one motion as it goes on."""

    def update(self, sample: np.ndarray, *, budget: float) -> Estimate:
        """Estimate from the samples up to now.

        Args:
            sample: (N, d) the next sample; a missing one is NaN. It must not be changed.
            budget: wall-clock seconds that it may take, as in ``Estimator.estimate``.

        Returns:
            The estimate. Its ``states`` (T, N, n), if there are any, hold past states and the
            prediction of all others.
        """


class StreamEstimator(Protocol):
    """An estimator that follows a motion.

    ``supports(problem)`` and ``warm_up(problem)`` are used if they exist, as in ``Estimator``.
    """

    def start(
        self, problem: Problem, *, rng: np.random.Generator, lag: int | None = None
    ) -> Stream:
        """A stream of one motion.

        Args:
            problem: what is known. It is a copy and must not be changed.
            rng: the only source of randomness, seeded per episode.
            lag: number of latest samples that count; None for all so far. A method that carries
                what it knows from one sample to the next may use more.
        """


class StreamEndedError(ValueError):
    """There are more samples than the game has states."""


class Samples:
    """The samples so far, and the window that counts.

    Attributes:
        y: (T, N, d) samples, NaN from the next one on.
        count: number of samples so far.
    """

    def __init__(self, problem: Problem, lag: int | None = None) -> None:
        """No samples yet.

        Args:
            problem: what is known.
            lag: number of samples that count; None for all.

        Raises:
            ValueError: on a lag below ``LEAST_LAG``, or longer than the motion.
        """
        self._problem, self._lag = problem, checked_lag(lag)
        game = problem.game
        if lag is not None and lag > game.horizon:
            raise ValueError(f"a lag of {lag} samples is longer than the motion, of {game.horizon}")
        size = observation_size(problem.view, game.dynamics)
        self.y = np.full((game.horizon, game.num_players, size), np.nan)
        self.count = 0

    def add(self, sample: np.ndarray) -> None:
        """Take the next sample.

        Raises:
            StreamEndedError: after the last one.
            ValueError: on a wrong shape, or on infinity.
        """
        sample = np.asarray(sample, dtype=float)
        if self.count == len(self.y):
            raise StreamEndedError(f"the game ends after {len(self.y)} samples, got one more")
        if sample.shape != self.y.shape[1:]:
            raise ValueError(
                f"a sample has the shape {sample.shape}, expected {self.y.shape[1:]} for the view "
                f"{self._problem.view.name!r}"
            )
        if np.isinf(sample).any():
            raise ValueError("a sample has infinite entries; a missing one is NaN")
        self.y[self.count] = sample
        self.count += 1

    @property
    def dropped(self) -> int:
        """Number of samples that count no more."""
        return 0 if self._lag is None else max(0, self.count - self._lag)

    def window(self) -> tuple[Problem, Observation]:
        """The game that begins at the oldest sample that counts, and what is seen of it."""
        game, first = self._problem.game, self.dropped
        shorter = replace(game, horizon=game.horizon - first)
        return replace(self._problem, game=shorter), Observation(self.y[first:].copy())

    def lags(self) -> range:
        """The numbers of samples that may be dropped."""
        most = 0 if self._lag is None else max(0, len(self.y) - self._lag)
        return range(most + 1)


@dataclass(frozen=True)
class Windows:
    """Makes a stream of an estimator that takes whole observations.

    Attributes:
        estimator: the estimator.
    """

    estimator: Estimator

    def start(
        self, problem: Problem, *, rng: np.random.Generator, lag: int | None = None
    ) -> Stream:
        """As of ``StreamEstimator``.

        Raises:
            ValueError: on a lag below ``LEAST_LAG``.
        """
        return WindowStream(self.estimator, Samples(problem, lag), rng)


def as_stream_estimator(estimator: Any) -> StreamEstimator:
    """The estimator itself if it follows motions, or else its windows."""
    return estimator if hasattr(estimator, "start") else Windows(estimator)


def warm_up_stream(estimator: Any, problem: Problem, lag: int | None) -> None:
    """Build an estimator's solvers for the windows of every length.

    Raises:
        ValueError: on a lag below ``LEAST_LAG``.
    """
    if not hasattr(estimator, "warm_up"):
        return
    for dropped in Samples(problem, lag).lags():
        game = replace(problem.game, horizon=problem.game.horizon - dropped)
        estimator.warm_up(replace(problem, game=game))


class WindowStream:
    """Estimates from the samples of a window, each from scratch."""

    def __init__(self, estimator: Estimator, samples: Samples, rng: np.random.Generator) -> None:
        self._estimator, self._samples, self._rng = estimator, samples, rng
        self._past = Past()

    def update(self, sample: np.ndarray, *, budget: float) -> Estimate:
        """As of ``Stream``.

        Raises:
            ValueError: as ``Samples.add``, and what the estimator raises.
        """
        self._samples.add(sample)
        problem, observation = self._samples.window()
        estimate = self._estimator.estimate(problem, observation, rng=self._rng, budget=budget)
        return self._past.with_states_of(estimate, self._samples.dropped)


class Past:
    """States before the window: those of the last estimates that had them in theirs."""

    def __init__(self) -> None:
        self._states: np.ndarray | None = None

    def with_states_of(self, estimate: Estimate, dropped: int) -> Estimate:
        """The estimate of a window, with states from the beginning of the motion.

        Without states of all steps before the window, it has none.
        """
        states = estimate.states
        if states is None:
            return estimate
        if dropped:
            before = None if self._states is None else self._states[:dropped]
            states = None if before is None else np.concatenate([before, states])
        if estimate.converged or self._states is None:
            self._states = states
        return replace(estimate, states=states)


def checked_lag(lag: int | None) -> int | None:
    """A lag, or None for all samples.

    Raises:
        ValueError: unless it is an integer of at least ``LEAST_LAG``.
    """
    whole = isinstance(lag, int) and not isinstance(lag, bool)
    if lag is not None and not (whole and lag >= LEAST_LAG):
        raise ValueError(f"a lag is a number of samples of at least {LEAST_LAG}, got {lag!r}")
    return lag
