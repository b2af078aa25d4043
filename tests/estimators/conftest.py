"""Observations of small games, and known densities, for the tests of estimators."""

from collections.abc import Callable

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.posterior_density import Places
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

Seen = Callable[..., tuple[Problem, list[Observation], np.ndarray]]


def _short(game: Game) -> Game:
    return Game(game.players, game.dynamics, horizon=12, dt=2 * game.dt)


@pytest.fixture(scope="session")
def seen() -> Seen:
    """``seen(seed, sigma, view, count)``: a short random crossing with known weights.

    Returns the problem, observations from ``count`` initial states, and the true weights.
    """

    def make(
        seed: int = 1, sigma: float = 0.0, view: str = "full", count: int = 1, players: int = 2
    ) -> tuple[Problem, list[Observation], np.ndarray]:
        scenario = get_scenario("random", seed, num_players=players)
        game, rng = _short(scenario.game), np.random.default_rng(seed)
        observations = []
        for k in range(count):
            start = scenario.initial_state + 0.05 * k * rng.standard_normal((players, 4))
            truth = solve_olne(game, scenario.weights, start)
            assert truth.certificate.passed
            noisy = truth.states + sigma * rng.standard_normal(truth.states.shape)
            observations.append(Observation(observe(VIEWS[view], game.dynamics, noisy)))
        return Problem(game, VIEWS[view], sigma), observations, scenario.weights

    return make


Errors = Callable[[np.ndarray], np.ndarray]


class Known:
    """Errors (B, O) of points (B, d), with derivatives by differences; NaN where impossible."""

    def __init__(self, errors: Errors) -> None:
        self._errors = errors

    def place(self, point) -> Places:
        return self._places(np.array([point], dtype=float))

    def reach(self, points: np.ndarray, near: Places) -> Places:
        assert near.possible.all()
        assert len(near) == len(points)
        return self._places(points)

    def _places(self, points: np.ndarray) -> Places:
        errors, rows = self._errors(points), []
        for unit in 1e-6 * np.eye(points.shape[1]):
            rows.append((self._errors(points + unit) - self._errors(points - unit)) / 2e-6)
        derivative = np.stack(rows, axis=2)
        possible = np.isfinite(errors).all(axis=1) & np.isfinite(derivative).all(axis=(1, 2))
        errors[~possible], derivative[~possible] = 0.0, 0.0
        nothing, rows = np.zeros((len(points), 0)), np.empty(len(points), dtype=object)
        rows[:] = list(derivative)
        return Places(points, errors, rows, possible, nothing, np.zeros(len(points)))


class Densities:
    """Densities with known moments for the tests of samplers."""

    of = Known
    gaussian_root = np.array([[0.3, 0.0, 0.0], [0.5, 0.1, 0.0], [0.2, 0.0, 1.0]])
    gaussian_mean = np.array([1.0, -2.0, 0.5])
    ring_quarters = (0.115, 0.385, 0.385, 0.115)  # of the angle, by quadrature

    @classmethod
    def gaussian(cls) -> Known:
        """Three correlated dimensions of very different scale."""
        return Known(
            lambda points: (points - cls.gaussian_mean) @ np.linalg.inv(cls.gaussian_root).T
        )

    @classmethod
    def bent(cls) -> Known:
        """x_0 is standard normal, x_1 is normal around x_0^2 / 2 with deviation 0.5."""
        return Known(
            lambda points: np.stack(
                [points[:, 0], (points[:, 1] - points[:, 0] ** 2 / 2) / 0.5, np.zeros(len(points))],
                axis=1,
            )
        )

    @classmethod
    def valley(cls) -> Known:
        """x_0 to x_5 are standard normal, x_6 is within 1e-4 of half the sum of their squares."""

        def errors(points: np.ndarray) -> np.ndarray:
            floor = np.sum(points[:, :6] ** 2, axis=1) / 2
            return np.column_stack([points[:, :6], 1e4 * (points[:, 6] - floor)])

        return Known(errors)

    @classmethod
    def two_peaks(cls) -> Known:
        """Two Gaussians at x_0 = 4 and -4; the second is three times as wide in x_0."""

        def errors(points: np.ndarray) -> np.ndarray:
            slope = np.where(points[:, 0] > 0, 3.0, 1.0)
            return np.stack([slope * (np.abs(points[:, 0]) - 4.0), points[:, 1]], axis=1)

        return Known(errors)

    @classmethod
    def ring(cls) -> Known:
        """The radius is near 2; the prior is N(2, 2^2) of x_0 and N(0, 3^2) of x_1."""
        return Known(
            lambda points: np.column_stack(
                [
                    (np.linalg.norm(points, axis=1) - 2.0) / 0.1,
                    (points[:, 0] - 2.0) / 2.0,
                    points[:, 1] / 3.0,
                ]
            )
        )

    @classmethod
    def folded(cls) -> Known:
        """One dimension whose first error is largest at 1; the other is a prior N(0, 5^2)."""
        return Known(lambda points: np.hstack([points - points**2 / 2, points / 5.0]))

    @classmethod
    def cut(cls) -> Known:
        """A standard normal density of two dimensions where x_0 is above -1."""
        return Known(lambda points: np.where(points[:, :1] > -1, points, np.nan))


@pytest.fixture(scope="session")
def densities() -> type[Densities]:
    """Densities with known moments."""
    return Densities
