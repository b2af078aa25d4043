"""The posterior (B1) of ``posterior`` as a density of errors, with games followed from each other.

A density pi(x) = exp(-|F(x)|^2 / 2) is known at many points together with the derivative of F. A
point is (z, x_1): coordinates of weights and unknowns in which their prior is standard normal
(``charts``), and the initial state. Its errors are those of the expected samples over sigma, and z.
A game starts from the one at the place before, so points stay on its branch of equilibria.

Players that the first sample misses have a prior of their initial states; under a flat one the
posterior has a long tail of starts at hundreds of metres per second, or no integral at all. In one
step, the fastest player moves w on average. A player that is first seen k steps late is k w / 2
away from where its samples say that it began (standard deviation); its speed is off by half of the
fastest player's, and its heading by half a radian. Of 237 players seen late on HighwayEnv's roads,
the root mean square of the errors is 0.05 to 1.0 of these, the largest is 3.1 (``python
scripts/unseen_starts.py``).

Where the view hides headings, a flat prior of the first ones leaves a long, bent valley. It is
normal around the direction of the lane, where a player keeps one (0.1 rad), or else around that of
its first samples.
"""

import time
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    hidden_components,
    initial_state_prior,
)
from olne_bench.estimators.shared.trajectory_fit import guess_states
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.lanes import LaneKeeping
from olne_bench.games.model.observation import View
from olne_bench.games.solve.newton import pack
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

#: Steps to a peak. Few take more than a dozen: those that begin where a weight is zero.
_STEPS = 100

#: The shortest part of a Gauss-Newton step that is tried, and a gain that is none.
_SHORTEST, _FLAT = 1e-3, 1e-4


@dataclass(frozen=True)
class Places:
    """B points and what is known of F there. Where F has no value, it is zero."""

    points: np.ndarray  # (B, d)
    errors: np.ndarray  # F (B, O)
    rows: np.ndarray  # (B,) arrays (O, d), its derivatives, which are not copied where places are
    possible: np.ndarray  # (B,) whether F has a value
    roots: np.ndarray  # (B, ...) what further points are followed from; only the density reads it
    tilts: np.ndarray  # (B,) what the log of the density has beside -|F|^2 / 2

    def __len__(self) -> int:
        return len(self.points)

    @property
    def log_density(self) -> np.ndarray:
        """Log pi (B,)."""
        return np.where(self.possible, self.tilts - np.sum(self.errors**2, axis=1) / 2, -np.inf)

    def at(self, chosen: np.ndarray) -> "Places":
        """Those of some indices, or where a mask is true."""
        return Places(*(part[chosen] for part in self._parts()))

    def put(self, chosen: np.ndarray, others: "Places") -> None:
        """Overwrite those of some indices."""
        for part, other in zip(self._parts(), others._parts(), strict=True):
            part[chosen] = other

    def _parts(self) -> list[np.ndarray]:
        return [getattr(self, field.name) for field in fields(self)]


class Density(Protocol):
    """F at any points."""

    def reach(self, points: np.ndarray, near: Places) -> Places:
        """F at points (B, d), each followed from one of B places that are possible."""


def climbed(density: Density, place: Places, free: slice = slice(None)) -> Places:
    """The most probable point near a place, or what a hundred Gauss-Newton steps reach."""
    for _ in range(_STEPS):
        step, share = np.zeros(place.points.shape[1]), 1.0
        errors, rows = place.errors[0], place.rows[0][:, free]
        step[free] = own = -np.linalg.lstsq(rows, errors)[0]
        if np.sum(errors**2) - np.sum((errors + rows @ own) ** 2) < 2 * _FLAT:
            return place
        before = place.log_density[0]
        while share > _SHORTEST:
            trial = density.reach(place.points + share * step, place)
            if trial.log_density[0] > before:
                break
            share /= 2
        else:
            return place
        place = trial
        if place.log_density[0] - before < _FLAT:
            return place
    return place


#: Residuals of games, relative to the noise.
_TOLERANCE = 1e-5

#: Coordinates beyond have hardly any prior probability, and their weights are at the floor.
_FARTHEST = 10.0

#: Factorisations per game. Predictions are good where there is a game: 97 % take four at most (in
#: the roundabout at 1 m). Two in five are beyond a fold there, and took four fifths of the time.
_FACTORISATIONS = 4


@dataclass(frozen=True)
class StartPrior:
    """A normal prior of the initial state."""

    mean: np.ndarray  # (N, n)
    deviation: np.ndarray  # (N, n) standard deviations; infinite where nothing is known

    def near(self, start: np.ndarray, heading: int) -> "StartPrior":
        """The same prior with headings, in a column of the state, within half a turn of a start."""
        mean = self.mean.copy()
        away = (start[:, heading] - mean[:, heading]) / (2 * np.pi)
        mean[:, heading] += 2 * np.pi * np.round(away)
        return replace(self, mean=mean)


@dataclass(frozen=True)
class GameDensity:
    """Errors and their derivatives."""

    problem: Problem  # what is known; its noise is white and its sigma positive
    observation: Observation  # what was seen
    chart: NormalChart  # coordinates of weights and unknowns
    deadline: float  # in seconds of ``time.monotonic``
    start: StartPrior | None = None  # prior of x_1, which is flat without one

    def place(self, game: SolvedGame) -> Places:
        """The place of a known game."""
        root = game.root
        start = self.chart.point(game.theta), root.states[0].ravel()
        packed = pack(self.problem.game, root.states, root.controls, root.costates, game.theta)
        points = np.concatenate(start)[None]
        known = self.chart.at(points[:, : self.chart.size])
        return self._places(points, packed[None], np.ones(1, dtype=bool), *known)

    def reach(self, points: np.ndarray, near: Places) -> Places:
        """As of ``Density``; nothing is possible after the deadline, or off the chart."""
        on_chart = (np.abs(points[:, : self.chart.size]) <= _FARTHEST).all(axis=1)
        points = np.where(on_chart[:, None], points, near.points)
        theta, jacobian = self.chart.at(points[:, : self.chart.size])
        roots = near.roots.copy()
        roots[:, 0, : _width(self.problem)] = points[:, self.chart.size :]
        residuals, _ = self._solver.newton(
            roots,
            theta.reshape(len(points), -1),
            tolerance=self._tolerance,
            max_iterations=_FACTORISATIONS,
            limit=max(0.0, self.deadline - time.monotonic()),
        )
        solved = residuals < max(self._tolerance, RESIDUAL_TOLERANCE)
        return self._places(points, roots, solved & on_chart, theta, jacobian)

    def split(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Theta (B, N, K + U) and x_1 (B, N, n) of points (B, d)."""
        size = self.chart.size
        starts = points[:, size:].reshape(len(points), *self.problem.game.state_shape[1:])
        return self.chart.theta(points[:, :size]), starts

    def states(self, theta: np.ndarray, start: np.ndarray, near: Places) -> np.ndarray:
        """States (T, N, n) of the game at theta (N, K + U) and x_1 (N, n), or else of one place."""
        point = np.concatenate([self.chart.point(theta), start.ravel()])[None]
        found = self.reach(point, near)
        roots = (found if found.possible[0] else near).roots
        return roots[0, :, : _width(self.problem)].reshape(-1, *_shape(self.problem))

    def seen_at(self, place: Places) -> tuple[np.ndarray, np.ndarray]:
        """States (T, N, n) of one place, and derivatives (T, N, d, n) of samples over sigma."""
        states = place.roots[:, :, : _width(self.problem)]
        slopes = self._seen(states)[1][0] / self.problem.sigma
        return states[0].reshape(-1, *_shape(self.problem)), slopes

    def errors_of(self, states: np.ndarray, point: np.ndarray) -> np.ndarray:
        """F (O,) of a motion (T, N, n), whether or not it is a game's, at a point (d,)."""
        y, problem = self.observation.y, self.problem
        samples = self._seen(states.reshape(1, len(states), -1))[0][0]
        away = (samples - y / np.array(problem.noise_scale)) / problem.sigma
        return np.concatenate([away[np.isfinite(y)], self._prior(point[None])[0][0]])

    @property
    def late(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() > self.deadline

    @property
    def _solver(self) -> Elimination:
        return elimination(self.problem.game)

    @property
    def _tolerance(self) -> float:
        return _TOLERANCE * self.problem.sigma

    def _places(
        self,
        points: np.ndarray,
        roots: np.ndarray,
        possible: np.ndarray,
        theta: np.ndarray,
        jacobian: np.ndarray,
    ) -> Places:
        """Places of roots (B, T, s), given theta (B, N, K + U) and its derivative."""
        problem = self.problem
        samples, slopes = self._seen(roots[:, :, : _width(problem)])
        seen = np.isfinite(self.observation.y).ravel()
        errors = samples - self.observation.y / np.array(problem.noise_scale)
        errors = errors.reshape(len(points), -1)[:, seen] / problem.sigma
        believed, slope = self._prior(points)
        errors = np.hstack([errors, believed])
        rows, regular = self._derivatives(theta, jacobian, roots, slopes / problem.sigma, slope)
        possible = possible & regular
        errors[~possible] = 0.0
        tilts = self.chart.tilt(points[:, : self.chart.size])
        return Places(points, errors, rows, possible, roots, tilts)

    def _prior(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the prior (B, P) at points (B, d), and their derivative (P, d)."""
        size = self.chart.size
        if self.start is None:
            return points[:, :size], np.eye(size, points.shape[1])
        scale = self.start.deviation.ravel()
        away = (points[:, size:] - self.start.mean.ravel()) / scale
        return np.hstack([points[:, :size], away]), np.diag(np.r_[np.ones(size), 1 / scale])

    def _derivatives(
        self,
        theta: np.ndarray,
        jacobian: np.ndarray,
        roots: np.ndarray,
        seen: np.ndarray,
        believed: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the errors, (B,) arrays (O, d), and which roots (B,) are regular.

        Jacobian (B, N*(K+U), size) is that of theta (B, N, K + U), ``seen`` (B, T, N, d, n) is h_x
        over sigma, ``believed`` (P, d) the derivative of the prior's errors.
        """
        count, width, size = len(roots), _width(self.problem), self.chart.size
        flat = theta.reshape(count, -1)
        changes, regular = self._solver.observe_sensitivities(roots, flat, seen)
        changes = changes.reshape(count, -1, changes.shape[-1])
        there = np.isfinite(self.observation.y).ravel()
        changes = changes if there.all() else changes[:, there]
        samples, rows = changes.shape[1], np.empty(count, dtype=object)
        for k in range(count):
            rows[k] = row = np.zeros((samples + len(believed), believed.shape[1]))
            if regular[k]:
                np.matmul(changes[k, :, width:], jacobian[k], out=row[:samples, :size])
                row[:samples, size:], row[samples:] = changes[k, :, :width], believed
        return rows, regular

    def _seen(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Expected samples (B, T, N, d) of states (B, T, N*n), and h_x (B, T, N, d, n)."""
        size = _shape(self.problem)[1]
        function = _view_function(self.problem.view, self.problem.game.dynamics)
        found = function(states.reshape(-1, size))
        found = found.reshape(*states.shape[:2], -1, 1 + size, len(self.problem.noise_scale))
        found = found / np.array(self.problem.noise_scale)
        return found[..., 0, :], np.swapaxes(found[..., 1:, :], -1, -2)


@lru_cache(maxsize=16)
def _view_function(view: View, dynamics: Dynamics) -> RowFunction:
    """State (n,) -> (d, 1 + n), column by column: what is seen of it and its derivative."""
    state = ca.SX.sym("x", dynamics.state_size)
    seen = view.expected(state, dynamics)
    both = ca.densify(ca.horzcat(seen, ca.jacobian(seen, state)))
    return RowFunction(ca.Function("seen", [state], [both]), None)


def _shape(problem: Problem) -> tuple[int, ...]:
    """(N, n)."""
    return problem.game.state_shape[1:]


def _width(problem: Problem) -> int:
    """N*n."""
    return int(np.prod(_shape(problem)))


def density_near(
    problem: Problem, observation: Observation, start: np.ndarray, deadline: float = np.inf
) -> GameDensity:
    """The posterior (B1) of a problem with white noise, for motions that begin near a state (N, n).

    Headings count whole turns, which no observation shows: those of the prior are of the start's.
    """
    prior, names = start_prior(problem, observation), problem.game.dynamics.state_names
    if prior is not None and "heading" in names:
        prior = prior.near(start, names.index("heading"))
    return GameDensity(problem, observation, NormalChart.of(problem), deadline, prior)


#: Deviations: this share of a way or a speed, and as many radians.
_SHARE_OF_WAY = 0.5

#: Deviation of a hidden heading from that of the lane [rad].
_ALONG_LANE = 0.1


def start_prior(problem: Problem, observation: Observation) -> StartPrior | None:
    """The prior of x_1, flat for what the first sample shows; None if that is all.

    The noise is white. A player without any complete sample counts as one in the first.
    """
    complete = np.isfinite(observation.y).all(axis=2)
    late = complete.argmax(axis=0)
    names = problem.game.dynamics.state_names
    hidden = "heading" in names and names.index("heading") in hidden_components(problem)
    if not (hidden or late.any()):
        return None
    mean, deviation = initial_state_prior(problem, observation, problem.sigma)
    guess = guess_states(problem.game, problem.view, observation.y)
    one_step = _one_step(guess, complete)
    least = np.full(mean.shape, _SHARE_OF_WAY * one_step / problem.game.dt)
    least[:, :2] = _SHARE_OF_WAY * one_step * late[:, None]
    if "heading" in names:
        least[:, names.index("heading")] = _SHARE_OF_WAY
    wide = np.where(late[:, None] > 0, np.maximum(deviation, least), np.inf)
    if hidden:
        k = names.index("heading")
        for i in np.flatnonzero(late == 0):
            mean[i, k], wide[i, k] = _first_heading(problem, int(i), mean[i], k, deviation[i, k])
    return StartPrior(mean, wide)


def _first_heading(
    problem: Problem, player: int, start: np.ndarray, k: int, deviation: float
) -> tuple[float, float]:
    """Mean and deviation [rad] of the heading, component k of a start (n,) read off the samples."""
    known = problem.game.players[player]
    for feature in (*known.preferences, *known.task):
        if isinstance(feature, LaneKeeping):
            lane = feature.direction_at((float(start[0]), float(start[1])))
            turns = np.round((start[k] - lane) / (2 * np.pi))
            return lane + 2 * np.pi * float(turns), _ALONG_LANE
    return float(start[k]), deviation


def _one_step(guess: np.ndarray, complete: np.ndarray) -> float:
    """How far [m] the fastest player gets in a step, from its first to its last sample."""
    ways = [0.0]
    for player, seen in enumerate(complete.T):
        steps = np.flatnonzero(seen)
        if len(steps) > 1:
            way = guess[steps[-1], player, :2] - guess[steps[0], player, :2]
            ways.append(float(np.linalg.norm(way) / (steps[-1] - steps[0])))
    return max(ways)
