"""The most probable weights of players that behave in another way than the open-loop equilibrium.

``behaviour`` is one of ``games.solve.behaviours``: feedback equilibrium, response, leader, alone,
straight on. With the motion x(theta, x_1) of that behaviour, errors F as of ``posterior_density``
(those of the samples over sigma, and the prior's), and coordinates in which the prior is standard
normal,

    (V1)  min  |F(z, x_1)|^2 / 2,    F = ((y - h(x)) / sigma, z),

by least squares from the peak of the open-loop game. Derivatives are differences of motions. The
covariance is Laplace's, and so is the evidence, how probable the observations are under a behaviour
whatever the weights,

    (V2)  log E = -|F|^2 / 2 - log |J'J| / 2 + d log(2 pi) / 2,    J = dF / d(z, x_1).

Behaviours share the coordinates, so that evidences can be compared.

Paper: Li et al., AAMAS 2023, for feedback games.
Assumes: a behaviour that is known, no constraints, no unknown numbers.
Cost: 30 to 200 motions of the behaviour; 0.01 s each for feedback, 0.02 s for a leader.
Trust: as that of ``map``.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares

from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import COVARIANCE, Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import (
    squared_error_of,
    uniform_weights,
    warm_up_games,
)
from olne_bench.estimators.shared.noise_level import telling_noise, with_found_noise
from olne_bench.estimators.shared.perturbed_fits import Peak
from olne_bench.estimators.shared.posterior_density import GameDensity
from olne_bench.estimators.shared.trajectory_fit import guess_controls
from olne_bench.estimators.shared.white_noise import assumed_sigma, white_problem, with_white_noise
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.behaviours import BEHAVIOURS, plans
from olne_bench.games.solve.leading import NoPlanError

#: The behaviour that all other estimators assume.
OPEN_LOOP = "open_loop"

#: Steps of differences, of coordinates and of states.
_STEP, _STATE_STEP = 1e-4, 1e-5
#: Evaluations at most, and the relative gain that ends the search.
_MOST, _GAIN = 25, 1e-5
#: Shares of the peak's coordinates of weights at which a first motion is sought.
_SHARES = (1.0, 0.5, 0.0)
#: Errors where no motion is found.
_LOST = 1e3


@dataclass(frozen=True)
class Behaving:
    """The most probable weights under a behaviour.

    Raises ValueError on an unknown one.
    """

    name: ClassVar[str] = "behaving"
    behaviour: str = "feedback"

    def __post_init__(self) -> None:
        if self.behaviour not in BEHAVIOURS:
            raise ValueError(
                f"behaviour must be one of {', '.join(BEHAVIOURS)}, got {self.behaviour!r}"
            )

    def supports(self, problem: Problem) -> str | None:
        return unsupported(problem)

    def estimate(
        self, problem: Problem, observation: Observation, *, rng: np.random.Generator, budget: float
    ) -> Estimate:
        deadline = time.monotonic() + budget
        white, (seen,) = with_white_noise(problem, observation)
        known = with_found_noise(white, (seen,), deadline)
        found = explained(known, seen, deadline, [self.behaviour])
        return telling_noise(found[self.behaviour].estimate, problem, known)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        warm_up_games(white_problem(problem))


@dataclass(frozen=True)
class Explanation:
    """What a behaviour makes of observations."""

    estimate: Estimate
    log_evidence: float  # (V2); NaN where no motion of the behaviour is found near them


def unsupported(problem: Problem) -> str | None:
    """Why behaviours cannot be fitted to a problem."""
    if problem.game.constraints:
        return "behaviours other than the open loop take no hard constraints"
    if problem.game.parameters.count:
        return "behaviours other than the open loop take no unknown numbers"
    return None


def explained(
    problem: Problem, observation: Observation, deadline: float, behaviours: Sequence[str]
) -> dict[str, Explanation]:
    """Explanations of observations by each behaviour, ``OPEN_LOOP`` among them if it is named.

    The noise is white. Searches end by the deadline, in seconds of ``time.monotonic``.
    """
    problem = replace(problem, sigma=assumed_sigma(problem))
    density, peaks = Posterior().peaks(problem, observation, deadline)
    if not peaks:
        message = "no open-loop equilibrium found that explains the observations"
        nothing = Estimate(uniform_weights(problem), converged=False, message=message)
        return {name: Explanation(nothing, np.nan) for name in behaviours}
    found = {}
    for name in behaviours:
        if name == OPEN_LOOP:
            place = peaks[0].place
            states, _ = density.seen_at(place)
            fit = _Fit(place.points[0], place.errors[0], place.rows[0], states)
        else:
            fit = _Played(density, name, peaks[0], deadline).fitted()
        found[name] = _described(density, fit, name)
    return found


@dataclass(frozen=True)
class _Fit:
    """The solution of (V1)."""

    point: np.ndarray  # (d,)
    errors: np.ndarray  # (O,)
    rows: np.ndarray  # (O, d)
    states: np.ndarray | None  # (T, N, n); None where no motion is found


@dataclass
class _Played:
    """Errors of the motions of a behaviour; each search starts at the plans found last."""

    density: GameDensity
    behaviour: str
    peak: Peak
    deadline: float
    near: np.ndarray = field(init=False)  # (T-1, N, m)

    def __post_init__(self) -> None:
        states, _ = self.density.seen_at(self.peak.place)
        self.near = guess_controls(self.density.problem.game, states)

    def motion(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Plans and states at a point (d,); None if there are none, or the deadline has passed."""
        game = self.density.problem.game
        theta, start = (part[0] for part in self.density.split(point[None]))
        if time.monotonic() > self.deadline:
            return None
        try:
            found = plans(game, self.behaviour, theta, start, self.near)
        except (NoPlanError, np.linalg.LinAlgError):
            return None
        return found, rollout(game.dynamics, start, found, game.dt)

    def errors(self, point: np.ndarray) -> np.ndarray:
        """F (O,)."""
        found = self.motion(point)
        if found is None:
            return np.full(self.peak.place.errors.shape[1], _LOST)
        return self.density.errors_of(found[1], point)

    def rows(self, point: np.ndarray) -> np.ndarray:
        """J (O, d) by differences from a point that is then near all others."""
        found = self.motion(point)
        if found is not None:
            self.near = found[0]
        here, size = self.errors(point), self.density.chart.size
        steps = np.full(point.size, _STEP)
        steps[size:] = _STATE_STEP
        columns = [(self.errors(point + row) - here) / row.sum() for row in np.diag(steps)]
        return np.column_stack(columns)

    def fitted(self) -> _Fit:
        """The solution from the peak, or else from weights nearer to the middle of the prior."""
        peak, size = self.peak.place.points[0], self.density.chart.size
        nearer = [np.concatenate([share * peak[:size], peak[size:]]) for share in _SHARES]
        first = next((point for point in nearer if self.motion(point) is not None), peak)
        found = least_squares(
            self.errors, first, self.rows, x_scale="jac", ftol=_GAIN, max_nfev=_MOST
        )
        motion = self.motion(found.x)
        states = None if motion is None else motion[1]
        return _Fit(found.x, found.fun, np.asarray(found.jac), states)


def _described(density: GameDensity, fit: _Fit, behaviour: str) -> Explanation:
    problem, size = density.problem, density.chart.size
    triangle = np.linalg.qr(fit.rows, mode="r")
    theta, _ = density.split(fit.point[None])
    weights = theta[0][:, : problem.game.num_weights]
    if fit.states is None or not np.abs(np.diag(triangle)).min() > 0:
        message = f"no motion of the behaviour {behaviour!r} is near the observations"
        return Explanation(Estimate(weights, converged=False, message=message), np.nan)
    slopes = density.chart.jacobian(fit.point[:size])
    spread = np.linalg.inv(triangle)[:size]
    covariance = slopes @ (spread @ spread.T) @ slopes.T
    density_there = density.chart.tilt(fit.point[:size]) - fit.errors @ fit.errors / 2
    constant = len(fit.point) * np.log(2 * np.pi) / 2
    evidence = float(density_there + constant - np.log(np.abs(np.diag(triangle))).sum())
    estimate = Estimate(
        weights,
        states=fit.states,
        covariance=covariance,
        region=COVARIANCE,
        extras={
            "objective": squared_error_of(problem, fit.states, density.observation.y),
            "log_evidence": evidence,
        },
    )
    return Explanation(estimate, evidence)
