"""What the samples so far say: the posterior after each of them, and its peak.

``ukf`` and ``particle`` begin at the most probable game given the samples up to t, and return to it
when lost. It is a solution of the joint problem with a prior (``map``), each followed from the last
(``joint_stream``), whose iterates need not be equilibria, which end at folds. A few Gauss-Newton
steps lead from there to the peak of the filter's own posterior.
"""

import time
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from olne_bench.estimators.kkt_constrained import in_time, solver_tolerance
from olne_bench.estimators.map import with_prior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.belief import (
    FollowedGames,
    Gaussian,
    LateError,
    LostError,
    first_game,
    first_weights,
    prior_belief,
)
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    fitted_game,
    game_of_point,
)
from olne_bench.estimators.shared.joint_problem import JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import joint_attempts
from olne_bench.estimators.shared.joint_stream import FollowedOptimum
from olne_bench.estimators.shared.white_noise import assumed_sigma
from olne_bench.estimators.shared.window_starts import first_samples

#: Gauss-Newton: steps at most, decrease of the objective below which none is taken, and damping:
#: the first, its factor, and the largest.
_MOST_STEPS, _SMALL_DECREASE = 40, 0.02
_FIRST_DAMPING, _DAMPING_FACTOR, _MOST_DAMPING = 0.01, 10.0, 1e3

#: Decrease of -log pi_t for which a filter moves to another point. Smaller ones are those between a
#: mean and a peak.
_OFF = 2.0

#: A filter begins when every player was seen in the horizon over this number of samples, and in so
#: many at least.
_SHARE, _LEAST = 4, 2


class Games(Protocol):
    """Expected measurements at points (``belief.FollowedGames``)."""

    def expected(self, points: np.ndarray) -> np.ndarray:
        """(B, T, d) at points (B, n), NaN where there is none; the first point is their centre."""

    def tilt(self, points: np.ndarray) -> np.ndarray:
        """(B,) what the log of the prior has beside that of a Gaussian."""

    def tangent(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """(T, d) at a point (n,) and their derivative (T, d, n); None where there is none."""


@dataclass(frozen=True)
class Tangent:
    """A point (n,), its expected measurements (T, d), and their derivative (T, d, n)."""

    point: np.ndarray
    expected: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True)
class Linearised:
    """-log pi_t at a point, up to a constant, its gradient (n,), and Gauss and Newton's Hessian."""

    tangent: Tangent
    objective: float
    gradient: np.ndarray
    precision: np.ndarray

    def laplace(self) -> Gaussian:
        """Laplace's approximation, if the point is the peak."""
        return Gaussian(self.tangent.point, np.linalg.inv(self.precision))


class PastPosterior:
    """Log pi_t(s) = log N(s; prior) - sum_{r<=t} |e_r|^2 / 2 of points s (n,), for every t."""

    def __init__(self, prior: Gaussian, games: Games, samples: np.ndarray, sigma: float) -> None:
        """The posterior of measurements (T, d), NaN where missing, with noise of level sigma."""
        self._games, self._samples, self._sigma = games, samples, sigma
        self._seen = np.isfinite(samples)
        self._mean, self._precision = prior.mean, np.linalg.inv(prior.covariance)

    def objective(self, point: np.ndarray, expected: np.ndarray, t: int) -> float:
        """-log pi_t, without its constant, of a point and its expected measurements (T, d)."""
        errors, off = self._errors(expected, t), point - self._mean
        return float(errors @ errors + off @ self._precision @ off) / 2

    def tangent(self, point: np.ndarray) -> Tangent | None:
        """The game at a point (n,); None if it has none."""
        found = self._games.tangent(point)
        return None if found is None else Tangent(point, *found)

    def linearised(self, tangent: Tangent | None, t: int) -> Linearised | None:
        """Log pi_t at a point; None where it has no game."""
        if tangent is None:
            return None
        errors, off = self._errors(tangent.expected, t), tangent.point - self._mean
        slopes = tangent.slopes[: t + 1][self._seen[: t + 1]] / self._sigma
        return Linearised(
            tangent,
            self.objective(tangent.point, tangent.expected, t),
            slopes.T @ errors + self._precision @ off,
            slopes.T @ slopes + self._precision,
        )

    def climbed(self, here: Linearised, t: int) -> Linearised:
        """The peak of pi_t near a point, by damped Gauss-Newton steps."""
        damping = 0.0
        for _ in range(_MOST_STEPS):
            damped = here.precision + damping * np.diag(np.diag(here.precision))
            step = np.linalg.solve(damped, here.gradient)
            if here.gradient @ step < _SMALL_DECREASE or damping > _MOST_DAMPING:
                break
            there = self.linearised(self.tangent(here.tangent.point - step), t)
            if there is not None and there.objective < here.objective:
                here, damping = there, damping / _DAMPING_FACTOR
                damping = damping if damping >= _FIRST_DAMPING else 0.0
            else:
                damping = max(_DAMPING_FACTOR * damping, _FIRST_DAMPING)
        return here

    def _errors(self, expected: np.ndarray, t: int) -> np.ndarray:
        seen = self._seen[: t + 1]
        return np.asarray(((expected - self._samples)[: t + 1] / self._sigma)[seen])


class PastGames:
    """The most probable game given the samples so far, for one t after the other."""

    def __init__(self, problem: Problem, y: np.ndarray, deadline: float) -> None:
        """Games of y (T, N, d), NaN where missing; the noise is white.

        Searches end by the deadline, in seconds of ``time.monotonic``.
        """
        self._problem = replace(problem, sigma=assumed_sigma(problem))
        self._y, self._deadline = y, deadline
        self._optimum = FollowedOptimum(self._settings, self._search)

    def at(self, t: int) -> SolvedGame | None:
        """The most probable game given the samples up to t; None if none was found."""
        found, _ = self._optimum.find(self._problem, first_samples(self._y, t + 1), self._deadline)
        return game_of_point(found.point) if found.converged else None

    def _settings(self, problem: Problem) -> JointSettings:
        plain = JointSettings(
            noise_scale=problem.noise_scale,
            weight_floor=problem.weight_floor,
            tolerance=solver_tolerance(problem.sigma),
        )
        return with_prior(plain, problem, problem.prior)

    def _search(self, problem: Problem, y: np.ndarray, deadline: float) -> list[JointSolution]:
        return in_time(joint_attempts(problem, y, self._settings(problem), deadline), deadline)


class PastPeaks:
    """Points of the first game, then of the most probable games so far."""

    def __init__(self, games: FollowedGames, past: PastGames) -> None:
        self._games, self._past = games, past
        self._next: SolvedGame | None = games.start

    def better(self, posterior: PastPosterior, t: int, objective: float) -> Linearised | None:
        """A point clearly more probable given the samples up to t; games then start from it."""
        game, self._next = self._next or self._past.at(t), None
        if game is None:
            return None
        point = self._games.point(game)
        expected = expected_samples(self._games.problem, game.root.states)
        if objective - posterior.objective(point, expected, t) <= _OFF:
            return None
        before, self._games.start = self._games.start, game
        found = posterior.linearised(posterior.tangent(point), t)
        if found is None:
            self._games.start = before
        return found


@dataclass(frozen=True)
class Outset:
    """Where a filter of one trajectory begins."""

    prior: Gaussian  # belief before the first measurement
    games: FollowedGames  # games, followed from the first one
    first: int = 0  # time of the last measurement on which the first game rests
    #: Points of the most probable games so far; None if the filter peeks.
    peaks: PastPeaks | None = None


def outset(
    problem: Problem,
    observation: Observation,
    weights: Gaussian | None,
    spread: float,
    deadline: float,
    *,
    peek: bool,
) -> Outset:
    """Where a filter begins; ``spread`` and ``peek`` are those of ``Ukf``, and the noise is white.

    ``weights`` is the belief after earlier trajectories, None if there are none. Raises LostError
    if no game is found near the samples; LateError after the deadline, in s of ``time.monotonic``.
    """
    sigma = assumed_sigma(problem)
    if peek:
        game = first_game(problem, observation)
        around = weights or first_weights(problem, spread, game)
        prior = prior_belief(problem, observation, around, sigma)
        return Outset(prior, FollowedGames(problem, game, deadline))
    past, y = PastGames(problem, observation.y, deadline), observation.y
    for first in range(beginning(y), len(y)):
        seen = Observation(first_samples(y, first + 1))
        found = past.at(first) or fitted_game(problem, seen)
        if time.monotonic() > deadline:
            raise LateError("time limit reached")
        if found is not None:
            around = weights or first_weights(problem, spread)
            prior = prior_belief(problem, seen, around, sigma)
            games = FollowedGames(problem, found, deadline)
            return Outset(prior, games, first, PastPeaks(games, past))
    raise LostError("no equilibrium found near the samples")


def beginning(y: np.ndarray) -> int:
    """The first t with T/4 samples, at least two, of every player in y (T, N, d); else the last."""
    counts = np.isfinite(y).any(axis=2).cumsum(axis=0).min(axis=1)
    (enough,) = np.nonzero(counts >= max(_LEAST, len(y) // _SHARE))
    return int(enough[0]) if enough.size else len(y) - 1
