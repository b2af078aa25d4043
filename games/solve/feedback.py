"""Feedback Nash equilibria: each player has the best strategy u^i_t = gamma^i_t(x_t).

Players of an open-loop game commit to plans; here they see the state at each step and answer it.
Around a motion, the dynamics are linear and costs quadratic in changes dx, du (iterative LQ games;
Fridovich-Keil et al. 2020):

    (F1)  dx_{t+1} = [A B] d,  d = (dx, du);  cost of player i: g^i' d + d' H^i d / 2
    (F2)  V^i_{t+1}(dx) = dx' Z^i dx / 2 + zeta^i' dx;  at the end, Z^i and zeta^i are H^i and g^i
    (F3)  the rows du^i of  W^i d + w^i  vanish, where
          W^i = H^i + zeta^i' f'' + [A B]' Z^i [A B],  w^i = g^i + [A B]' zeta^i
    (F4)  du = -P dx - a solves them for all players at once
    (F5)  Z^i_t = K' W^i K,  zeta^i_t = K' (w^i + W^i k),  K = (I, -P), k = (0, -a)

The next motion is rolled out with the strategies u - P (x' - x) - eta a, with the largest
eta = 1, 1/2, ... that makes a smaller. At a motion with a = 0 no player gains, to first order, by
another strategy while the others keep theirs. The paper leaves out f'', second derivatives of the
motion; with them (Laine et al. 2021) LQ games converge in fewer rounds. Second derivatives of
strategies are left out by both.
"""

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import numpy as np

from olne_bench.games.compiled.bindings import check_size
from olne_bench.games.compiled.compiler import load
from olne_bench.games.model.constraints import refuse_constraints
from olne_bench.games.model.game import Game
from olne_bench.games.solve.expansions import Expansions
from olne_bench.games.solve.olne import solve_olne

_SOURCE = files("olne_bench.games.solve").joinpath("feedback.c")

#: Largest |a|, in units of controls, at which a motion counts as an equilibrium.
TOLERANCE = 1e-8

#: Shortest share of a step that is tried.
_LEAST_STEP = 2.0**-12

#: Rounds of one player's response.
_MOST_RESPONSES = 40


@dataclass(frozen=True)
class FeedbackEquilibrium:
    """A motion, and the linear strategies around it.

    Attributes:
        states: (T, N, n).
        controls: (T-1, N, m).
        gains: (T-1, N, m, N*n) P: a change dx of the joint state changes controls by -P dx.
        costs: (N,) J^i of the motion.
        residual: max |a| over all players and steps.
        least_curvature: the smallest eigenvalue of H_uu^i + B_i' Z^i B_i; positive where every
            player's own condition is a minimum.
        iterations: number of LQ games.
    """

    states: np.ndarray
    controls: np.ndarray
    gains: np.ndarray
    costs: np.ndarray
    residual: float
    least_curvature: float
    iterations: int

    @property
    def converged(self) -> bool:
        """Whether (F3) holds, and each player's own part of it is a minimum."""
        return self.residual <= TOLERANCE and self.least_curvature > 0

    def action(self, t: int, states: np.ndarray) -> np.ndarray:
        """Controls (N, m) of the strategies at step t and joint states (N, n)."""
        away = (states - self.states[t]).ravel()
        return np.asarray(self.controls[t] - self.gains[t] @ away)


def solve_feedback(
    game: Game,
    weights: np.ndarray,
    initial_state: np.ndarray,
    *,
    initial_controls: np.ndarray | None = None,
    max_iterations: int = 100,
) -> FeedbackEquilibrium:
    """Find a feedback Nash equilibrium of a game; ``converged`` says whether one was found.

    Weights (N, K) are scaled to row sums of one; x_1 is (N, n), the first motion's controls (T-1,
    N, m), those of the open-loop game if None. Raises ValueError on arguments of a wrong shape, or
    a game with constraints or unknowns.
    """
    refuse_constraints(game.constraints, "a feedback equilibrium")
    if game.parameters.count:
        raise ValueError("a feedback equilibrium needs a game whose numbers are known: game.known")
    theta, start = game.check_weights(weights), game.check_initial_state(initial_state)
    if initial_controls is None:
        initial_controls = solve_olne(game, theta, start).controls
    plan = np.asarray(initial_controls, dtype=float)
    plan = plan.reshape(game.horizon - 1, plan[0].size)
    still = np.tile(start.ravel(), (game.horizon, 1))
    open_loop = np.zeros((*plan.shape, start.size))
    return _LqGame(game, theta).solved(still, plan, open_loop, max_iterations, None)


def certify_feedback(
    game: Game,
    found: FeedbackEquilibrium,
    weights: np.ndarray,
    *,
    starts: int = 4,
    spread: float = 0.2,
    seed: int = 0,
) -> np.ndarray:
    """What each player gains by another strategy nearby, relative to 1 + |J^i| (N,): about zero.

    While the others keep theirs, a player's best linear strategy at weights (N, K) is sought from
    ``starts`` plans next to its own, where each control is off by a normal number of standard
    deviation ``spread``, in the controls' units.
    """
    theta, rng = game.check_weights(weights), np.random.default_rng(seed)
    steps, count, m = game.control_shape
    lq, x = _LqGame(game, theta), found.states.reshape(game.horizon, -1)
    gains, best = found.gains.reshape(steps, count * m, -1), found.costs.copy()
    for player in range(count):
        for _ in range(starts):
            plan = found.controls.copy()
            plan[:, player] += spread * rng.standard_normal((steps, m))
            response = lq.solved(x, plan.reshape(steps, -1), gains, _MOST_RESPONSES, player)
            best[player] = np.fmin(best[player], response.costs[player])
    return np.asarray((found.costs - best) / (1 + np.abs(found.costs)))


@dataclass(frozen=True)
class _Answer:
    """The LQ game around a motion x (T, Nn), u (T-1, Nm): its strategies."""

    x: np.ndarray
    u: np.ndarray
    gains: np.ndarray  # (T-1, Nm, Nn) P
    offsets: np.ndarray  # (T-1, Nm) a
    curvatures: np.ndarray  # (T-1, N, m, m) each player's own second derivative in (F3)
    costs: np.ndarray  # (N,) J^i of the motion

    @property
    def size(self) -> float:
        """Norm of the offsets; infinite where the LQ game has no solution."""
        norm = float(np.linalg.norm(self.offsets))
        return norm if np.isfinite(norm) else np.inf

    @property
    def residual(self) -> float:
        """The largest offset."""
        return float(np.abs(self.offsets).max()) if np.isfinite(self.size) else np.inf


class _LqGame:
    """LQ games around motions of a game at certain weights."""

    def __init__(self, game: Game, theta: np.ndarray) -> None:
        self._game, self._expansions = game, Expansions(game, theta)
        self.count, self.size = game.num_players, game.dynamics.state_size
        self.own = game.dynamics.control_size
        states, controls = self.count * self.size, self.count * self.own
        self._states, self._controls = states, controls

    def solved(
        self, x: np.ndarray, plan: np.ndarray, gains: np.ndarray, most: int, player: int | None
    ) -> FeedbackEquilibrium:
        """Iterated LQ games from strategies plan (T-1, Nm) - gains (T-1, Nm, Nn) (x' - x).

        Where a ``player`` is named, the others keep theirs.
        """
        free = np.zeros(self._controls, dtype=bool)
        free.reshape(self.count, self.own)[range(self.count) if player is None else player] = True
        answer = self._answer(*self._rolled(x, plan, gains, 0 * plan), gains, free)
        iterations = 1
        while answer.residual > TOLERANCE:
            eta = 1.0
            while eta >= _LEAST_STEP and iterations < most:
                iterations += 1
                motion = answer.x, answer.u, answer.gains, eta * answer.offsets
                trial = self._answer(*self._rolled(*motion), gains, free)
                if trial.size < (1 - 0.1 * eta) * answer.size:
                    break
                eta /= 2
            else:
                break
            answer = trial
        return self._described(answer, iterations)

    def _described(self, answer: _Answer, iterations: int) -> FeedbackEquilibrium:
        game, least = self._game, -np.inf
        if np.isfinite(answer.size):
            least = float(np.linalg.eigvalsh(answer.curvatures).min())
        return FeedbackEquilibrium(
            states=answer.x.reshape(game.state_shape),
            controls=answer.u.reshape(game.control_shape),
            gains=answer.gains.reshape(*game.control_shape, self._states),
            costs=answer.costs,
            residual=answer.residual,
            least_curvature=least,
            iterations=iterations,
        )

    def _rolled(
        self, x: np.ndarray, u: np.ndarray, gains: np.ndarray, less: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The motion of strategies u - gains (x' - x) - less from x_1."""
        after = self._expansions.roll(x, u, gains, less)
        away = after[:-1] - x[:-1]
        return after, u - (gains @ away[..., None])[..., 0] - less

    def _answer(self, x: np.ndarray, u: np.ndarray, kept: np.ndarray, free: np.ndarray) -> _Answer:
        """(F1) to (F5); controls that are not free (Nm,) keep their gains (T-1, Nm, Nn)."""
        steps, count, own = len(u), self.count, self.own
        parts, costs, ends = self._expansions.rows(x, u)
        offsets = np.full((steps, self._controls), np.inf)
        found = _Answer(
            x, u, np.empty_like(kept), offsets, np.empty((steps, count, own, own)), costs
        )
        both = self._states + self._controls
        sizes = self._states * both, count * both**2, count * both
        places = parts.ctypes.data + parts.itemsize * np.cumsum([0, *sizes])
        kept, chosen = np.ascontiguousarray(kept), free.astype(np.int32)
        game = _Steps(
            *(steps, count, self.size, own),
            *(*map(int, places), parts.strides[0] // parts.itemsize),
            *(kept.ctypes.data, chosen.ctypes.data),
        )
        library = _library()
        arrays = *ends, found.gains, offsets, found.curvatures, np.empty(library.space_of(game))
        if not library.answer(game, _Arrays(*(array.ctypes.data for array in arrays))):
            offsets[:] = np.inf
        return found


class _Steps(ctypes.Structure):
    """Mirrors ``Game`` of the C file."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("steps", "count", "states", "controls")),
        *((name, ctypes.c_void_p) for name in ("motion", "squares", "slopes", "bends")),
        ("stride", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in ("kept", "free")),
    )


class _Arrays(ctypes.Structure):
    """Mirrors ``Answer`` of the C file."""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("Z", "zeta", "gains", "offsets", "curvatures", "space")
    )


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    """``feedback.c``, with the types of its functions' arguments."""
    library = load(_SOURCE.read_text())
    for k, mirror in enumerate((_Steps, _Arrays)):
        check_size(library.size_of(k), ctypes.sizeof(mirror), mirror.__name__)
    library.answer.argtypes = [ctypes.POINTER(_Steps), ctypes.POINTER(_Arrays)]
    library.space_of.argtypes, library.space_of.restype = [ctypes.POINTER(_Steps)], ctypes.c_long
    return library
