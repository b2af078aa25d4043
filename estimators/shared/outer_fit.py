"""Fits in weights, unknowns and initial states through the forward game, by Gauss-Newton steps.

``bilevel`` fits all of these. The profile likelihood is the least squared error with some weights
held. Twice the difference of log-likelihoods, there and at the maximum, has a chi-squared
distribution where the held weights are true (Wilks 1938), also near the simplex's boundary.
"""

import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import Chart, RatioChart
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    game_of_batch,
    play_batch,
    sample_sensitivity,
    scaled_samples,
    theta_of,
)
from olne_bench.games.compiled.elimination import elimination

#: Relative change of error and unknowns at which a search ends; that of a profile knows its error
#: to 1e-4 noise levels squared, and comes to an end where the finer one runs out of evaluations.
_TOLERANCE, _PROFILE_TOLERANCE = 1e-9, 1e-7

NO_TIME = "time limit reached"

#: Evaluations of a fit with weights held.
_MOST_EVALUATIONS = 60


class StoppedError(Exception):
    """The search cannot continue; the games are those of the last accepted point."""


class OuterResiduals:
    """Errors as a function of ratios of weights, standardised parameters and all x_1.

    The last errors are those of the parameters, times ``pull``, unless it is zero. ``games`` are at
    the point of the last Jacobian, from which others are followed; ``blocked`` says whether some
    point tried since then has no equilibrium.
    """

    def __init__(
        self,
        problem: Problem,
        observations: tuple[Observation, ...],
        games: tuple[SolvedGame, ...],
        chart: Chart,
        deadline: float = np.inf,
        pull: float = 0.0,
    ) -> None:
        self.games, self.blocked = games, False
        self._played: tuple[np.ndarray, tuple[SolvedGame, ...] | None] | None = None
        self._deadline, self._pull = deadline, pull
        self._problem, self._chart = problem, chart
        self._samples = [scaled_samples(problem, one.y) for one in observations]
        self._seen = [np.isfinite(samples).ravel() for samples in self._samples]
        self._starts = (len(games), *problem.game.state_shape[1:])
        self._used = problem.game.parameters.used
        self._shared = chart.size + int(self._used.sum())

    def unknowns(self, games: tuple[SolvedGame, ...]) -> np.ndarray:
        """The unknowns at which these are the games."""
        initial_states = [game.initial_state.ravel() for game in games]
        first = games[0]
        parameters = [] if first.parameters is None else [first.parameters[self._used]]
        return np.concatenate([self._chart.ratios(first.weights), *parameters, *initial_states])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the unknowns."""
        size = self._shared + int(np.prod(self._starts))
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        lower[: self._chart.size] = 0.0
        low, high = self._problem.game.parameters.bounds()
        lower[self._chart.size : self._shared] = low[self._used]
        upper[self._chart.size : self._shared] = high[self._used]
        return lower, upper

    def minimised(self, max_evaluations: int, tolerance: float = _TOLERANCE) -> OptimizeResult:
        """Gauss-Newton from the games, with a trust region.

        Raises StoppedError as ``values`` and ``jacobian``; ValueError without equilibrium at the
        start.
        """
        lower, upper = self.bounds()
        return least_squares(
            self.values,
            np.clip(self.unknowns(self.games), lower, upper),
            jac=self.jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            max_nfev=max_evaluations,
        )

    def values(self, unknowns: np.ndarray) -> np.ndarray:
        """Errors of all samples seen, infinite without equilibrium; StoppedError if it is late."""
        if time.monotonic() > self._deadline:
            raise StoppedError(NO_TIME)
        games = self._play(unknowns)
        self.blocked |= games is None
        errors = []
        for k, (samples, seen) in enumerate(zip(self._samples, self._seen, strict=True)):
            if games is None:
                errors.append(np.full(int(seen.sum()), np.inf))
            else:
                expected = expected_samples(self._problem, games[k].root.states)
                errors.append((expected - samples).ravel()[seen])
        if self._pull:
            errors.append(self._pull * unknowns[self._chart.size : self._shared])
        return np.concatenate(errors)

    def jacobian(self, unknowns: np.ndarray) -> np.ndarray:
        """Derivative of ``values``, exact; later games start here; StoppedError at a fold."""
        games = self._play(unknowns)
        try:
            if games is None:
                raise ValueError("no equilibrium here")
            solver = elimination(self._problem.game)
            sensitivities = [sample_sensitivity(self._problem, game, solver) for game in games]
        except ValueError as error:
            raise StoppedError(str(error)) from error
        self.games, self.blocked = games, False
        theta_by_shared = self._theta_by_shared(unknowns)
        _, players, size = self._starts
        rows = []
        for k, (sensitivity, seen) in enumerate(zip(sensitivities, self._seen, strict=True)):
            by_theta, by_start = np.split(sensitivity[seen], [len(theta_by_shared)], axis=1)
            row = np.zeros((len(by_theta), unknowns.size))
            row[:, : self._shared] = by_theta @ theta_by_shared
            first = self._shared + k * players * size
            row[:, first : first + players * size] = by_start
            rows.append(row)
        if self._pull:
            own = np.arange(self._chart.size, self._shared)
            rows.append(self._pull * np.eye(unknowns.size)[own])
        return np.vstack(rows)

    def _theta_by_shared(self, unknowns: np.ndarray) -> np.ndarray:
        """(N*(K+U), shared): derivative of theta in ratios and parameters."""
        own = self._chart.jacobian(unknowns[: self._chart.size])
        if not self._used.size:
            return own
        players, count = self._used.shape
        rows = np.arange(len(own)).reshape(players, -1)
        width = rows.shape[1] + count
        found = np.zeros((players * width, self._shared))
        at = np.arange(players * width).reshape(players, -1)
        found[at[:, : rows.shape[1]].ravel(), : self._chart.size] = own
        found[at[:, rows.shape[1] :][self._used], np.arange(self._chart.size, self._shared)] = 1.0
        return found

    def _theta(self, unknowns: np.ndarray) -> np.ndarray:
        parameters = np.zeros(self._used.shape)
        parameters[self._used] = unknowns[self._chart.size : self._shared]
        return theta_of(self._chart.weights(unknowns[: self._chart.size]), parameters)

    def _play(self, unknowns: np.ndarray) -> tuple[SolvedGame, ...] | None:
        """The games at a point; they are kept, as a Jacobian follows the errors there."""
        if self._played is None or not np.array_equal(self._played[0], unknowns):
            self._played = unknowns.copy(), self._play_anew(unknowns)
        return self._played[1]

    def _play_anew(self, unknowns: np.ndarray) -> tuple[SolvedGame, ...] | None:
        theta = self._theta(unknowns)
        initial_states = unknowns[self._shared :].reshape(self._starts)
        games = []
        for game, initial_state in zip(self.games, initial_states, strict=True):
            batch = play_batch(self._problem, game, theta[None], initial_state)
            if not batch.converged[0]:
                return None
            games.append(game_of_batch(self._problem, batch, 0, theta))
        return tuple(games)


@dataclass(frozen=True)
class HeldWeights:
    """A chart without coordinates: all weights are held."""

    held: np.ndarray  # (N, K)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return 0

    def ratios(self, weights: np.ndarray) -> np.ndarray:
        """No coordinates."""
        return np.zeros(0)

    def weights(self, ratios: np.ndarray) -> np.ndarray:
        """The held weights."""
        return self.held

    def jacobian(self, ratios: np.ndarray) -> np.ndarray:
        """(N*K, 0)."""
        return np.zeros((self.held.size, 0))


def least_error(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    *,
    held: bool = True,
) -> float | None:
    """The least sum of squared errors over their noise scales; None if the search fails.

    It starts at a game of each trajectory, all at the same weights, which may be held; the noise is
    white.
    """
    weights = games[0].weights
    chart = HeldWeights(weights) if held else RatioChart(weights, problem.weight_floor)
    found = least_error_in(problem, observations, games, chart)
    return None if found is None else found[0]


def least_error_in(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    chart: Chart,
    deadline: float = np.inf,
) -> tuple[float, tuple[SolvedGame, ...]] | None:
    """The least squared error among weights of a chart, and the games there; None if it fails.

    Arguments are those of ``least_error``; it ends by the deadline, in s of ``time.monotonic``.
    """
    residuals = OuterResiduals(problem, observations, games, chart, deadline)
    try:
        solution = residuals.minimised(_MOST_EVALUATIONS, _PROFILE_TOLERANCE)
    except (StoppedError, ValueError):  # no equilibrium at the start
        return None
    return (2 * float(solution.cost), residuals.games) if solution.success else None
