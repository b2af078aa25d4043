"""Bilevel maximum likelihood: weights and initial states outside, the forward game inside.

    min_{theta, x_1}  sum_t |y_t - h(x_t(theta, x_1))|^2            (eqn. inverse_problem)

where x(theta, x_1) is the equilibrium, a root of G(z; theta, x_1) = 0
(eqn. forward_kkt_conditions). The outer problem is a least-squares problem on the simplex of the
weights. Its Jacobian is exact: by the implicit function theorem

    dz/d(theta, x_1) = -G_z^-1 G_(theta, x_1),

one sweep of the structured factorisation of G_z (``games.elimination``, E7). Gauss-Newton steps in
a trust region come from ``scipy.optimize.least_squares``; a step to a point without an equilibrium
is rejected like one that does not decrease the error. This is the bilevel scheme of single-player
inverse optimal control (Mombaur et al. 2010; Albrecht et al. 2011) with derivatives in place of a
derivative-free search; the paper mentions it for games only in its derivative-free form.

The optimum is that of ``kkt_constrained``. Here all iterates are equilibria; there they are not.

Paper: Mombaur et al. 2010 and Albrecht et al. 2011, for one player and without derivatives.
Assumes: an equilibrium of the known game, and independent Gaussian noise of known relative size.
Cost: 0.06 s for two players, 0.3 s for five, 0.4 s on roads, sometimes ten times as much.
Trust: as `kkt_constrained`, whose optimum it shares. It fails if no game is found near the
    observations, or if the optimum lies next to weights without an equilibrium.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares

from olne_bench.checks import check_count
from olne_bench.estimators.forward_model import (
    SolvedGame,
    expected_samples,
    first_games,
    game_of_batch,
    likelihood_covariance,
    play_batch,
    sample_sensitivity,
    scaled_samples,
    squared_error_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.simplex import RatioChart
from olne_bench.estimators.white_noise import white_problem, with_white_noise
from olne_bench.games.native import elimination

#: Relative change of error and unknowns at which the search ends.
_TOLERANCE = 1e-9

#: Objectives within this relative difference count as one optimum; two starts that agree suffice.
_SAME_OPTIMUM = 1e-5

_TOO_LONG = "evaluation limit reached"

#: How often the reference weights of the chart may change.
_MOST_CHARTS = 4


@dataclass(frozen=True)
class Bilevel:
    """Gauss-Newton on weights and initial states through the forward game.

    Attributes:
        starts: largest number of games to start from, the nearest to the observations.
        max_evaluations: forward games per start and trajectory, before the next start is tried.

    Raises:
        ValueError: on a parameter out of range.
    """

    name: ClassVar[str] = "bilevel"
    several: ClassVar[bool] = True
    starts: int = 4
    max_evaluations: int = 200

    def __post_init__(self) -> None:
        check_count("starts", self.starts)
        check_count("max_evaluations", self.max_evaluations)

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        deadline = time.monotonic() + budget / 2
        starts = [first_games(problem, one) for one in observations]
        lost = [index for index, found in enumerate(starts) if not found]
        if lost:
            message = f"no equilibrium found near observation {lost[0]}"
            return Estimate(weights=uniform_weights(problem), converged=False, message=message)
        results = []
        for start in _combinations(starts, self.starts):
            results.append(_descend(problem, observations, start, self.max_evaluations, deadline))
            if time.monotonic() > deadline or _agree(results):
                break
        best = _best(results)
        while best.message == _TOO_LONG and time.monotonic() < deadline:  # the optimum is flat
            best = _descend(problem, observations, best.games, self.max_evaluations, deadline)
        solver = elimination(problem.game, problem.view)
        return Estimate(
            weights=best.games[0].weights,
            states=best.games[0].root.states,
            covariance=likelihood_covariance(problem, observations, best.games, solver),
            converged=best.converged,
            message=best.message,
            extras={
                "objective": best.objective,
                "starts": len(results),
                "evaluations": sum(result.evaluations for result in results),
            },
        )

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        warm_up_games(problem)


@dataclass(frozen=True)
class _Result:
    games: tuple[SolvedGame, ...]
    objective: float
    converged: bool
    message: str
    evaluations: int


def _best(results: list[_Result]) -> _Result:
    """The lowest error; one that did not converge has to be lower by more than rounding."""
    lowest = min(results, key=lambda result: result.objective)
    limit = lowest.objective * (1 + _SAME_OPTIMUM) + 1e-12
    equal = [result for result in results if result.converged and result.objective <= limit]
    return min(equal, key=lambda result: result.objective, default=lowest)


def _agree(results: list[_Result]) -> bool:
    """Whether the last start found the lowest optimum again."""
    values = [result.objective for result in results if result.converged]
    lowest = min(values, default=0.0) * (1 + _SAME_OPTIMUM) + 1e-12
    return results[-1].converged and sum(value <= lowest for value in values) > 1


def _combinations(starts: list[list[SolvedGame]], most: int) -> list[tuple[SolvedGame, ...]]:
    """Start k of all trajectories together; a trajectory with fewer starts repeats its last."""
    count = min(most, max(len(found) for found in starts))
    return [tuple(found[min(k, len(found) - 1)] for found in starts) for k in range(count)]


def _descend(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    max_evaluations: int,
    deadline: float,
) -> _Result:
    """Gauss-Newton from one start; the chart changes if a reference weight becomes too small."""
    evaluations, message = 0, ""
    for _ in range(_MOST_CHARTS):
        chart = RatioChart(games[0].weights, problem.weight_floor)
        residuals = OuterResiduals(problem, observations, games, chart, deadline)
        first = residuals.unknowns(games)
        lower = np.full(first.size, -np.inf)
        lower[: chart.size] = 0.0
        try:
            solution = least_squares(
                residuals.values,
                np.maximum(first, lower),
                jac=residuals.jacobian,
                bounds=(lower, np.inf),
                x_scale="jac",
                ftol=_TOLERANCE,
                xtol=_TOLERANCE,
                gtol=_TOLERANCE,
                max_nfev=max_evaluations,
            )
            evaluations += int(solution.nfev)
            message = "" if solution.success else _TOO_LONG
            if residuals.blocked:  # a trust region that shrank to nothing is not an optimum
                message = "no equilibrium in the direction of descent"
            residuals.jacobian(solution.x)  # moves the games to the solution
        except _StoppedError as error:
            message = str(error)
        games = residuals.games
        if message or chart.holds(games[0].weights):
            break
    pairs = zip(games, observations, strict=True)
    return _Result(
        games=games,
        objective=sum(squared_error_of(problem, game.root.states, one.y) for game, one in pairs),
        converged=not message,
        message=message,
        evaluations=evaluations,
    )


class _StoppedError(Exception):
    """The search cannot continue; the games are those of the last accepted point."""


class OuterResiduals:
    """Observation errors as a function of the outer unknowns (ratios of weights, all x_1).

    Attributes:
        games: the games at the point of the last Jacobian, from which others are followed.
        blocked: whether some point tried since then has no equilibrium.
    """

    def __init__(
        self,
        problem: Problem,
        observations: tuple[Observation, ...],
        games: tuple[SolvedGame, ...],
        chart: RatioChart,
        deadline: float = np.inf,
    ) -> None:
        self.games, self.blocked = games, False
        self._deadline = deadline
        self._problem, self._chart = problem, chart
        self._samples = [scaled_samples(problem, one.y) for one in observations]
        self._seen = [np.isfinite(samples).ravel() for samples in self._samples]
        self._starts = (len(games), *problem.game.state_shape[1:])

    def unknowns(self, games: tuple[SolvedGame, ...]) -> np.ndarray:
        """The unknowns at which these are the games."""
        initial_states = [game.initial_state.ravel() for game in games]
        return np.concatenate([self._chart.ratios(games[0].weights), *initial_states])

    def values(self, unknowns: np.ndarray) -> np.ndarray:
        """Errors of all samples that were seen; infinite if there is no equilibrium.

        Raises:
            _StoppedError: after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise _StoppedError("time limit reached")
        games = self._play(unknowns)
        self.blocked |= games is None
        errors = []
        for k, (samples, seen) in enumerate(zip(self._samples, self._seen, strict=True)):
            if games is None:
                errors.append(np.full(int(seen.sum()), np.inf))
            else:
                expected = expected_samples(self._problem, games[k].root.states)
                errors.append((expected - samples).ravel()[seen])
        return np.concatenate(errors)

    def jacobian(self, unknowns: np.ndarray) -> np.ndarray:
        """Derivative of ``values``, exact; later games are followed from this point.

        Raises:
            _StoppedError: if the equilibrium is not a function of the unknowns.
        """
        games = self._play(unknowns)
        try:
            if games is None:
                raise ValueError("no equilibrium here")
            solver = elimination(self._problem.game, self._problem.view)
            sensitivities = [sample_sensitivity(self._problem, game, solver) for game in games]
        except ValueError as error:
            raise _StoppedError(str(error)) from error
        self.games, self.blocked = games, False
        weights_by_ratios = self._chart.jacobian(unknowns[: self._chart.size])
        _, players, size = self._starts
        rows = []
        for k, (sensitivity, seen) in enumerate(zip(sensitivities, self._seen, strict=True)):
            by_weights, by_start = np.split(sensitivity[seen], [len(weights_by_ratios)], axis=1)
            row = np.zeros((len(by_weights), unknowns.size))
            row[:, : self._chart.size] = by_weights @ weights_by_ratios
            first = self._chart.size + k * players * size
            row[:, first : first + players * size] = by_start
            rows.append(row)
        return np.vstack(rows)

    def _play(self, unknowns: np.ndarray) -> tuple[SolvedGame, ...] | None:
        weights = self._chart.weights(unknowns[: self._chart.size])
        initial_states = unknowns[self._chart.size :].reshape(self._starts)
        games = []
        for game, initial_state in zip(self.games, initial_states, strict=True):
            batch = play_batch(self._problem, game, weights[None], initial_state)
            if not batch.converged[0]:
                return None
            games.append(game_of_batch(batch, 0, weights))
        return tuple(games)
