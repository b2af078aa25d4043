"""Estimates while a motion goes on: one sample after the other, and past samples only.

An estimator makes a stream of a problem by its method ``start``; one that has only ``estimate``
becomes one by ``Windows``, which estimates from all samples so far, the others missing.

With a lag, only the latest samples count. Open-loop equilibria are consistent in time, so a window
is the beginning of a shorter game of the same weights, whose x_1 is the state at the oldest sample
that counts. Players that plan again all the time (``Problem.goes_on``) always look as far ahead, so
there the game is as long as ever, and there are samples without end.
"""

from collections import deque
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

import numpy as np

from olne_bench.estimators.protocol import Estimate, Estimator, Observation, Problem
from olne_bench.games.model.observation import observation_size

#: Least lag: a game has two states at least.
LEAST_LAG = 2


class Stream(Protocol):
    """Estimates of one motion as it goes on."""

    def update(self, sample: np.ndarray, *, budget: float) -> Estimate:
        """Estimate from the samples up to now; the last one (N, d), NaN if missing, stays as it is.

        The budget is in wall-clock seconds, as in ``Estimator.estimate``. The estimate's ``states``
        (T, N, n), if there are any, hold past states and the prediction of all others.
        """


class StreamEstimator(Protocol):
    """An estimator that follows a motion; ``supports`` and ``warm_up`` are as of ``Estimator``."""

    def start(
        self, problem: Problem, *, rng: np.random.Generator, lag: int | None = None
    ) -> Stream:
        """A stream of one motion.

        Args:
            problem: what is known. It is a copy and must not be changed.
            rng: the only source of randomness, seeded per episode.
            lag: number of latest samples that count; None for all. A method that carries what it
                knows along may use more. A motion that goes on has a lag.
        """


class StreamEndedError(ValueError):
    """There are more samples than the game has states."""


class Samples:
    """The samples so far, ``count`` of them, and the window that counts."""

    def __init__(self, problem: Problem, lag: int | None = None) -> None:
        """No samples yet; ``lag`` of them count, or all if None.

        Raises ValueError on a lag below ``LEAST_LAG`` or longer than the game; on none if it goes
        on.
        """
        self._problem, self._lag = problem, checked_lag(lag)
        horizon = problem.game.horizon
        if lag is not None and lag > horizon:
            raise ValueError(f"a lag of {lag} samples is longer than the motion, of {horizon}")
        if lag is None and problem.goes_on:
            raise ValueError("a motion that goes on needs a lag: the number of samples that count")
        self._latest: deque[np.ndarray] = deque(maxlen=lag)
        self.count = 0

    def add(self, sample: np.ndarray) -> None:
        """Take a sample; StreamEndedError after the last, ValueError on wrong shape or infinity."""
        sample, view, game = np.array(sample, dtype=float), self._problem.view, self._problem.game
        if self.count == game.horizon and not self._problem.goes_on:
            raise StreamEndedError(f"the game ends after {game.horizon} samples, got one more")
        shape = (game.num_players, observation_size(view, game.dynamics))
        if sample.shape != shape:
            raise ValueError(
                f"a sample has the shape {sample.shape}, expected {shape} for the view "
                f"{view.name!r}"
            )
        if np.isinf(sample).any():
            raise ValueError("a sample has infinite entries; a missing one is NaN")
        self._latest.append(sample)
        self.count += 1

    @property
    def dropped(self) -> int:
        """Number of samples that count no more."""
        return self.count - len(self._latest)

    @property
    def past(self) -> int:
        """Number of steps of the problem's game before the window."""
        return 0 if self._problem.goes_on else self.dropped

    def window(self) -> tuple[Problem, Observation]:
        """The game that begins at the oldest sample that counts, and what is seen of it."""
        game = self._problem.game
        left = replace(game, horizon=game.horizon - self.past)
        seen = np.stack(self._latest)
        y = np.full((left.horizon, *seen.shape[1:]), np.nan)
        y[: len(seen)] = seen
        return replace(self._problem, game=left), Observation(y)

    def lags(self) -> range:
        """The numbers of steps that windows may lack."""
        if self._lag is None or self._problem.goes_on:
            return range(1)
        return range(self._problem.game.horizon - self._lag + 1)


@dataclass(frozen=True)
class Windows:
    """Makes a stream of an estimator that takes whole observations."""

    estimator: Estimator

    def start(
        self, problem: Problem, *, rng: np.random.Generator, lag: int | None = None
    ) -> Stream:
        """As of ``StreamEstimator``; ValueError on a lag below ``LEAST_LAG``."""
        return WindowStream(self.estimator, Samples(problem, lag), rng)


def as_stream_estimator(estimator: Any) -> StreamEstimator:
    """The estimator itself if it follows motions, or else its windows."""
    return estimator if hasattr(estimator, "start") else Windows(estimator)


def warm_up_stream(estimator: Any, problem: Problem, lag: int | None) -> None:
    """Build solvers for windows of every length; ValueError on a lag below ``LEAST_LAG``."""
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
        """As of ``Stream``; ValueError as ``Samples.add``, and what the estimator raises."""
        self._samples.add(sample)
        problem, observation = self._samples.window()
        estimate = self._estimator.estimate(problem, observation, rng=self._rng, budget=budget)
        whole: Estimate = self._past.with_states_of(estimate, self._samples.past)
        return whole


class Past:
    """States before the window: those of the last estimates that had them in theirs."""

    def __init__(self) -> None:
        self._states: np.ndarray | None = None

    def with_states_of(self, estimate: Any, past: int) -> Any:
        """The estimate of a window, with states from ``past`` steps earlier, the motion's start.

        It may be any object with attributes of ``Estimate``. It has no states unless those of all
        steps before the window are known.
        """
        states = _motion(getattr(estimate, "states", None))
        if states is None or not hasattr(estimate, "weights"):
            return estimate  # if something is wrong with it, the referee says so
        if past:
            before = None if self._states is None else self._states[:past]
            fits = before is not None and before.shape[1:] == states.shape[1:]
            states = np.concatenate([before, states]) if fits else None
        if getattr(estimate, "converged", True) or self._states is None:
            self._states = states
        return replace(as_estimate(estimate), states=states) if past else estimate


def _motion(states: Any) -> np.ndarray | None:
    """States (T, N, n) as an array; None if they are none."""
    try:
        array = np.asarray(states, dtype=float)
    except (ValueError, TypeError):
        return None
    return array if array.ndim == 3 else None


def as_estimate(result: Any) -> Estimate:
    """An ``Estimate`` with the attributes that an object has; the others have their defaults."""
    if isinstance(result, Estimate):
        return result
    names = [field.name for field in fields(Estimate) if hasattr(result, field.name)]
    return Estimate(**{name: getattr(result, name) for name in names})


def checked_lag(lag: int | None) -> int | None:
    """A lag, None for all samples; ValueError unless an integer of at least ``LEAST_LAG``."""
    whole = isinstance(lag, int) and not isinstance(lag, bool)
    if lag is not None and not (whole and lag >= LEAST_LAG):
        raise ValueError(f"a lag is a number of samples of at least {LEAST_LAG}, got {lag!r}")
    return lag
