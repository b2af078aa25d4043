"""Block elimination along time for the first-order conditions: ``elimination.c``, by ``ctypes``.

Every row of G couples neighbouring steps only (names as in ``games.compiled.stage_functions``), so
a backward and a forward sweep in time solve a linear system with G_z, as in a Riccati recursion,
which is not symmetric here. With changes x, u, lambda and right-hand sides a, b, d of rx, ru, rf:

    (E1)  lambda_{t-1} + Q x_t + P u_t - A' lambda_t = a_t,    lambda_{T-1} + Q_T x_T = a_T
          S x_t + R u_t - B' lambda_t = b_t,    x_{t+1} - A x_t - B u_t = d_t
    (E2)  ansatz lambda_{t-1} = v_t - V_t x_t, with V_T = Q_T, v_T = a_T
    (E3)  M = R + B' V B,   S^ = S + B' V A,   L = P + A' V B,   K = M^-1 S^      (V of t+1)
    (E4)  V_t = Q + A' V A - L K
    (E5)  e = v - V d,   k = M^-1 (b + B' e),   v_t = a + A' e - L k              (v of t+1)
    (E6)  u_t = k - K x_t,   x_{t+1} = A x_t + B u_t + d_t, then lambda backwards by (E1)

The transposed system G_z' (p, q, r) = (a, b, d) has the shape of (E1) with Q', S', P', R', hence
V', M', and L' and S^' change places. Directions along G = 0 are Z times a change of (x_1, theta),
so W is all of the inverse problem's Hessian H that is needed:

    (E7)  Z = d(x, u, lambda) / d(x_1, theta): (E5), (E6) for x_1 = I, or a = -X, b = -U, d = 0
    (E8)  W = Z' H Z

Arrays have T rows (x_t, u_t, lambda_t), (rx_t, ru_t, rf_t) or (p_t, q_t, r_t); zero for no entry.
"""

import copy
import ctypes
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from olne_bench.games.compiled.bindings import LARGEST_INT, Work, declared, dense
from olne_bench.games.compiled.compiler import has_wide_vectors, load
from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.four_games import FourGames, work_space
from olne_bench.games.compiled.loss import Loss, loss_and_numbers
from olne_bench.games.compiled.source import source_of
from olne_bench.games.compiled.stage_functions import StageFunctions, stage_functions
from olne_bench.games.model.constraints import described
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import numbers_table, structure_and_numbers
from olne_bench.games.model.observation import VIEWS, View
from olne_bench.games.model.unknowns import at_means, unknowns_of


class Elimination:
    """Evaluates, factorises and solves one game's first-order conditions.

    It holds the last factorisation and its work space, so threads must not share it. All methods
    raise ValueError on an array of the wrong shape. The C functions of ``library`` take ``work`` by
    reference. ``enforced`` (T, C) says in which steps each margin is; where constraints are
    equations, each of (C2) in ``games.compiled.complementarity``.
    """

    def __init__(
        self,
        stages: StageFunctions,
        horizon: int,
        numbers: np.ndarray,
        constraint_numbers: np.ndarray,
        loss_and_numbers: tuple[Loss, np.ndarray],
        library: ctypes.CDLL,
    ) -> None:
        """Numbers are those of the game (N, P), of its constraints (C, P), of its view (P,)."""
        self._loss, view_numbers = loss_and_numbers
        self.stages, self.horizon, self.library = stages, horizon, library
        self.enforced = _enforced(stages, horizon)
        self._columns = stages.num_states + stages.num_weights
        self._shape = (horizon, stages.size)
        self._arrays = work_space(stages, horizon) | {
            "numbers": dense("numbers", numbers, (stages.num_players, numbers.shape[1])),
            "view_numbers": dense("view_numbers", view_numbers, (self._loss.num_numbers,)),
            "constraint_numbers": dense("numbers", constraint_numbers, constraint_numbers.shape),
            "enforced": self.enforced.astype(float),
        }
        pointers = {name: array.ctypes.data for name, array in self._arrays.items()}
        self.work = Work(horizon, relaxation=RELAXATION, **pointers, **self._loss.fields())
        self.set_observations(np.zeros((horizon, self.num_samples)))

    @cached_property
    def four(self) -> FourGames | None:
        """What solves four such games at a time; None with constraints or without wide vectors."""
        if self.stages.num_multipliers or self.stages.constraints or not has_wide_vectors():
            return None
        return FourGames(self.stages, self.horizon, self._arrays["numbers"])

    @property
    def num_samples(self) -> int:
        """N*d, of all players in one step."""
        return self.stages.num_players * self._loss.num_samples

    @property
    def relaxation(self) -> float:
        """Tau of (C1) in ``games.compiled.complementarity``."""
        return float(self.work.relaxation)

    def relaxed(self, tau: float) -> "Elimination":
        """The same game with another tau of (C1). Both share one work space."""
        other = self._twin()
        other.work.relaxation = tau
        return other

    def constrained(self, numbers: np.ndarray) -> "Elimination":
        """The same game with other numbers (C, P) of its constraints; one work space for both."""
        other = self._twin()
        shape = self._arrays["constraint_numbers"].shape
        other._arrays = self._arrays | {"constraint_numbers": dense("numbers", numbers, shape)}
        other.work.constraint_numbers = other._arrays["constraint_numbers"].ctypes.data
        return other

    def _twin(self) -> "Elimination":
        other = copy.copy(self)
        other.work = Work.from_buffer_copy(self.work)
        return other

    def set_observations(self, y: np.ndarray, noise_scale: np.ndarray | float = 1.0) -> None:
        """Observations (T, N*d), NaN where missing, and relative standard deviations (N*d,)."""
        shape = (self.horizon, self.num_samples)
        y, noise_scale = dense("y", y, shape), np.asarray(noise_scale, dtype=float)
        if noise_scale.shape not in ((), (1,), shape[1:]):
            raise ValueError(f"noise_scale has the shape {noise_scale.shape}, expected {shape[1:]}")
        seen = np.isfinite(y)
        # C keeps these two pointers; the attributes keep the arrays alive.
        self._samples, self._precision = np.where(seen, y, 0.0), seen / noise_scale
        self.work.samples = self._samples.ctypes.data
        self.work.precision = self._precision.ctypes.data

    def point(self, z: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A trajectory (T, size) and weights theta (N*K,) as C reads them."""
        return self._rows("z", z), self._weights(theta)

    def evaluate(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Residual G (T, size) at z (T, size) and weights theta (N*K,)."""
        residual = np.empty(self._shape)
        self.library.evaluate(self.work, *self.point(z, theta), residual)
        return residual

    def costs(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """The players' costs J^i (N,) along a trajectory (T, size)."""
        found = np.empty(self.stages.num_players)
        self.library.costs(self.work, *self.point(z, theta), found)
        return found

    def observation_loss(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Sum of squared observation errors, and its gradient (T, size)."""
        gradient = np.empty(self._shape)
        loss = self.library.observation_loss(self.work, self._rows("z", z), gradient)
        return loss, gradient

    def step_margins(self, z: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Margins h (T-1, C) of (C2) where constraints are equations; z (T, size)."""
        out = np.empty((self.horizon - 1, self.stages.num_multipliers))
        self.library.step_margins(self.work, *self.point(z, theta), out)
        return out

    def margins(self, z: np.ndarray) -> np.ndarray:
        """Margins g (T, C) of all constraints along a trajectory (T, size)."""
        out = np.empty((self.horizon, self.stages.num_margins))
        self.library.margins(self.work, self._rows("z", z), out)
        return out

    def push(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """J' v (T, size) for multipliers v (T, C), with J the derivative of the margins."""
        out = np.empty(self._shape)
        self.library.push(self.work, self._rows("z", z), self._margins("v", v), out)
        return out

    def change(self, z: np.ndarray, d: np.ndarray) -> np.ndarray:
        """J d (T, C): how the margins change along a direction (T, size)."""
        out = np.empty((self.horizon, self.stages.num_margins))
        self.library.change(self.work, self._rows("z", z), self._rows("d", d), out)
        return out

    def linearise(self, z: np.ndarray, theta: np.ndarray) -> bool:
        """Factorise G_z at a point, (E2) to (E4); False where a stage matrix is singular."""
        return bool(self.library.linearise(self.work, *self.point(z, theta)))

    def linearise_condensed(
        self, z: np.ndarray, theta: np.ndarray, v: np.ndarray, sigma: np.ndarray, shift: float
    ) -> bool:
        """``linearise`` with J' diag(sigma) J - v' g'' + shift I added to second derivatives.

        Multipliers v and weights sigma are (T, C). False unless the symmetric part of every stage
        matrix M is positive definite.
        """
        margins = self._margins("v", v), self._margins("sigma", sigma)
        return bool(
            self.library.linearise_condensed(self.work, *self.point(z, theta), *margins, shift)
        )

    def solve(self, right: np.ndarray, *, transposed: bool = False) -> np.ndarray:
        """Solve G_z out = right (T, size), or G_z' out = right, with x_1 (p_1) zero: (E5), (E6)."""
        out = np.empty(self._shape)
        self.library.solve(self.work, int(transposed), self._rows("right", right), out)
        return out

    def sensitivities(self) -> np.ndarray:
        """Z (T, size, N*n + N*K) of (E7) at the last factorisation; do not write into it."""
        self.library.sensitivities(self.work)
        return self._arrays["Z"]

    def reduced_hessian(
        self, z: np.ndarray, theta: np.ndarray, multipliers: np.ndarray
    ) -> np.ndarray:
        """W (E8) of loss + multipliers' G, after ``sensitivities``: (N*n + N*K,) squared."""
        W = np.empty((self._columns, self._columns))
        rows = self._rows("multipliers", multipliers)
        self.library.reduced_hessian(self.work, *self.point(z, theta), rows, W)
        return W

    def trajectory_metric(self) -> np.ndarray:
        """Z'Z over states and controls: (N*n + N*K,) squared."""
        metric = np.empty((self._columns, self._columns))
        self.library.trajectory_metric(self.work, metric)
        return metric

    def hessian_product(self, d: np.ndarray, d_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H times a direction, with the Hessian of the last ``reduced_hessian``."""
        out, out_theta = np.empty(self._shape), np.empty(self.stages.num_weights)
        d, d_theta = self._rows("d", d), self._weights(d_theta)
        self.library.hessian_product(self.work, d, d_theta, out, out_theta)
        return out, out_theta

    def reduce(self, g: np.ndarray) -> np.ndarray:
        """Z' g for g (T, size)."""
        out = np.empty(self._columns)
        self.library.reduce(self.work, self._rows("g", g), out)
        return out

    def expand(self, d: np.ndarray) -> np.ndarray:
        """Z d for d (N*n + N*K,) = (x_1, theta)."""
        out = np.zeros(self._shape)
        self.library.expand(self.work, dense("d", d, (self._columns,)), out)
        return out

    def newton(
        self,
        z: np.ndarray,
        theta: np.ndarray,
        *,
        tolerance: float,
        max_iterations: int,
        limit: float,
        factorised: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Damped Newton on G = 0 for a batch of starts z (B, T, size), in place; theta (B, N*K).

        A game's ``max_iterations`` factorisations each serve until steps leave too much of the
        residual (``ENOUGH``); with ``factorised`` the last one, of a point near a single game's
        start, serves first. Returns max |G| (B,) and the number of factorisations (B,).
        """
        count = len(z)
        if factorised and count != 1:
            raise ValueError(f"one factorisation is not near the starts of {count} games")
        points = dense("z", z, (count, *self._shape))
        if not points.flags.writeable:
            raise ValueError("z is overwritten, but cannot be written to")
        theta = dense("theta", theta, (count, self.stages.num_weights))
        residuals, iterations = np.empty(count), np.empty(count, dtype=np.int32)
        limits = tolerance, min(max_iterations, LARGEST_INT), limit
        at = self._at(count)
        at.library.newton(at.work, count, points, theta, *limits, factorised, residuals, iterations)
        if points is not z:
            z[:] = points
        return residuals, iterations

    def observe_sensitivities(
        self, z: np.ndarray, theta: np.ndarray, seen: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives (B, T, N, d, N*n + N*K) of samples in (x_1, theta) at roots z (B, T, size).

        Theta is (B, N*K), ``seen`` (B, T, N, d, n) derivatives in the player's state. Also says
        which roots (B,) are regular; the others' are undefined.
        """
        stages, count, samples = self.stages, len(z), seen.shape[3]
        own = stages.num_players, samples, stages.num_states // stages.num_players
        found = np.empty((count, self.horizon, *own[:2], self._columns))
        regular, at = np.empty(count, dtype=np.int32), self._at(count)
        at.library.observe_sensitivities(
            *(at.work, count, samples, dense("z", z, (count, *self._shape))),
            dense("theta", theta, (count, stages.num_weights)),
            dense("seen", seen, (count, self.horizon, *own)),
            *(found, regular),
        )
        return found, regular != 0

    def _at(self, count: int) -> "Elimination | FourGames":
        """What solves so many games."""
        return (self.four if count > 1 else None) or self

    def _rows(self, name: str, array: np.ndarray) -> np.ndarray:
        return dense(name, array, self._shape)

    def _margins(self, name: str, array: np.ndarray) -> np.ndarray:
        return dense(name, array, (self.horizon, self.stages.num_margins))

    def _weights(self, theta: np.ndarray) -> np.ndarray:
        return dense("theta", theta, (self.stages.num_weights,))


def _enforced(stages: StageFunctions, horizon: int) -> np.ndarray:
    """(T, C) in which steps each margin is enforced; see ``Elimination``."""
    if stages.complementarities:
        enforced = np.zeros((horizon, stages.num_multipliers), dtype=bool)
        for one in stages.complementarities:
            for k, after in enumerate(stages.complementarity_kinds[one.kind].after):
                enforced[max(0, one.first_step - after) : -1, one.offset + k] = True
        return enforced
    enforced = np.zeros((horizon, stages.num_margins), dtype=bool)
    for place in stages.constraints:
        pair = stages.constraint_kinds[place.kind]
        for k, needs_control in enumerate(pair[0].needs_control):
            first = place.first_step if needs_control else max(place.first_step, 1)
            enforced[first:-1, place.offset + k] = True
        enforced[-1, place.offset : place.offset + pair[1].num_margins] = True
    return enforced


def elimination(game: Game, view: View = VIEWS["full"], number: int = 0) -> Elimination:
    """The elimination of a game, constraints as equations; each ``number`` has its work space."""
    return _numbered(game, view, number)


@lru_cache(maxsize=64)
def _numbered(game: Game, view: View, _: int) -> Elimination:
    return _compiled(game, view, condensed=False)


def interior_elimination(game: Game, known: Game | None = None) -> Elimination:
    """The elimination of ``games.solve.interior``, with constraints condensed and one work space.

    Where the game leaves some unknown, ``known`` has known constraints; ValueError if it is
    missing.
    """
    if known is not None and known is not game:
        return _interior_elimination(game).constrained(numbers_table(known.constraints, known.dt))
    for constraint in game.constraints:
        if unknowns := unknowns_of(constraint):
            names = ", ".join(unknown.name for unknown in unknowns)
            raise ValueError(f"{described(constraint)} has unknowns: {names}")
    return _interior_elimination(game)


@lru_cache(maxsize=64)
def _interior_elimination(game: Game) -> Elimination:
    game = replace(game, constraints=at_means(game.constraints))
    return _compiled(game, VIEWS["full"], condensed=True)


def _compiled(game: Game, view: View, *, condensed: bool) -> Elimination:
    stages = stage_functions(game, condensed=condensed)
    source, functions = source_of(stages)
    library = declared(load(source, shared=(functions,)))
    structure, numbers = structure_and_numbers(game)
    own = numbers_table(game.constraints, game.dt)
    loss = loss_and_numbers(view, structure.dynamics)
    return Elimination(stages, game.horizon, numbers, own, loss, library)
