"""Whether noise explains what an estimate leaves of the observations: one test for all methods.

Residuals are those of the posterior's peak (B1) near the estimate (``posterior_density``), so that
the test is of the model and the noise, not of the search. Over their noise scale and sigma they
have, if both are as told, the covariance I - A with A = J (J'J + P)^-1 J'. J is the derivative of
the expected samples over their noise, in coordinates of weights and unknowns whose prior is
standard normal and in initial states; P is the precision of what is known before. Three statistics,
of each player and over all:

- the sum of squares: a model that does not fit, or a noise level that is too small or too large;
- the sum of products of consecutive samples over that of squares: errors that follow each other;
- the logarithm of the sum of fourth powers over the square of that of squares: outliers.

Their distributions are those of ``_DRAWS`` residuals with this covariance, continued by a Pearson
III distribution with the same first three moments. The smallest p-value of all is corrected for
their number, as far as they are independent (Sidak's formula with the number that fits the draws).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammainc, gammaincc, ndtr

from olne_bench.estimators.protocol import FIT_LEVEL, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame, game_of_motion
from olne_bench.estimators.shared.posterior_density import Places, climbed, density_near
from olne_bench.estimators.shared.white_noise import with_white_noise

_DRAWS = 1000
#: Level at which the number of independent statistics is found.
_TAIL = 0.03
#: Samples, less what was fitted, below which nothing can be tested.
_FEWEST = 10.0

_FLAT = 1e-12  # precision of initial states
#: Residuals of samples that a fit explains nearly alone, as near folds, are not scaled up further:
#: they are as small as that only where the fit is linear.
_LEAST_LEFT = 0.2
_KINDS = ("size", "order", "outliers")
#: Skewness below which a Pearson III distribution is as good as normal.
_SYMMETRIC = 1.6e-5


@dataclass(frozen=True)
class FitTest:
    """The result of the test."""

    p: float | None  # p-value over all statistics; None where nothing can be tested
    players: np.ndarray  # (N,) p-values of each player's own; empty where nothing can be tested
    reason: str  # what fits least, on one line, or why nothing can be tested

    @property
    def verdict(self) -> str:
        """``fits``, ``does not fit`` or ``not testable``."""
        if self.p is None:
            return "not testable"
        return "does not fit" if self.p < FIT_LEVEL else "fits"

    def __str__(self) -> str:
        """One line."""
        if self.p is None:
            return f"{self.verdict}: {self.reason}"
        shown = f"p < {FIT_LEVEL / 100:g}" if self.p < FIT_LEVEL / 100 else f"p = {self.p:.2g}"
        why = f": {self.reason}" if self.p < FIT_LEVEL else ""
        return f"the model {self.verdict} ({shown}){why}"


def not_testable(reason: str) -> FitTest:
    """No result."""
    return FitTest(None, np.empty(0), reason)


@dataclass(frozen=True)
class Layout:
    """Which residuals of a recording belong together."""

    seen: np.ndarray  # (T, N, d) which samples there are

    def statistics(self, residuals: np.ndarray, deviations: np.ndarray) -> np.ndarray:
        """(B, 3, 1 + N) of all and of each player, of residuals (B, n) with deviations (n,)."""
        full = np.zeros((len(residuals), *self.seen.shape))
        full[:, self.seen] = residuals
        scaled = np.zeros_like(full)
        scaled[:, self.seen] = residuals / deviations
        parts = (
            np.einsum("btnd,btnd->bn", full, full),
            np.einsum("btnd,btnd->bn", scaled, scaled),
            np.einsum("btnd,btnd->bn", scaled[:, 1:], scaled[:, :-1]),
            np.einsum("btnd->bn", scaled**4),
        )
        own = np.stack(parts, axis=1)
        whole = np.concatenate([own.sum(axis=2, keepdims=True), own], axis=2)
        size, squares, products, fourth = np.moveaxis(whole, 1, 0)
        squares = np.maximum(squares, np.finfo(float).tiny)
        tails = np.log(np.maximum(fourth / squares**2, np.finfo(float).tiny))  # less skewed
        return np.stack([size, products / squares, tails], axis=1)


@dataclass(frozen=True)
class Expected:
    """Distributions of the statistics where model and noise are as told.

    Attributes:
        layout: of the residuals.
        deviations: (n,) standard deviations of the residuals.
        mean, deviation, skew: (3, 1 + N) moments of the statistics.
        free: n less what was fitted, over all and of each player (1 + N,).
        independent: how many of all statistics, and of each player's, are as good as independent
            (1 + N,).
    """

    layout: Layout
    deviations: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    skew: np.ndarray
    free: np.ndarray
    independent: np.ndarray

    @classmethod
    def of(cls, seen: np.ndarray, sensitivity: np.ndarray, precision: np.ndarray) -> "Expected":
        """For samples (T, N, d) that are there, J (n, F) over sigma, and P (F,)."""
        layout, n = Layout(seen), len(sensitivity)
        left, sizes, _ = np.linalg.svd(sensitivity / np.sqrt(precision), full_matrices=False)
        cut = 1 - 1 / np.sqrt(sizes**2 + 1)
        draws = np.random.default_rng(0).standard_normal((_DRAWS, n))
        draws -= (draws @ left * cut) @ left.T
        variances = 1 - (left**2) @ (sizes**2 / (sizes**2 + 1))
        deviations = np.sqrt(np.maximum(variances, _LEAST_LEFT))
        found = layout.statistics(draws, deviations)
        moments = found.mean(axis=0), found.std(axis=0), _skewness(found)
        by_player = np.zeros(seen.shape)
        by_player[seen] = variances
        own = by_player.sum(axis=(0, 2))
        free = np.concatenate([[own.sum()], own])
        usual = cls(layout, deviations, *moments, free, np.ones(1 + seen.shape[1]))
        least = usual.smallest(usual.p_values(found))
        independent = np.log1p(-_TAIL) / np.log1p(
            -np.maximum(np.quantile(least, _TAIL, axis=0), 1e-12)
        )
        return cls(layout, deviations, *moments, free, np.maximum(independent, 1.0))

    def p_values(self, statistics: np.ndarray) -> np.ndarray:
        """Two-sided (B, 3, 1 + N), of statistics (B, 3, 1 + N)."""
        usable = self.deviation > 0
        z = (statistics - self.mean) / np.where(usable, self.deviation, 1.0)
        below, above = _tails(z, self.skew)
        return np.where(usable, np.minimum(1.0, 2 * np.minimum(below, above)), 1.0)

    @staticmethod
    def smallest(values: np.ndarray) -> np.ndarray:
        """(B, 1 + N): over all statistics, and over those of each player, of (B, 3, 1 + N)."""
        own = values.min(axis=1)
        return np.concatenate([own.min(axis=1, keepdims=True), own[:, 1:]], axis=1)

    def test(self, residuals: np.ndarray, *, level_known: bool = True) -> FitTest:
        """The test of residuals (T, N, d) over their noise, or over their own if it is unknown."""
        if self.free[0] < _FEWEST:
            return not_testable(
                f"{len(self.deviations)} samples are {self.free[0]:.0f} more than was fitted"
            )
        found = self.layout.statistics(residuals[self.layout.seen][None], self.deviations)
        if not level_known:
            found[:, 0] *= self.free[0] / max(float(found[0, 0, 0]), np.finfo(float).tiny)
        values = self.p_values(found)
        corrected = -np.expm1(self.independent * np.log1p(-self.smallest(values)[0]))
        kind, place = np.unravel_index(values[0].argmin(), values[0].shape)
        reason = self._said(_KINDS[int(kind)], int(place), found[0])
        return FitTest(float(corrected[0]), corrected[1:], reason)

    def _said(self, kind: str, place: int, found: np.ndarray) -> str:
        whose = "residuals" if place == 0 else f"residuals of player {place - 1}"
        if kind == "size":
            ratio = float(np.sqrt(found[0, place] / self.free[place]))
            return f"{whose} are {ratio:.2g} times the noise that is told"
        if kind == "order":
            return f"{whose} follow each other: their correlation is {found[1, place]:.2g}"
        return (
            f"{whose} have {'more' if found[2, place] > self.mean[2, place] else 'fewer'} outliers"
        )


def _skewness(values: np.ndarray) -> np.ndarray:
    """Of the first axis; NaN where all values are equal."""
    off = values - values.mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((off**2 * off).mean(axis=0) / (off**2).mean(axis=0) ** 1.5)


def _tails(z: np.ndarray, skew: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much of Pearson III distributions is below z, and above; ``scipy.stats`` loads slowly."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 2.0 / skew
        shape = scale**2
        x = np.maximum(scale * (z + shape / scale), 0.0)
        tails = gammainc(shape, x), gammaincc(shape, x)
    if_skewed = (np.where(skew > 0, *pair) for pair in (tails, tails[::-1]))
    if_not = ndtr(z), ndtr(-z)
    normal = np.abs(skew) < _SYMMETRIC
    below, above = (np.where(normal, *pair) for pair in zip(if_not, if_skewed, strict=True))
    return below, above


def fit_test(
    problem: Problem, observation: Observation, states: np.ndarray | None, theta: np.ndarray
) -> FitTest:
    """Test an estimate: its motion (T, N, n), None if it has none, and theta (N, K + U)."""
    if states is None:
        return not_testable("the estimate has no motion")
    if problem.sigma <= 0:
        return not_testable("no noise is told")
    problem, (seen,) = with_white_noise(problem, observation)
    known = game_of_motion(problem.game, states, theta)
    if known is None:
        return not_testable("the motion is no equilibrium at the weights")
    place = peak_near(problem, seen, known)
    if place is None:
        return not_testable("the equilibrium is not a function of the weights")
    expected = expected_at(place, np.isfinite(seen.y))
    return expected.test(residuals_at(place, seen.y), level_known=not problem.sigma_spread)


def peak_near(problem: Problem, seen: Observation, game: SolvedGame) -> Places | None:
    """The peak of the posterior near a game; None at a fold of equilibria. The noise is white."""
    density = density_near(problem, seen, game.initial_state)
    place = density.place(game)
    if not place.possible[0]:
        return None
    try:
        return climbed(density, place)
    except np.linalg.LinAlgError:
        return None


def residuals_at(place: Places, y: np.ndarray) -> np.ndarray:
    """(T, N, d) errors over their noise at a place; NaN where a sample is missing."""
    there, residuals = np.isfinite(y), np.full(y.shape, np.nan)
    residuals[there] = -place.errors[0, : int(there.sum())]
    return residuals


def expected_at(place: Places, seen: np.ndarray) -> Expected:
    """What the test expects of samples (T, N, d) that are there, near a place."""
    count = int(seen.sum())
    samples, prior = place.rows[0][:count], place.rows[0][count:]
    return Expected.of(seen, samples, np.maximum((prior**2).sum(axis=0), _FLAT))
