"""The posterior (B1) of ``posterior`` as a density of errors, with games followed from each other.

A point is (z, x_1): coordinates of weights and unknowns in which their prior is standard normal
(``normal_chart``), and the initial state. Its errors are those of the expected samples over sigma,
and z. A game starts from the first-order prediction of the one at the place before, and is refined
by Newton's method. So points stay on the branch of equilibria from which they come.
"""

import time
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.normal_chart import NormalChart
from olne_bench.estimators.shared.residual_density import Places
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.observation import View
from olne_bench.games.solve.newton import pack
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

#: Residuals of games, relative to the noise.
_TOLERANCE = 1e-5

#: Factorisations per game. Predictions are good where there is a game: 97 % take four at most (in
#: the roundabout at 1 m). Two in five are beyond a fold there, and took four fifths of the time.
_FACTORISATIONS = 4


@dataclass(frozen=True)
class StartPrior:
    """A normal prior of the initial state.

    Attributes:
        mean: (N, n).
        deviation: (N, n) standard deviations; infinite where nothing is known.
    """

    mean: np.ndarray
    deviation: np.ndarray


@dataclass(frozen=True)
class FollowedGames:
    """Errors and their derivatives.

    Attributes:
        problem: what is known; its noise is white and its sigma positive.
        observation: what was seen.
        chart: coordinates of weights and unknowns.
        deadline: in seconds of ``time.monotonic``.
        start: prior of x_1, which is flat without one.
    """

    problem: Problem
    observation: Observation
    chart: NormalChart
    deadline: float
    start: StartPrior | None = None

    def place(self, game: SolvedGame) -> Places:
        """The place of a known game."""
        root = game.root
        start = self.chart.point(game.theta), root.states[0].ravel()
        packed = pack(self.problem.game, root.states, root.controls, root.costates, game.theta)
        return self._places(np.concatenate(start)[None], packed[None], np.ones(1, dtype=bool))

    def reach(self, points: np.ndarray, near: Places) -> Places:
        """As of ``residual_density.Density``; nothing is possible after the deadline."""
        theta, start = self.split(points)
        old_theta, old_start = self.split(near.points)
        flat = len(points), -1
        before = np.hstack([old_start.reshape(flat), old_theta.reshape(flat)])
        after = np.hstack([start.reshape(flat), theta.reshape(flat)])
        roots, width = near.roots.copy(), _width(self.problem)
        for root, response, change in zip(roots, near.responses, after - before, strict=True):
            root += response @ change.astype(np.float32)
        roots[:, 0, :width] = after[:, :width]  # exact, without rounding
        residuals, _ = self._solver.newton(
            roots,
            theta.reshape(flat),
            tolerance=self._tolerance,
            max_iterations=_FACTORISATIONS,
            limit=max(0.0, self.deadline - time.monotonic()),
        )
        return self._places(points, roots, residuals < max(self._tolerance, RESIDUAL_TOLERANCE))

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

    def _places(self, points: np.ndarray, roots: np.ndarray, possible: np.ndarray) -> Places:
        problem = self.problem
        samples, slopes = self._seen(roots[:, :, : _width(problem)])
        seen = np.isfinite(self.observation.y).ravel()
        errors = samples - self.observation.y / np.array(problem.noise_scale)
        errors = errors.reshape(len(points), -1)[:, seen] / problem.sigma
        believed, slope = self._prior(points)
        errors = np.hstack([errors, believed])
        rows, responses, possible = self._derivatives(
            points, roots, possible, slopes / problem.sigma, slope
        )
        errors[~possible] = 0.0
        return Places(points, errors, rows, possible, roots, responses)

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
        points: np.ndarray,
        roots: np.ndarray,
        possible: np.ndarray,
        seen: np.ndarray,
        believed: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of the errors and of the roots, and which roots (B,) are regular.

        Args:
            points: (B, d).
            roots: (B, T, s).
            possible: (B,).
            seen: (B, T, N, d, n) h_x over sigma.
            believed: (P, d) derivative of the errors of the prior.

        Returns:
            (B,) arrays (O, d), (B,) arrays (T, s, C) in (x_1, theta), (B,). The second ones are in
            single precision, which is enough for predictions.
        """
        solver, theta = self._solver, self.chart.theta(points[:, : self.chart.size])
        jacobian = self.chart.jacobian(points[:, : self.chart.size])
        there = np.isfinite(self.observation.y).ravel()
        width, columns = _width(self.problem), _width(self.problem) + theta[0].size
        rows, responses = (np.empty(len(roots), dtype=object) for _ in range(2))
        count, size = int(there.sum()), self.chart.size
        no_row = np.zeros((count + len(believed), points.shape[1]))
        no_response = np.zeros((*roots[0].shape, columns), dtype=np.float32)
        possible = possible.copy()
        for k in range(len(roots)):
            possible[k] = possible[k] and solver.linearise(roots[k], theta[k].ravel())
            if not possible[k]:
                rows[k], responses[k] = no_row, no_response
                continue
            response = solver.sensitivities()
            states = response[:, :width].reshape(*seen.shape[1:3], -1, columns)
            changes = (seen[k] @ states).reshape(-1, columns)
            changes = changes if count == len(changes) else changes[there]
            rows[k] = row = np.empty_like(no_row)
            np.matmul(changes[:, width:], jacobian[k], out=row[:count, :size])
            row[:count, size:], row[count:] = changes[:, :width], believed
            responses[k] = response.astype(np.float32)
        return rows, responses, possible

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
