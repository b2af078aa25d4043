"""One stage of the first-order conditions, as CasADi functions.

The stacked system G of ``games.kkt`` repeats the same expressions at every step. With
z_t = (x_t, u_t, lambda_t), where lambda_t belongs to the step from t to t+1, its rows are

    rx_t = g_x(x_t, u_t, lambda_t, theta) + lambda_{t-1}    t = 2..T-1   (grad_{x^i} L^i)
    ru_t = g_u(x_t, u_t, lambda_t, theta)                   t = 1..T-1   (grad_{u^i} L^i)
    rf_t = x_{t+1} - f(x_t, u_t)                            t = 1..T-1   (F)
    rx_T = g_T(x_T, theta) + lambda_{T-1}

so a handful of small functions of one stage says all there is to say about a whole game. Here
they are derived from the game, with first derivatives as the nonzeros of named blocks and, for
the inverse problem, second derivatives of

    l_t = loss(x_t; y_t) + p' g_x + q' g_u - r' f           (p, q, r: multipliers of rx, ru, rf).

The blocks of one stage, all of them taken at (x_t, u_t, lambda_t, theta):

    Q = d g_x/dx   P = d g_x/du   X = d g_x/dtheta   A = df/dx
    S = d g_u/dx   R = d g_u/du   U = d g_u/dtheta   B = df/du     (dg_x/dlambda = -A', ...)
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.features import Stage
from olne_bench.games.game import Game
from olne_bench.games.observation import View, observation_size


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the nonzeros of a block sit; values come from a function, in this order."""

    name: str
    rows: np.ndarray
    columns: np.ndarray

    @property
    def size(self) -> int:
        """Number of nonzeros."""
        return len(self.rows)


@dataclass(frozen=True, eq=False)
class StageFunctions:
    """Everything about one game, and one observation model, that an elimination needs.

    All functions take flat vectors: states (N*n,), controls (N*m,), costates (N*n,), weights
    (N*K,), observations and their precision, 0 where missing (N*d,), multipliers p (N*n,),
    q (N*m,), r (N*n,).

    Attributes:
        num_states: N*n. num_controls: N*m. num_weights: N*K. num_samples: N*d.
        value: (x, u, lambda, theta) -> (g_x, g_u, f) in one column.
        final_value: (x, theta) -> g_T.
        jacobian: (x, u, lambda, theta) -> nonzeros of ``blocks``, one after the other.
        final_jacobian: (x, theta) -> nonzeros of ``final_blocks``.
        loss: (x, y, precision) -> (sum (precision (y - h(x)))^2, its gradient) in one column.
        hessian: (x, u, lambda, theta, p, q, r, y, precision) -> nonzeros of ``curvature``.
        final_hessian: (x, theta, p, y, precision) -> nonzeros of ``final_curvature``.
        blocks: patterns of Q, P, X, S, R, U, A, B.
        final_blocks: patterns of Q, X.
        curvature: upper triangle, its diagonal halved, of the Hessian of l_t in the order
            (x, u, lambda, theta): the Hessian is this plus its transpose.
        final_curvature: the same for the last stage, in the same order.
    """

    num_states: int
    num_controls: int
    num_weights: int
    num_samples: int
    value: ca.Function
    final_value: ca.Function
    jacobian: ca.Function
    final_jacobian: ca.Function
    loss: ca.Function
    hessian: ca.Function
    final_hessian: ca.Function
    blocks: tuple[Pattern, ...]
    final_blocks: tuple[Pattern, ...]
    curvature: Pattern
    final_curvature: Pattern

    @property
    def size(self) -> int:
        """Length of z_t = (x_t, u_t, lambda_t), and of the rows (rx_t, ru_t, rf_t)."""
        return 2 * self.num_states + self.num_controls

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All functions."""
        return (
            self.value,
            self.final_value,
            self.jacobian,
            self.final_jacobian,
            self.loss,
            self.hessian,
            self.final_hessian,
        )


@dataclass(frozen=True, eq=False)
class _Symbols:
    states: ca.SX
    controls: ca.SX
    costates: ca.SX
    weights: ca.SX
    samples: ca.SX
    precision: ca.SX
    row_multipliers: ca.SX  # p
    control_multipliers: ca.SX  # q
    step_multipliers: ca.SX  # r


@lru_cache(maxsize=64)
def stage_functions(game: Game, view: View) -> StageFunctions:
    """Derive (or fetch) the stage functions of a game and an observation model."""
    symbols = _symbols(game, view)
    x, u, costates, theta = symbols.states, symbols.controls, symbols.costates, symbols.weights
    next_states = _next_states(game, symbols)
    g_x, g_u = _gradients(game, symbols, next_states, final=False)
    g_last, _ = _gradients(game, symbols, next_states, final=True)

    loss = _loss(game, view, symbols)
    p, q, r = symbols.row_multipliers, symbols.control_multipliers, symbols.step_multipliers
    running = loss + ca.dot(p, g_x) + ca.dot(q, g_u) - ca.dot(r, next_states)
    curvature, curvature_values = _curvature(running, symbols)
    last_curvature, last_curvature_values = _curvature(loss + ca.dot(p, g_last), symbols)

    blocks, block_values = _stack(
        Q=ca.jacobian(g_x, x),
        P=ca.jacobian(g_x, u),
        X=ca.jacobian(g_x, theta),
        S=ca.jacobian(g_u, x),
        R=ca.jacobian(g_u, u),
        U=ca.jacobian(g_u, theta),
        A=ca.jacobian(next_states, x),
        B=ca.jacobian(next_states, u),
    )
    final_blocks, final_block_values = _stack(
        Q=ca.jacobian(g_last, x), X=ca.jacobian(g_last, theta)
    )

    def function(name: str, arguments: list[ca.SX], *values: ca.SX) -> ca.Function:
        return ca.Function(name, arguments, [ca.densify(ca.vertcat(*values))])

    stage, sample = [x, u, costates, theta], [symbols.samples, symbols.precision]
    return StageFunctions(
        num_states=x.numel(),
        num_controls=u.numel(),
        num_weights=theta.numel(),
        num_samples=symbols.samples.numel(),
        value=function("value", stage, g_x, g_u, next_states),
        final_value=function("final_value", [x, theta], g_last),
        jacobian=function("jacobian", stage, block_values),
        final_jacobian=function("final_jacobian", [x, theta], final_block_values),
        loss=function("loss", [x, *sample], loss, ca.gradient(loss, x)),
        hessian=function("hessian", [*stage, p, q, r, *sample], curvature_values),
        final_hessian=function("final_hessian", [x, theta, p, *sample], last_curvature_values),
        blocks=blocks,
        final_blocks=final_blocks,
        curvature=curvature,
        final_curvature=last_curvature,
    )


def _symbols(game: Game, view: View) -> _Symbols:
    players = game.num_players
    states = players * game.dynamics.state_size
    controls = players * game.dynamics.control_size
    samples = players * observation_size(view, game.dynamics)
    return _Symbols(
        states=ca.SX.sym("x", states),
        controls=ca.SX.sym("u", controls),
        costates=ca.SX.sym("lambda", states),
        weights=ca.SX.sym("theta", players * game.num_weights),
        samples=ca.SX.sym("y", samples),
        precision=ca.SX.sym("precision", samples),
        row_multipliers=ca.SX.sym("p", states),
        control_multipliers=ca.SX.sym("q", controls),
        step_multipliers=ca.SX.sym("r", states),
    )


def _next_states(game: Game, symbols: _Symbols) -> ca.SX:
    states = ca.vertsplit(symbols.states, game.dynamics.state_size)
    controls = ca.vertsplit(symbols.controls, game.dynamics.control_size)
    steps = zip(states, controls, strict=True)
    return ca.vertcat(*[game.dynamics.step(state, control, game.dt) for state, control in steps])


def _gradients(
    game: Game, symbols: _Symbols, next_states: ca.SX, *, final: bool
) -> tuple[ca.SX, ca.SX]:
    """g_x and g_u: each player's gradient of c^i - lambda^i' f in its own state and control."""
    n, m = game.dynamics.state_size, game.dynamics.control_size
    states = tuple(ca.vertsplit(symbols.states, n))
    controls = ca.vertsplit(symbols.controls, m)
    weights = ca.vertsplit(symbols.weights, game.num_weights)
    in_states, in_controls = [], []
    for i, player in enumerate(game.players):
        stage = Stage(i, states, None if final else controls[i], game.dynamics, game.dt)
        if final:
            lagrangian = player.final_cost(stage, weights[i])
        else:
            own = slice(i * n, (i + 1) * n)
            lagrangian = player.running_cost(stage, weights[i])
            lagrangian -= ca.dot(symbols.costates[own], next_states[own])
        gradient = ca.gradient(lagrangian, ca.vertcat(symbols.states, symbols.controls))
        first_control = symbols.states.numel() + i * m
        in_states.append(gradient[i * n : (i + 1) * n])
        in_controls.append(gradient[first_control : first_control + m])
    return ca.vertcat(*in_states), ca.vertcat(*in_controls)


def _loss(game: Game, view: View, symbols: _Symbols) -> ca.SX:
    """Squared error of the samples, each times its precision (eqn. inverse_approach)."""
    states = ca.vertsplit(symbols.states, game.dynamics.state_size)
    expected = ca.vertcat(*[view.expected(state, game.dynamics) for state in states])
    return ca.sumsqr(symbols.precision * (symbols.samples - expected))


def _curvature(lagrangian: ca.SX, symbols: _Symbols) -> tuple[Pattern, ca.SX]:
    """Half the Hessian in (x, u, lambda, theta)."""
    order = ca.vertcat(symbols.states, symbols.controls, symbols.costates, symbols.weights)
    return _nonzeros("H", _half(ca.hessian(lagrangian, order)[0]))


def _half(hessian: ca.SX) -> ca.SX:
    """Upper triangle with half the diagonal."""
    return ca.triu(hessian, False) + ca.diag(ca.diag(hessian)) / 2


def _nonzeros(name: str, block: ca.SX) -> tuple[Pattern, ca.SX]:
    block = ca.sparsify(block)
    rows, columns = block.sparsity().get_triplet()
    pattern = Pattern(name, np.array(rows, dtype=np.int32), np.array(columns, dtype=np.int32))
    return pattern, block.nz[:] if rows else ca.SX(0, 1)


def _stack(**blocks: ca.SX) -> tuple[tuple[Pattern, ...], ca.SX]:
    """Patterns of all blocks and their nonzeros in one column."""
    pairs = [_nonzeros(name, block) for name, block in blocks.items()]
    return tuple(pattern for pattern, _ in pairs), ca.vertcat(*[values for _, values in pairs])
