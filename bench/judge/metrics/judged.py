"""A trial as metrics see it: truth and estimate."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from olne_bench.envs.recordings.recording import Recording
from olne_bench.estimators.protocol import Estimate


@dataclass(frozen=True)
class HeldOut:
    """A prediction from another initial state nearby.

    Attributes:
        states: (T, N, n) of the true equilibrium there.
        prediction: (T, N, n) at the estimated weights.
    """

    states: np.ndarray
    prediction: np.ndarray


def nothing(*_: float) -> None:
    """What cannot be computed of a trial without a prediction: None."""


@dataclass(frozen=True)
class Judged:
    """One trial to score. Its arrays are read-only, because trials share the truth.

    Attributes:
        recordings: the true motions, one per trajectory; ``prediction`` is for the first.
        estimate: the well-formed estimate.
        prediction: (T, N, n) states of the forward game at the estimated weights, from the first
            recording's start; None if there is none.
        sigma: noise level of the observations [m].
        held_out: computes predictions from other initial states; None if there are none, or if
            the game has no root at one of them.
        likelihood_ratio: computes twice the log of the largest likelihood, next to the estimate,
            less that of the true weights; None if that fails.
        posterior_ratio: the same of the posterior in its normal chart, of one trajectory.
        held_out_samples: computes predictions (H, M, T, N, n) from the same states at so many of
            the estimate's samples at most, NaN where a sample has no game; None without samples.
        ahead: computes true and predicted states (S+1, N, n) of so many seconds after the last
            true state; None where either is not found.
    """

    recordings: tuple[Recording, ...]
    estimate: Estimate
    prediction: np.ndarray | None
    sigma: float
    held_out: Callable[[], tuple[HeldOut, ...] | None] = nothing
    likelihood_ratio: Callable[[], float | None] = nothing
    posterior_ratio: Callable[[], float | None] = nothing
    held_out_samples: Callable[[int], np.ndarray | None] = nothing
    ahead: Callable[[float], tuple[np.ndarray, np.ndarray] | None] = nothing

    def __post_init__(self) -> None:
        for one in self.recordings:
            _lock(one.states, one.controls, one.costates, one.extra_state, one.scenario.weights)
        estimate = self.estimate
        _lock(estimate.weights, estimate.states, estimate.covariance, self.prediction)
        _lock(estimate.samples, estimate.parameter_samples)

    @property
    def states(self) -> np.ndarray:
        """(T, N, n) true states of the first recording."""
        return self.recordings[0].states

    @property
    def weights(self) -> np.ndarray:
        """(N, K) true weights, rows sum to one."""
        return self.recordings[0].scenario.weights


class Once:
    """A value that is computed at its first use and kept; unlike a cache, it can be pickled."""

    def __init__(self, compute: Callable[[], float | None]) -> None:
        self._compute = compute
        self._value: tuple[float | None, ...] = ()

    def __call__(self) -> float | None:
        if not self._value:
            self._value = (self._compute(),)
        return self._value[0]


def _lock(*arrays: np.ndarray | None) -> None:
    for array in arrays:
        if array is not None:
            array.setflags(write=False)
