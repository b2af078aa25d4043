"""Bilevel maximum likelihood: weights and initial states outside, the forward game inside.

    min_{theta, x_1}  sum_t |y_t - h(x_t(theta, x_1))|^2            (eqn. inverse_problem)

where x(theta, x_1) is the equilibrium, a root of G(z; theta, x_1) = 0 (eqn.
forward_kkt_conditions). By the implicit function theorem the Jacobian is exact, one sweep of the
factorisation of G_z (``games.compiled.elimination``, E7):

    dz/d(theta, x_1) = -G_z^-1 G_(theta, x_1),

Gauss-Newton steps in a trust region come from ``scipy.optimize.least_squares``; a step to a point
without an equilibrium is rejected like one that does not decrease the error. All iterates are
equilibria, which those of ``kkt_constrained`` are not; the optimum is the same.

With ``prior``, unknowns of the game pay sigma^2 times their squared standardised values, so the
optimum is the most probable point. Games with many unknowns that the motion hardly shows, such as
the parameters of a network, need it.

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

from olne_bench.checks import check_count
from olne_bench.estimators.protocol import LIKELIHOOD, Estimate, Observation, Problem
from olne_bench.estimators.shared.certainty import likelihood_certainty
from olne_bench.estimators.shared.charts import RatioChart
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    first_games,
    game_of_batch,
    play_batch,
    squared_error_of,
    theta_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.shared.noise_level import telling_noise, with_found_noise
from olne_bench.estimators.shared.outer_fit import NO_TIME, OuterResiduals, StoppedError
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.solve.information import deviations_of, of_weights

#: Objectives within this relative difference count as one optimum; two starts that agree suffice.
_SAME_OPTIMUM = 1e-5

_TOO_LONG = "evaluation limit reached"

#: How often a search that ran out of evaluations goes on, as it does where the optimum is flat.
_MOST_CONTINUATIONS = 10

#: How often the reference weights of the chart may change.
_MOST_CHARTS = 4


@dataclass(frozen=True)
class Bilevel:
    """Gauss-Newton on weights and initial states through the forward game.

    Raises ValueError on a parameter out of range.

    Attributes:
        starts: largest number of games to start from, the nearest to the observations.
        max_evaluations: forward games per start and trajectory, before the next start is tried.
        prior: whether the priors of the game's unknowns count.
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
        asked, problem = problem, with_found_noise(problem, observations, deadline)
        starts = [first_games(problem, one) for one in observations]
        if lost := [index for index, found in enumerate(starts) if not found]:
            message = f"no equilibrium found near observation {lost[0]}"
            return Estimate(weights=uniform_weights(problem), converged=False, message=message)
        best, results = self._search(problem, observations, starts, deadline)
        message = best.message
        if not message and results[-1].message == NO_TIME:
            message = f"{NO_TIME} in start {len(results)}; the optimum is that of the starts before"
        solver = elimination(problem.game)
        known = likelihood_certainty(problem, observations, best.games, solver, prior=self.prior)
        found = Estimate(
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
        return telling_noise(found, asked, problem)

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
            if results[-1].message == NO_TIME or _agree(results):
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
    """A game of each trajectory, all with the theta of the first one's game.

    Where a game of some trajectory cannot be followed to it, from ``firsts`` or from ``others``,
    the mean and then the means of the priors are tried; ``firsts`` if nothing is found.
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
