"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

Residuals count in units of their noise scale. States (x_1 included), controls, costates and weights
are unknown, and several trajectories share one theta. The problem is not convex (the five-player
highway has optima with similar objectives but very different weights), so it is solved from several
starts (``joint_starts``) and the lowest objective wins.

Hard constraints are equations of G, their complementarity relaxed to 1e-9
(``games.compiled.complementarity``). The covariance of the weights is the inverse Fisher
information at the estimate (``games.solve.information``).

IPOPT, the reference, starts at the observations, at the pre-solve (eqn. pre_solve), which is the
paper's own start, and at the solution of the tied problem. It is also used if no start of the
structured solver converges: that inverts G_z, which is singular at folds of the game's roots.

Paper: Peters, Fridovich-Keil, Rubies-Royo, Tomlin, Stachniss, RSS 2021.
Assumes: an equilibrium of the known game, and independent Gaussian noise of known relative size.
Cost: 3 ms for two players, 16 ms for five, 60 ms on roads; through IPOPT some twenty times as much.
Trust: near the statistical limit while the noise is small, in partial views too. At high noise the
    global optimum itself may be far from the truth.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_count
from olne_bench.estimators.protocol import LIKELIHOOD, POSTERIOR, Estimate, Observation, Problem
from olne_bench.estimators.shared.certainty import Certainty, likelihood_certainty
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.incoming_samples import Samples, Stream, WindowStream
from olne_bench.estimators.shared.interior_point import joint_elimination
from olne_bench.estimators.shared.joint_ipopt import joint_solver, solve_joint_ipopt
from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    SeenMotion,
    inside,
    weights_of,
)
from olne_bench.estimators.shared.joint_starts import (
    Search,
    joint_attempts,
    lowest,
    shared_attempts,
    unexplained,
)
from olne_bench.estimators.shared.joint_stream import JointStream
from olne_bench.estimators.shared.noise_level import telling_noise, with_found_noise
from olne_bench.estimators.shared.pooled import (
    Recorded,
    Together,
    checked,
    games_of,
    seen_motions,
    shared_covariance,
)
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory, guess_states, warm_up_fit
from olne_bench.estimators.shared.white_noise import white_problem, with_white_noise
from olne_bench.games.compiled.elimination import Elimination
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.unknowns import refuse_unknowns
from olne_bench.games.solve.information import deviations_of, of_weights

_SOLVERS = ("structured", "ipopt")

#: Tolerance of the structured solver from this noise on, and without noise.
_TOLERANCE, _USUAL_SIGMA, _TIGHT = 1e-9, 1e-3, 1e-12

#: Strength of IPOPT's tie to uniform weights, relative to a solution's squared error.
_TIE = 3.0


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Raises ValueError on an unknown solver, or iterations out of range.

    Attributes:
        solver: ``structured``, the interior-point method of this project, or ``ipopt``, the
            reference, which takes some twenty times as long.
        max_iterations: iterations per start. A solve takes 5 to 40; if it needs hundreds, another
            start is a better use of the time.
    """

    name: ClassVar[str] = "kkt_constrained"
    several: ClassVar[bool] = True
    solver: str = "structured"
    max_iterations: int = 300

    def __post_init__(self) -> None:
        if self.solver not in _SOLVERS:
            raise ValueError(f"unknown solver {self.solver!r}; known are: {', '.join(_SOLVERS)}")
        check_count("max_iterations", self.max_iterations)

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        self.warm_up(problem)  # where nobody has: compiling may take longer than a small budget
        deadline = time.monotonic() + budget
        asked, problem = problem, with_found_noise(problem, observations, deadline)
        if len(observations) > 1:
            attempts = self._several(problem, observations, deadline)
        else:
            attempts = self._attempts(problem, observations[0].y, deadline)
        late = time.monotonic() > deadline
        found = self._described(problem, observations, lowest(attempts), len(attempts), late)
        return telling_noise(found, asked, problem)

    def start(
        self, problem: Problem, *, rng: np.random.Generator, lag: int | None = None
    ) -> Stream:
        """A stream whose solves begin at the solution of the one before (``joint_stream``)."""
        samples = Samples(problem, lag)
        if self._uses_ipopt or problem.sigma_spread:
            return WindowStream(self, samples, rng)

        def described(
            problem: Problem, y: np.ndarray, best: JointSolution, starts: int, late: bool
        ) -> Estimate:
            return self._described(problem, (Observation(y),), best, starts, late)

        return JointStream(samples, self._structured_settings, self._attempts, described)

    def _described(
        self,
        problem: Problem,
        observations: Sequence[Observation],
        best: JointSolution,
        starts: int,
        late: bool,
    ) -> Estimate:
        """The estimate of a solution; ``late`` says that the search ended with its time."""
        points = best.points
        converged, message = _verdict(problem, _motions(problem, observations), best)
        if late and converged and not message:
            message = f"time limit reached in start {starts}; the optimum is that of starts so far"
        games, known = games_of(best), Certainty(None)
        if converged:
            solver = None
            if not self._uses_ipopt:
                solver = joint_elimination(problem.game, problem.view)
            known = self._certainty(problem, observations, games, solver)
        game, standardised = problem.game, points[0].parameters
        region = self._region(problem)
        return Estimate(
            weights=points[0].weights,
            states=points[0].states,
            covariance=of_weights(game, known.covariance),
            region=None if len(points) > 1 and region == POSTERIOR else region,
            parameters=None if standardised is None else game.parameters.values(standardised),
            parameter_deviations=deviations_of(game, known.covariance),
            converged=converged,
            message=known.message(message),
            extras={"objective": best.objective, "starts": starts},
        )

    def _region(self, problem: Problem) -> str | None:
        """The region that an estimate claims."""
        return LIKELIHOOD

    def _attempts(self, problem: Problem, y: np.ndarray, deadline: float) -> list[JointSolution]:
        if self._uses_ipopt:
            return in_time(self._ipopt_attempts(problem, y), deadline)
        structured = joint_attempts(problem, y, self._structured_settings(problem), deadline)
        attempts = in_time(structured, deadline)
        lost = not any(attempt.converged for attempt in attempts)
        only_weights = not (problem.game.constraints or problem.game.parameters.count)
        if lost and only_weights and time.monotonic() < deadline:
            attempts += in_time(self._ipopt_attempts(problem, y), deadline)
        return attempts

    def _several(
        self, problem: Problem, observations: Sequence[Observation], deadline: float
    ) -> list[JointSolution]:
        """One theta for all trajectories."""
        if not self._uses_ipopt:
            motions = _motions(problem, observations)
            return self._together([problem] * len(motions), motions, deadline)
        refuse_constraints(problem.game.constraints, "IPOPT of several trajectories")
        refuse_unknowns(problem.game.parameters, "IPOPT of several trajectories")
        ys = [one.y for one in observations]
        own = [lowest(self._attempts(problem, y, deadline)).point for y in ys]
        guesses = [
            JointPoint.from_trajectory(problem.game, guess_states(problem.game, problem.view, y))
            for y in ys
        ]
        return [
            solve_joint_ipopt(problem.game, problem.view, ys, starts, self._settings(problem))
            for starts in (own, guesses)
        ]

    def together(
        self, motions: Sequence[Recorded], *, rng: np.random.Generator, budget: float
    ) -> Together:
        """Explain several motions of unlike cars by common weights of their drivers.

        The search ends after ``budget`` seconds; ``rng`` is not used. Raises ValueError on motions
        that do not fit each other.
        """
        motions = checked(motions)
        attempts = self.attempts_together(motions, time.monotonic() + budget)
        return self.described_together(motions, lowest(attempts))

    def attempts_together(
        self, motions: Sequence[Recorded], deadline: float
    ) -> list[JointSolution]:
        """Attempts on checked motions; ``deadline`` in seconds of ``time.monotonic``."""
        problems = [one.problem for one in motions]
        return self._together(problems, seen_motions(motions), deadline)

    def described_together(self, motions: Sequence[Recorded], best: JointSolution) -> Together:
        """What a solution of checked motions says."""
        seen, problems = seen_motions(motions), [one.problem for one in motions]
        games, weights = games_of(best), weights_of(seen, best.points)
        converged, message = _verdict(problems[0], seen, best)
        pairs = zip(seen, best.points, strict=True)
        known = [(one.game.parameters, point.parameters) for one, point in pairs]
        covariance = None
        if converged:
            precision = self._precision(problems[0], weights)
            covariance = shared_covariance(motions, games, precision)
        return Together(
            weights=weights,
            states=tuple(point.states for point in best.points),
            parameters=tuple(None if own is None else all_.values(own) for all_, own in known),
            covariance=covariance,
            converged=converged,
            message=message,
            objective=best.objective,
        )

    def _precision(self, problem: Problem, weights: np.ndarray) -> np.ndarray | None:
        """(D, K) of the prior of the weights; None without."""
        return None

    def _together(
        self, problems: Sequence[Problem], motions: Sequence[SeenMotion], deadline: float
    ) -> list[JointSolution]:
        """Attempts on several motions with common weights; each has a problem of its own."""
        search = Search(problems[0], motions, self._structured_settings(problems[0]), deadline)

        def own(problem: Problem, y: np.ndarray) -> list[JointSolution]:
            return self._attempts(problem, y, deadline)

        return in_time(shared_attempts(problems, search, own), deadline)

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be solved, or None."""
        if problem.game.constraints and self._uses_ipopt:
            return "hard constraints need the structured solver"
        return None

    def supports_several(self, problem: Problem) -> str | None:
        """Why several trajectories of this problem cannot be explained together, or None."""
        for there, what in (
            (problem.game.constraints, "constraints"),
            (problem.game.parameters.count, "unknowns besides weights"),
        ):
            if there and self._uses_ipopt:
                return f"takes one trajectory at a time where a game has {what}"
        return None

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        if not self._uses_ipopt:
            joint_elimination(problem.game, problem.view)
            return
        settings = self._settings(problem)
        limits = self.max_iterations, settings.tolerance, bool(np.any(settings.barrier))
        joint_solver(problem.game, problem.view, 1, *limits)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)

    @property
    def _uses_ipopt(self) -> bool:
        return self.solver == "ipopt"

    def _settings(self, problem: Problem) -> JointSettings:
        return JointSettings(
            noise_scale=problem.noise_scale,
            weight_floor=problem.weight_floor,
            max_iterations=self.max_iterations,
        )

    def _structured_settings(self, problem: Problem) -> JointSettings:
        return replace(self._settings(problem), tolerance=solver_tolerance(problem.sigma))

    def _certainty(
        self,
        problem: Problem,
        observations: Sequence[Observation],
        games: Sequence[SolvedGame],
        solver: Elimination | None,
    ) -> Certainty:
        """What the optimum leaves open of theta."""
        return likelihood_certainty(problem, observations, games, solver)

    def _ipopt_attempts(self, problem: Problem, y: np.ndarray) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view

        def solve(start: JointPoint, tie: float = 0.0) -> JointSolution:
            settings = self._settings(problem)
            settings = replace(settings, tie=settings.tie + tie)
            return solve_joint_ipopt(game, view, [y], [start], settings)

        start = JointPoint.from_trajectory(game, guess_states(game, view, y))
        first = solve(start)
        yield first
        fit = fit_trajectory(game, view, y, problem.noise_scale)
        yield solve(JointPoint.from_trajectory(game, fit.states, fit.controls))
        tied = solve(start, tie=_TIE * first.objective)
        yield solve(inside(tied.point, problem.weight_floor))


def solver_tolerance(sigma: float) -> float:
    """Of the structured solver. Its barrier, whose last weight is a tenth, pulls weights inwards.

    The objective is as flat as the noise is small, so the barrier has to be smaller there.
    """
    return float(np.clip(_TOLERANCE * (sigma / _USUAL_SIGMA) ** 2, _TIGHT, _TOLERANCE))


def _motions(problem: Problem, observations: Sequence[Observation]) -> list[SeenMotion]:
    """Several observations of the same players and unknowns."""
    return [
        SeenMotion(problem.game, problem.view, one.y, problem.noise_scale, situation=0)
        for one in observations
    ]


def _verdict(
    problem: Problem, motions: Sequence[SeenMotion], best: JointSolution
) -> tuple[bool, str]:
    """Whether a solution is valid, and a message about it."""
    drivers = {driver for one in motions for driver in one.rows}
    seen = {
        one.rows[int(player)]
        for one in motions
        for player in np.flatnonzero(np.isfinite(one.y).any(axis=(0, 2)))
    }
    if unseen := drivers - seen:  # the optimum exists, but says nothing about these players
        players = ", ".join(map(str, sorted(unseen)))
        return False, f"never seen, hence not identified: player {players}"
    if not best.converged:
        return False, best.message
    return True, unexplained(problem, best.objective, [one.y for one in motions])


def in_time(solutions: Iterator[JointSolution], deadline: float) -> list[JointSolution]:
    """The first solution, and those after it that begin before the deadline."""
    attempts = []
    for attempt in solutions:
        attempts.append(attempt)
        if time.monotonic() > deadline:
            break
    return attempts
