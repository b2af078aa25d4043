"""Bilevel maximum likelihood: weights and initial states outside, the forward game inside.

    min_{theta, x_1}  sum_t |y_t - h(x_t(theta, x_1))|^2            (eqn. inverse_problem)

where x(theta, x_1) is the equilibrium, a root of G(z; theta, x_1) = 0
(eqn. forward_kkt_conditions). The outer problem is a least-squares problem on the simplex of the
weights. Its Jacobian is exact: by the implicit function theorem

    dz/d(theta, x_1) = -G_z^-1 G_(theta, x_1),

one sweep of the structured factorisation of G_z (``games.compiled.elimination``, E7). Gauss-Newton
steps in a trust region come from ``scipy.optimize.least_squares``; a step to a point without an
equilibrium is rejected like one that does not decrease the error. This is the bilevel scheme of
single-player inverse optimal control (Mombaur et al. 2010; Albrecht et al. 2011) with derivatives
in place of a derivative-free search; the paper mentions it for games only in its derivative-free
form.

With ``prior``, unknowns of the game pay for their distance to the means of their priors: the sum of
their squared standardised values times sigma^2 is added. The optimum is then the most probable
point (maximum a posteriori). Games with many unknowns that the motion hardly shows, such as the
parameters of a network, need it.

The optimum is that of ``kkt_constrained``, which has no prior. Here all iterates are equilibria;
there they are not.

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
from scipy.optimize import OptimizeResult, least_squares

from olne_bench.checks import check_count
from olne_bench.estimators.protocol import LIKELIHOOD, Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    first_games,
    game_of_batch,
    likelihood_certainty,
    play_batch,
    sample_sensitivity,
    scaled_samples,
    squared_error_of,
    theta_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.shared.simplex import Chart, RatioChart
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.solve.information import deviations_of, of_weights

#: Relative change of error and unknowns at which the search ends.
_TOLERANCE = 1e-9

#: Objectives within this relative difference count as one optimum; two starts that agree suffice.
_SAME_OPTIMUM = 1e-5

_TOO_LONG = "evaluation limit reached"
_NO_TIME = "time limit reached"

#: How often a search that ran out of evaluations goes on, as it does where the optimum is flat.
_MOST_CONTINUATIONS = 10

#: How often the reference weights of the chart may change.
_MOST_CHARTS = 4


@dataclass(frozen=True)
class Bilevel:
    """Gauss-Newton on weights and initial states through the forward game.

    Attributes:
        starts: largest number of games to start from, the nearest to the observations.
        max_evaluations: forward games per start and trajectory, before the next start is tried.
        prior: whether the priors of the game's unknowns count.

    Raises:
        ValueError: on a parameter out of range.
    """

    name: ClassVar[str] = "bilevel"
    several: ClassVar[bool] = True
    starts: int = 4
    max_evaluations: int = 200
    prior: bool = False

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
        deadline = time.monotonic() + budget
        starts = [first_games(problem, one) for one in observations]
        if lost := [index for index, found in enumerate(starts) if not found]:
            message = f"no equilibrium found near observation {lost[0]}"
            return Estimate(weights=uniform_weights(problem), converged=False, message=message)
        best, results = self._search(problem, observations, starts, deadline)
        message = best.message
        if not message and results[-1].message == _NO_TIME:
            message = (
                f"{_NO_TIME} in start {len(results)}; the optimum is that of the starts before"
            )
        solver = elimination(problem.game)
        known = likelihood_certainty(problem, observations, best.games, solver, prior=self.prior)
        return Estimate(
            weights=best.games[0].weights,
            states=best.games[0].root.states,
            covariance=of_weights(problem.game, known.covariance),
            region=LIKELIHOOD,
            parameters=_parameters(problem, best.games[0]),
            parameter_deviations=deviations_of(problem.game, known.covariance),
            converged=best.converged,
            message=known.message(message),
            extras={
                "objective": best.objective,
                "starts": len(results),
                "evaluations": sum(result.evaluations for result in results),
            },
        )

    def _search(
        self,
        problem: Problem,
        observations: tuple[Observation, ...],
        starts: list[list[SolvedGame]],
        deadline: float,
    ) -> tuple["_Result", list["_Result"]]:
        """The best result, and those of all starts."""
        limits = self.max_evaluations, deadline, problem.sigma if self.prior else 0.0
        results = []
        for firsts in _combinations(starts, self.starts):
            games = _at_one_theta(problem, firsts, starts)
            results.append(_descend(problem, observations, games, *limits))
            if results[-1].message == _NO_TIME or _agree(results):
                break
        best = _best(results)
        for _ in range(_MOST_CONTINUATIONS):
            if best.message != _TOO_LONG:
                break
            best = _descend(problem, observations, best.games, *limits)
        return best, results

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        warm_up_games(problem)


def _parameters(problem: Problem, game: SolvedGame) -> np.ndarray | None:
    """(N, U) in their units, or None."""
    known = problem.game.parameters
    return None if game.parameters is None else known.values(game.parameters)


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


def _at_one_theta(
    problem: Problem, firsts: tuple[SolvedGame, ...], others: list[list[SolvedGame]]
) -> tuple[SolvedGame, ...]:
    """A game of each trajectory, all with one theta.

    It is that of the first trajectory's game. Where no game of some trajectory can be followed to
    it, the mean and then the means of the priors are tried.

    Args:
        problem: gives the game.
        firsts: preferred game of each trajectory; returned if nothing else is found.
        others: all games of each.
    """
    if len(firsts) == 1:
        return firsts
    parameters = firsts[0].parameters
    means = None if parameters is None else np.zeros_like(parameters)
    own = [game.theta for game in firsts]
    for theta in (own[0], np.mean(own, axis=0), theta_of(uniform_weights(problem), means)):
        games = []
        for first, more in zip(firsts, others, strict=True):
            game = _first_at(problem, [first, *more], theta)
            if game is None:
                break
            games.append(game)
        else:
            return tuple(games)
    return firsts


def _first_at(problem: Problem, games: list[SolvedGame], theta: np.ndarray) -> SolvedGame | None:
    """The first of some games that can be followed to a theta (N, K + U), at that theta."""
    for game in games:
        batch = play_batch(problem, game, theta[None], game.initial_state[None])
        if batch.converged[0]:
            return game_of_batch(problem, batch, 0, theta)
    return None


def _descend(
    problem: Problem,
    observations: tuple[Observation, ...],
    games: tuple[SolvedGame, ...],
    max_evaluations: int,
    deadline: float,
    pull: float = 0.0,
) -> _Result:
    """Gauss-Newton from one start; the chart changes if a reference weight becomes too small."""
    evaluations, message = 0, ""
    for _ in range(_MOST_CHARTS):
        chart = RatioChart(games[0].weights, problem.weight_floor)
        residuals = OuterResiduals(problem, observations, games, chart, deadline, pull)
        try:
            solution = residuals.minimised(max_evaluations)
            evaluations += int(solution.nfev)
            message = "" if solution.success else _TOO_LONG
            if residuals.blocked:  # a trust region that shrank to nothing is not an optimum
                message = "no equilibrium in the direction of descent"
            residuals.jacobian(solution.x)  # moves the games to the solution
        except StoppedError as error:
            message = str(error)
        games = residuals.games
        if message or chart.holds(games[0].weights):
            break
    pairs = zip(games, observations, strict=True)
    squared = sum(squared_error_of(problem, game.root.states, one.y) for game, one in pairs)
    parameters = games[0].parameters
    penalty = 0.0 if parameters is None else float(np.sum((pull * parameters) ** 2))
    return _Result(
        games=games,
        objective=squared + penalty,
        converged=not message,
        message=message,
        evaluations=evaluations,
    )


class StoppedError(Exception):
    """The search cannot continue; the games are those of the last accepted point."""


class OuterResiduals:
    """Observation errors as a function of the outer unknowns.

    These are the ratios of weights, the standardised parameters, and all x_1. The last errors are
    those of the standardised parameters, times ``pull``, unless it is zero.

    Attributes:
        games: the games at the point of the last Jacobian, from which others are followed.
        blocked: whether some point tried since then has no equilibrium.
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

    def minimised(self, max_evaluations: int) -> OptimizeResult:
        """Gauss-Newton from the games, with a trust region.

        Raises:
            StoppedError: as ``values`` and ``jacobian`` do.
            ValueError: if there is no equilibrium at the start.
        """
        lower, upper = self.bounds()
        return least_squares(
            self.values,
            np.clip(self.unknowns(self.games), lower, upper),
            jac=self.jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
            max_nfev=max_evaluations,
        )

    def values(self, unknowns: np.ndarray) -> np.ndarray:
        """Errors of all samples that were seen, infinite if there is no equilibrium.

        Raises:
            StoppedError: after the deadline.
        """
        if time.monotonic() > self._deadline:
            raise StoppedError(_NO_TIME)
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
        """Derivative of ``values``, exact; later games are followed from this point.

        Raises:
            StoppedError: if the equilibrium is not a function of the unknowns.
        """
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
        theta = self._theta(unknowns)
        initial_states = unknowns[self._shared :].reshape(self._starts)
        games = []
        for game, initial_state in zip(self.games, initial_states, strict=True):
            batch = play_batch(self._problem, game, theta[None], initial_state)
            if not batch.converged[0]:
                return None
            games.append(game_of_batch(self._problem, batch, 0, theta))
        return tuple(games)
