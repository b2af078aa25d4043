"""A small, fast open-loop game of cars that follow reference points, for receding horizons.

Everything that changes from one plan to the next (references, weights, who else is about) is a
parameter, so one compiled function serves every solve. The states are eliminated: the unknowns
are the controls, and Newton's method runs on the players' stacked gradients dJ^i/du^i = 0, which
are the first-order conditions of the OLNE (Peters et al. 2021, eqn. forward_kkt_conditions)
after elimination of states and costates.
"""

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from olne_bench.games.buffered import BufferedFunction
from olne_bench.games.dynamics import Dynamics, bicycle
from olne_bench.games.features import CarProximity, ControlEffort, Stage

#: Columns of ``weights``.
WEIGHT_NAMES = ("proximity", "speed", "acceleration", "turning", "lane")


@dataclass(frozen=True)
class Units:
    """In what units a driver counts, so that its weights compare.

    Attributes:
        length: unit of distance ahead and behind [m].
        width: unit of distance to the sides [m].
        speed: deviation from the reference speed [m/s] that costs 1.
        acceleration: acceleration [m/s^2] that costs 1.
        turning: lateral acceleration [m/s^2] that costs 1.
        steering: steering angle [rad] that costs 1, on top; it counts at low speed.
        lane: lateral deviation [m] that costs 1.
        heading: heading error [rad] that costs 1.
    """

    length: float = 6.0
    width: float = 2.2
    speed: float = 3.0
    acceleration: float = 2.0
    turning: float = 3.0
    steering: float = 1.0
    lane: float = 0.8
    heading: float = 0.15


@dataclass(frozen=True)
class Situation:
    """What a game is about at one moment; T-1 steps, N players.

    Attributes:
        initial_state: (N, 4) px, py, heading, speed.
        weights: (N, 5), see ``WEIGHT_NAMES``.
        references: (N, T-1, 4) point px, py, direction [rad], speed [m/s] to follow at each step.
        others: (N, M, T-1, 2) predicted positions of what each player has to avoid besides the
            other players; M is fixed by the game, spare entries are far away.
    """

    initial_state: np.ndarray
    weights: np.ndarray
    references: np.ndarray
    others: np.ndarray


@dataclass(frozen=True)
class Plan:
    """A solution, or the last iterate of a failed attempt.

    Attributes:
        states: (T, N, 4).
        controls: (T-1, N, 2).
        residual: largest entry of the players' gradients.
        iterations: Newton steps taken.
        converged: whether the residual is below the tolerance and every player's own Hessian is
            positive definite, hence its plan a strict local best response.
    """

    states: np.ndarray
    controls: np.ndarray
    residual: float
    iterations: int
    converged: bool


@dataclass(frozen=True)
class ReferenceGame:
    """The compiled game.

    Attributes:
        rear_axle: of the bicycle [m].
        sub_steps: Euler steps of the bicycle per step.
        steps: T-1.
        dt: step [s].
        max_players: most players that one solve takes.
        num_others: M, predicted positions per player.
        units: of the costs.
    """

    steps: int
    dt: float
    max_players: int
    num_others: int
    rear_axle: float = 2.5
    sub_steps: int = 2
    units: Units = field(default_factory=Units)

    @property
    def dynamics(self) -> Dynamics:
        """The bicycle."""
        return bicycle(self.rear_axle, self.sub_steps)

    def solve(
        self,
        situation: Situation,
        controls: np.ndarray,
        *,
        tolerance: float = 1e-4,
        max_iterations: int = 12,
        max_change: tuple[float, float] = (0.2, 3.0),
    ) -> Plan:
        """Newton's method from given controls.

        Args:
            situation: the parameters.
            controls: (T-1, N, 2) start, such as the previous plan shifted by one step.
            tolerance: on the residual.
            max_iterations: Newton steps at most.
            max_change: largest change of steering [rad] and acceleration [m/s^2] in one step.
        """
        unknowns = np.ascontiguousarray(controls.swapaxes(0, 1), dtype=float)  # (N, T-1, 2)
        limit = np.array(max_change)
        current = self._evaluate(situation, unknowns)
        iterations = 0
        while iterations < max_iterations and not current.residual < tolerance:
            try:
                change = self._newton_step(current).reshape(unknowns.shape)
            except np.linalg.LinAlgError:  # singular, or an undefined point
                break
            change *= min(1.0, 1 / np.abs(change / limit).max())
            length = 1.0
            trial = self._evaluate(situation, unknowns + change)
            while not trial.norm < current.norm and length > 0.1:
                length /= 2
                trial = self._evaluate(situation, unknowns + length * change)
            if not np.isfinite(trial.norm):
                break
            # The last, short step is taken even uphill: a local rise is better than a standstill.
            unknowns, current = unknowns + length * change, trial
            iterations += 1
        states = np.concatenate([situation.initial_state[:, None], current.states], axis=1)
        converged = bool(current.residual < tolerance) and _is_convex(current.own_hessians)
        return Plan(
            states=states.swapaxes(0, 1),
            controls=unknowns.swapaxes(0, 1),
            residual=current.residual,
            iterations=iterations,
            converged=converged,
        )

    def _newton_step(self, at: "_Linearisation") -> np.ndarray:
        count, size = at.gradients.shape
        own = at.own_hessians
        if not _is_convex(own):
            values, vectors = np.linalg.eigh(own)
            values = np.maximum(np.abs(values), 1e-3)
            own = (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2)
        # cross (N, N, T-1, 4, 2): how player i's gradient in x_i reacts to positions of player j.
        sensitivity = at.sensitivities.reshape(count, self.steps, 4, size)
        towards = np.matmul(sensitivity.swapaxes(2, 3)[:, None], at.cross)  # (N, N, T-1, 2S, 2)
        towards = towards.swapaxes(2, 3).reshape(count, count, size, 2 * self.steps)
        positions = sensitivity[:, :, :2].reshape(count, 2 * self.steps, size)
        system = np.matmul(towards, positions[None])
        system[np.arange(count), np.arange(count)] += own
        system = system.transpose(0, 2, 1, 3).reshape(count * size, count * size)
        return np.linalg.solve(system, -at.gradients.ravel())

    def _evaluate(self, situation: Situation, unknowns: np.ndarray) -> "_Linearisation":
        count = len(unknowns)
        flat = unknowns.reshape(count, -1)
        moved = self._motion[count - 1](situation.initial_state, flat)
        states = moved[:, : 4 * self.steps].reshape(count, self.steps, 4)
        positions = states[..., :2]
        avoid = np.full((count, self.max_players - 1, self.steps, 2), FAR_AWAY)
        for i in range(count):
            avoid[i, : count - 1] = np.delete(positions, i, axis=0)
        derivatives = self._costs[count - 1](
            situation.initial_state,
            flat,
            situation.weights,
            situation.references.reshape(count, -1),
            avoid.reshape(count, -1),
            situation.others.reshape(count, -1),
        )
        # CasADi stores the columns of a matrix one after the other.
        size = flat.shape[1]
        gradients, hessians, cross = np.split(derivatives, [size, size + size**2], axis=1)
        slots = cross.reshape(count, self.max_players - 1, self.steps, 2, 4).swapaxes(3, 4)
        pairs = np.zeros((count, count, self.steps, 4, 2))
        for i in range(count):
            pairs[i, [j for j in range(count) if j != i]] = slots[i, : count - 1]
        return _Linearisation(
            states=states,
            sensitivities=moved[:, 4 * self.steps :].reshape(count, size, -1).swapaxes(1, 2),
            gradients=gradients,
            own_hessians=hessians.reshape(count, size, size),
            cross=pairs,
        )

    @cached_property
    def _motion(self) -> list[BufferedFunction]:
        """Motion of 1, 2, ... players."""
        return self._over_players(_motion(self))

    @cached_property
    def _costs(self) -> list[BufferedFunction]:
        """Derivatives of the costs of 1, 2, ... players."""
        return self._over_players(_cost_derivatives(self))

    def _over_players(self, function: ca.Function) -> list[BufferedFunction]:
        return [BufferedFunction(function.map(n)) for n in range(1, self.max_players + 1)]


#: Coordinate [m] of spare entries; as far as a car gets, and no cost depends on it.
FAR_AWAY = 1e7


@dataclass(frozen=True)
class _Linearisation:
    """A point of the iteration; S = T-1 steps.

    Attributes:
        states: (N, S, 4).
        sensitivities: (N, 4S, 2S) of a player's states to its controls.
        gradients: (N, 2S) of its cost in its controls.
        own_hessians: (N, 2S, 2S) of its cost in its controls.
        cross: (N, N, S, 4, 2), entry [i, j] the second derivative of the cost of player i in its
            own state and the position of player j; zero for j = i.
    """

    states: np.ndarray
    sensitivities: np.ndarray
    gradients: np.ndarray
    own_hessians: np.ndarray
    cross: np.ndarray

    @property
    def residual(self) -> float:
        return float(np.abs(self.gradients).max())

    @property
    def norm(self) -> float:
        return float(np.linalg.norm(self.gradients))


def _is_convex(hessians: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(hessians)
    except np.linalg.LinAlgError:
        return False
    return True


def _rollout(game: ReferenceGame, initial: ca.SX, controls: ca.SX) -> list[ca.SX]:
    rows = []
    state = initial
    for control in ca.vertsplit(controls, 2):
        state = game.dynamics.step(state, control, game.dt)
        rows.append(state)
    return rows


def _motion(game: ReferenceGame) -> ca.Function:
    """One player: (x_1, u) -> states (4S,) and their sensitivities to u, in one column."""
    initial, controls = ca.SX.sym("x_1", 4), ca.SX.sym("u", 2 * game.steps)
    states = ca.vertcat(*_rollout(game, initial, controls))
    sensitivities = ca.vec(ca.densify(ca.jacobian(states, controls)))
    result = ca.vertcat(states, sensitivities)
    return ca.Function("motion", [initial, controls], [result], {"cse": True})


def _cost_derivatives(game: ReferenceGame) -> ca.Function:
    """One player: gradient, own Hessian and cross derivatives of its cost, in one column."""
    steps, slots = game.steps, game.max_players - 1
    initial, controls = ca.SX.sym("x_1", 4), ca.SX.sym("u", 2 * steps)
    weights = ca.SX.sym("theta", len(WEIGHT_NAMES))
    references = ca.SX.sym("reference", 4 * steps)
    players = ca.SX.sym("players", slots * steps * 2)
    others = ca.SX.sym("others", game.num_others * steps * 2)

    points = ca.vertsplit(players, 2) + ca.vertsplit(others, 2)
    rows = _rollout(game, initial, controls)
    cost = ca.SX(0)
    cross: list[list[ca.SX]] = [[ca.SX()] * steps for _ in range(slots)]
    for t, (row, control, reference) in enumerate(
        zip(rows, ca.vertsplit(controls, 2), ca.vertsplit(references, 4), strict=True)
    ):
        near = points[t::steps]
        # A step's cost is written in a fresh state so that it can be differentiated by it.
        state = ca.SX.sym("x", 4)
        step_cost = _step_cost(game, state, control, near, reference, weights)
        for slot in range(slots):
            mixed = ca.jacobian(ca.gradient(step_cost, state), near[slot])
            cross[slot][t] = ca.vec(ca.substitute(ca.densify(mixed), state, row))
        cost += ca.substitute(step_cost, state, row)
    gradient = ca.densify(ca.gradient(cost, controls))
    hessian = ca.densify(ca.jacobian(gradient, controls))
    blocks = [block for slot_blocks in cross for block in slot_blocks]
    return ca.Function(
        "cost_derivatives",
        [initial, controls, weights, references, players, others],
        [ca.vertcat(gradient, ca.vec(hessian), *blocks)],
        {"cse": True},
    )


def _step_cost(
    game: ReferenceGame,
    state: ca.SX,
    control: ca.SX,
    near: list[ca.SX],
    reference: ca.SX,
    weights: ca.SX,
) -> ca.SX:
    units = game.units
    stage = Stage(0, (state, *near), control, game.dynamics, game.dt)
    px, py, direction, speed = ca.vertsplit(reference)
    beside = (state[1] - py) * ca.cos(direction) - (state[0] - px) * ca.sin(direction)
    terms = (
        CarProximity(units.length, units.width).running_cost(stage),
        ((state[3] - speed) / units.speed) ** 2,
        ControlEffort("acceleration", (game.dt * units.acceleration) ** -2).running_cost(stage),
        _turning(game, state, control),
        (beside / units.lane) ** 2 + 2 * (1 - ca.cos(state[2] - direction)) / units.heading**2,
    )
    return ca.dot(weights, ca.vertcat(*terms))


def _turning(game: ReferenceGame, state: ca.SX, control: ca.SX) -> ca.SX:
    """Lateral acceleration, speed times yaw rate; the steering angle keeps it convex at rest."""
    steering = control[0]
    yaw_rate = state[3] * ca.sin(ca.atan(ca.tan(steering) / 2)) / game.rear_axle
    effort = (steering / game.units.steering) ** 2
    return (state[3] * yaw_rate / game.units.turning) ** 2 + effort
