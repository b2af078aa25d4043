"""LUCIDGames' filter as an estimator: weights tracked by an unscented Kalman filter, step by step.

    olne-bench run quick --seeds 1 --plugin examples/lucidgames.py --sensor full --out runs/lucid

As in the paper, the filter's state is the unknown costs. They wander from sample to sample by a
little noise; each sigma point solves the game from the last state, over the horizon that is left;
what it predicts for the next sample is corrected by that sample. The game is open-loop, and states
are taken as measured, so noise of the last state counts as noise of the next one.

``ukf`` of the benchmark departs from this: it predicts all samples from one unknown first state.
Here are ours, as the paper's costs are no shares: logarithms of weights less their mean are
filtered, with a standard deviation of 1 at first, and their standard deviation grows by 0.05 in
each step. A set of sigma points without a game shrinks by half, as in the authors' code.

Paper: Le Cleac'h, Schwager, Manchester, LUCIDGames, IEEE RA-L 2021.
Assumes: a known noise level and whole states in each sample.
Cost: 0.3 s for two players.
Trust: at very little noise only. One step of a motion says little about the weights behind it.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
from scipy.special import softmax

from olne_bench import solve_olne
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.newton import Root

_LEAST_SPREAD = 0.01
_LEAST_NOISE = 1e-6  # exact samples leave nothing to divide by


@dataclass(frozen=True)
class LucidGames:
    """Filters logarithms of weights through the samples.

    Attributes:
        spread: their standard deviation before the first sample.
        wander: standard deviation of what they change from one sample to the next.
    """

    name: ClassVar[str] = "lucidgames"
    spread: float = 1.0
    wander: float = 0.05

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> SimpleNamespace:
        """The last belief; not converged where states are hidden or a game is not found."""
        game, y = problem.game, observation.y
        shape = game.num_players, game.num_weights
        if problem.view.name != "full" or not np.isfinite(y).all():
            return _failed(shape, "needs a sensor that shows the whole state at every step")
        found = solve_olne(game, np.full(shape, 1 / shape[1]), y[0])
        if not found.certificate.passed:
            return _failed(shape, "no equilibrium from the first sample with equal weights")
        noise = 2 * (max(problem.sigma, _LEAST_NOISE) * np.tile(problem.noise_scale, shape[0])) ** 2
        filtered = _Filter(np.prod(shape), self.spread)
        root, mean = Root(found.states, found.controls, found.costates, 0.0), filtered.mean
        for t in range(len(y) - 1):
            part = replace(game, horizon=game.horizon - t)
            points = filtered.points()
            while True:
                batch = solve_batch(
                    part, _weights(points, shape), root, _weights(mean, shape),
                    initial_states=y[t], tolerance=1e-8,
                )  # fmt: skip
                if batch.converged.all():
                    break
                if filtered.shrink() < _LEAST_SPREAD:
                    return _failed(shape, f"no equilibrium from sample {t}", filtered.mean)
                points = filtered.points()
            mean, root = filtered.mean, batch.root(0)
            filtered.correct(batch.states[:, 1].reshape(len(points), -1), y[t + 1].ravel(), noise)
            filtered.covariance += self.wander**2 * np.eye(len(mean))
            root = Root(root.states[1:], root.controls[1:], root.costates[1:], root.residual)
        return SimpleNamespace(weights=_weights(filtered.mean, shape))


class _Filter:
    """Mean and covariance of a constant state, and its last sigma points."""

    def __init__(self, size: int, spread: float) -> None:
        self.mean, self.covariance = np.zeros(size), spread**2 * np.eye(size)
        self._scale = 1.0

    def points(self) -> np.ndarray:
        """(2n+1, n): the mean, and n pairs at sqrt(n) standard deviations, or nearer."""
        root = np.linalg.cholesky(len(self.mean) * self.covariance) * self._scale
        self._away = np.concatenate([np.zeros((1, len(self.mean))), root.T, -root.T])
        return np.asarray(self.mean + self._away)

    def shrink(self) -> float:
        """Nearer sigma points of the same belief."""
        self._scale /= 2
        return self._scale

    def correct(self, expected: np.ndarray, sample: np.ndarray, noise: np.ndarray) -> None:
        """The unscented update with a sample (d,) of noise variances (d,)."""
        weights = np.full(len(expected), 1 / (2 * len(self.mean) * self._scale**2))
        weights[0] = 1 - weights[1:].sum()
        error = expected - weights @ expected
        size = weights[1:, None]  # the mean's row, whose weight may be negative, has no error
        crossed = self._away[1:].T @ (size * error[1:])
        spread = error[1:].T @ (size * error[1:]) + np.diag(noise)
        gain = np.linalg.solve(spread, crossed.T).T
        self.mean = self.mean + gain @ (sample - weights @ expected)
        covariance = self.covariance - gain @ spread @ gain.T
        self.covariance, self._scale = (covariance + covariance.T) / 2, 1.0


def _weights(logarithms: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Rows (..., N, K) that sum to one."""
    return np.asarray(softmax(logarithms.reshape(*logarithms.shape[:-1], *shape), axis=-1))


def _failed(
    shape: tuple[int, int], why: str, logarithms: np.ndarray | None = None
) -> SimpleNamespace:
    last = np.zeros(np.prod(shape)) if logarithms is None else logarithms
    return SimpleNamespace(weights=_weights(last, shape), converged=False, message=why)
