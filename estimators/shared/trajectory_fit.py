"""The pre-solve (eqn. pre_solve): the dynamically feasible trajectory of highest likelihood.

It initialises the joint method and is the pre-filter of the KKT-residual baseline.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.costs import StateDeviation
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import View, observation_size
from olne_bench.games.solve.ipopt import QUIET

#: Passes of the filter over positions before a heading is read off them.
_HEADING_PASSES = 8

#: Number of samples from which a gap at the beginning or the end is extrapolated.
_LINE = 4

#: Where whole samples are missing, there may be many best fits, among which IPOPT wanders. This
#: weight on squared controls decides for the calmest of them, and moves fits by millimetres only.
_CALM = 1e-4

#: Some 50 iterations lead to a best fit, but where much noise hides headings a thousand may not.
_OPTIONS = QUIET | {"ipopt.max_iter": 200}


@dataclass(frozen=True)
class TrajectoryFit:
    """States (S, N, n) and controls (S-1, N, m) that explain S observations best."""

    states: np.ndarray
    controls: np.ndarray
    converged: bool
    message: str


def fit_trajectory(
    game: Game, view: View, y: np.ndarray, noise_scale: Sequence[float] = ()
) -> TrajectoryFit:
    """Least squares subject to the dynamics of a game, without equilibrium conditions.

    Where whole samples of a player are missing in y (S, N, d), NaN there, many motions fit the
    others: the calmest is meant. ``noise_scale`` (d,) are relative standard deviations; ones if
    empty.
    """
    steps = len(y)
    solver = _fit_solver(_motion_of(game), view, steps)
    gaps = np.isnan(y).all(axis=2).any()
    states = guess_states(game, view, y)
    controls = np.zeros((steps - 1, *game.control_shape[1:]))
    solution = solver(
        x0=np.concatenate([states.ravel(), controls.ravel()]),
        p=np.append(observation_parameters(y, noise_scale), _CALM if gaps else 0.0),
        lbg=0,
        ubg=0,
    )
    point = np.array(solution["x"]).ravel()
    stats = solver.stats()
    return TrajectoryFit(
        states=point[: states.size].reshape(states.shape),
        controls=point[states.size :].reshape(controls.shape),
        converged=bool(stats["success"]),
        message=str(stats["return_status"]),
    )


def warm_up_fit(game: Game, view: View, steps: int) -> None:
    """Build the solver for sequences of that many steps ahead of its first use."""
    _fit_solver(_motion_of(game), view, steps)


def _motion_of(game: Game) -> Game:
    """A game of the same motion and number of players; games that differ in costs share it."""
    any_cost = Player((StateDeviation(game.dynamics.state_names[0]),))
    return Game((any_cost,) * game.num_players, game.dynamics, 2, game.dt)


def squared_error(game: Game, view: View, states: ca.SX, y: ca.SX, precision: ca.SX) -> ca.SX:
    """Sum |precision (y - h(x))|^2 on flat symbols of matching order."""
    expected = [
        view.expected(state, game.dynamics)
        for state in ca.vertsplit(states, game.dynamics.state_size)
    ]
    return ca.sumsqr(precision * (y - ca.vertcat(*expected)))


def observation_parameters(y: np.ndarray, noise_scale: Sequence[float] = ()) -> np.ndarray:
    """``(y, precision)`` for ``squared_error``: one over the noise scale (d,), zero if missing."""
    seen = np.isfinite(y)
    precision = seen / np.array(noise_scale or 1.0)
    return np.concatenate([np.where(seen, y, 0.0).ravel(), precision.ravel()])


def guess_states(game: Game, view: View, y: np.ndarray) -> np.ndarray:
    """States (S, N, n) read off the observations, for solvers to start from.

    Observed components are used unchanged; gaps are interpolated, and extrapolated before the first
    and after the last sample. An unobserved heading points to the next position, after smoothing,
    as noise on positions would turn it. An unobserved speed is the displacement along the heading
    per time step, divided by dt; other unobserved components are zero, and these of one sample.
    """
    names = game.dynamics.state_names
    observed = view.read_off(y, game.dynamics)
    states = np.zeros((*y.shape[:2], len(names)))
    for name, samples in observed.items():
        states[..., names.index(name)] = _fill_gaps(samples)
    hidden_heading = "heading" in names and "heading" not in observed and len(y) > 1
    positions = smoothed(states[..., :2], _HEADING_PASSES if hidden_heading else 0)
    steps = np.diff(positions, axis=0) / game.dt
    if hidden_heading:
        heading = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=0)
        states[..., names.index("heading")] = np.concatenate([heading, heading[-1:]])
    if "speed" in names and "speed" not in observed and len(y) > 1:
        heading = states[:-1, :, names.index("heading")]
        speed = steps[..., 0] * np.cos(heading) + steps[..., 1] * np.sin(heading)
        states[..., names.index("speed")] = np.concatenate([speed, speed[-1:]])
    return states


def smoothed(states: np.ndarray, passes: int) -> np.ndarray:
    """States (S, ...) after passes of the filter (1, 2, 1)/4 over time; the ends move along."""
    states = np.array(states, dtype=float)
    for _ in range(passes if len(states) > 2 else 0):
        inner = (states[:-2] - 2 * states[1:-1] + states[2:]) / 4
        states[1:-1] += inner
        states[0] += inner[0]
        states[-1] += inner[-1]
    return states


def guess_controls(game: Game, states: np.ndarray) -> np.ndarray:
    """Controls (S-1, N, m) under which states (S, N, n) nearly follow each other.

    One linear least-squares step from zero controls, which is exact where controls enter the
    motion linearly. A control without effect on the motion there is zero.
    """
    steps, players, n = len(states) - 1, *states.shape[1:]
    m = game.dynamics.control_size
    coasting, effects = np.split(
        _coasting(game.dynamics, game.dt)(states[:-1].reshape(-1, n)), [n], axis=1
    )
    missing = states[1:].reshape(-1, n) - coasting
    effects = effects.reshape(-1, m, n)  # transposed Jacobians
    normal = effects @ effects.transpose(0, 2, 1)
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-12
    normal += ridge[:, None, None] * np.eye(m)
    controls = np.linalg.solve(normal, effects @ missing[..., None])
    return controls.reshape(steps, players, m)


@lru_cache(maxsize=32)
def _coasting(dynamics: Dynamics, dt: float) -> RowFunction:
    """State (n,) -> next state (n,) under zero controls, and the Jacobian (n m,) in them."""
    n, m = dynamics.state_size, dynamics.control_size
    state, control = ca.SX.sym("x", n), ca.SX.sym("u", m)
    step = dynamics.step(state, control, dt)
    both = ca.vertcat(step, ca.vec(ca.jacobian(step, control)))
    at_zero = ca.substitute(both, control, ca.SX.zeros(m))
    return RowFunction(ca.Function("coasting", [state], [ca.densify(at_zero)]), None)


def _fill_gaps(samples: np.ndarray) -> np.ndarray:
    """Linear interpolation over time of (S, N) samples, lines at the ends; zeros if never seen."""
    if np.isfinite(samples).all():
        return samples
    filled = np.zeros_like(samples)
    times = np.arange(len(samples))
    for player, column in enumerate(samples.T):
        seen = times[np.isfinite(column)]
        if not seen.size:
            continue
        filled[:, player] = np.interp(times, seen, column[seen])
        for near, missing in ((seen[:_LINE], times < seen[0]), (seen[-_LINE:], times > seen[-1])):
            if missing.any():
                line = np.polyfit(near, column[near], min(1, len(near) - 1))
                filled[missing, player] = np.polyval(line, times[missing])
    return filled


@lru_cache(maxsize=32)
def _fit_solver(game: Game, view: View, steps: int) -> ca.Function:
    """IPOPT over the states and controls of so many steps.

    Functions of one step are mapped over all of them, derivatives too: those of a whole sequence
    would take twenty times as long to build.
    """
    dynamics, players = game.dynamics, game.num_players
    n, m, d = dynamics.state_size, dynamics.control_size, observation_size(view, dynamics)
    samples, moves = players * steps, players * (steps - 1)
    x, u = ca.MX.sym("x", n, samples), ca.MX.sym("u", m, moves)
    y, precision = ca.MX.sym("y", d, samples), ca.MX.sym("precision", d, samples)
    calm, scale, multipliers = ca.MX.sym("calm"), ca.MX.sym("scale"), ca.MX.sym("l", n, moves)
    loss, loss_hessian = (one.map(samples) for one in _loss_functions(dynamics, view))
    motion, jacobian, curvature = (one.map(moves) for one in _motion_functions(dynamics, game.dt))

    start, seen, rest = (x[:, :moves], u), (x, y, precision), samples - moves
    errors = ca.vec(x[:, players:] - motion(*start))
    in_x, in_u = (_diagonal(part, moves) for part in jacobian(*start))
    following = ca.horzcat(ca.MX(n * moves, n * rest), ca.MX.eye(n * moves))
    by_z = ca.horzcat(following - ca.horzcat(in_x, ca.MX(n * moves, n * rest)), -in_u)

    xx, xu, uu = (_diagonal(part, moves) for part in curvature(*start, multipliers))
    xx = ca.diagcat(xx, ca.MX(n * rest, n * rest))
    xx += _diagonal(loss_hessian(*seen, scale), samples)
    uu += 2 * scale * calm * ca.MX.eye(m * moves)
    above = ca.horzcat(xx, ca.vertcat(xu, ca.MX(n * rest, m * moves)))
    hessian = ca.triu(ca.vertcat(above, ca.horzcat(ca.MX(m * moves, n * samples), uu)))

    z, p = ca.veccat(x, u), ca.veccat(y, precision, calm)
    derivatives = {
        "jac_g": ca.Function("jac_g", [z, p], [errors, by_z]),
        "hess_lag": ca.Function("hess_lag", [z, p, scale, ca.vec(multipliers)], [hessian]),
    }
    problem = {"x": z, "p": p, "f": ca.sum2(loss(*seen)) + calm * ca.sumsqr(u), "g": errors}
    return ca.nlpsol("trajectory_fit", "ipopt", problem, _OPTIONS | derivatives)


def _diagonal(blocks: ca.MX, count: int) -> ca.MX:
    """So many blocks side by side, as a function that is mapped returns them, on a diagonal."""
    diagonal: ca.MX = ca.diagcat(*ca.horzsplit(blocks, blocks.size2() // count))
    return diagonal


def _loss_functions(dynamics: Dynamics, view: View) -> tuple[ca.Function, ca.Function]:
    """A sample's squared error (x, y, precision), and its Hessian in x times a further factor."""
    x, scale = ca.SX.sym("x", dynamics.state_size), ca.SX.sym("scale")
    y, precision = (ca.SX.sym(name, observation_size(view, dynamics)) for name in ("y", "w"))
    loss = ca.sumsqr(precision * (y - view.expected(x, dynamics)))
    hessian = ca.hessian(scale * loss, x)[0]
    seen = [x, y, precision]
    return ca.Function("loss", seen, [loss]), ca.Function("hessian", [*seen, scale], [hessian])


def _motion_functions(
    dynamics: Dynamics, dt: float
) -> tuple[ca.Function, ca.Function, ca.Function]:
    """The next state (x, u); its Jacobians in x and u; Hessian blocks xx, xu, uu of -l'next."""
    n = dynamics.state_size
    x, u = ca.SX.sym("x", n), ca.SX.sym("u", dynamics.control_size)
    multipliers = ca.SX.sym("l", n)
    following = dynamics.step(x, u, dt)
    by_both = ca.hessian(-ca.dot(multipliers, following), ca.vertcat(x, u))[0]
    blocks = [by_both[:n, :n], by_both[:n, n:], by_both[n:, n:]]
    return (
        ca.Function("motion", [x, u], [following]),
        ca.Function("jacobian", [x, u], [ca.jacobian(following, x), ca.jacobian(following, u)]),
        ca.Function("curvature", [x, u, multipliers], blocks),
    )
