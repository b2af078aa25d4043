"""Hard constraints as data.

A constraint says that its margins, a CasADi expression of one step, stay at zero or above. A
private one looks at one player; all players that a shared one looks at have to keep it. To add one,
write a frozen dataclass with the fields and the method of ``Constraint``.

Solvers put symbols in the place of numbers (``games.model.numbers``), so ``margins`` calculates
with them, by CasADi, and does not decide by them. Any number may be an ``Unknown``
(``games.model.unknowns``), which all constraints that hold one of its name share.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.unknowns import Unknown, at_means, unknowns_of


class Constraint(Hashable, Protocol):
    """``margins >= 0`` in every step from ``first_step`` on."""

    @property
    def name(self) -> str:
        """What is constrained, for messages."""

    @property
    def players(self) -> tuple[int, ...]:
        """The players that it looks at; margins may depend on the control of the first one."""

    @property
    def first_step(self) -> int:
        """The step from which on it holds, 0 for the initial state's."""

    def margins(self, stage: Stage) -> ca.SX:
        """A column that must not be negative, of the same length in each step.

        Player k of the stage is ``players[k]``. In the last step there is no control: what depends
        on one returns an empty column there.
        """


@dataclass(frozen=True)
class Distance:
    """Two players' positions stay ``distance`` [m] apart: circles around them do not overlap.

    The margin ``(|p_i - p_j|^2 - distance^2) / (2 distance)`` [m] is smooth, and close to the gap
    between the circles where they nearly touch. Raises ValueError if the distance is not positive.
    """

    players: tuple[int, int]
    distance: float
    first_step: int = 0
    name: str = "distance"

    def __post_init__(self) -> None:
        _check_positive(self, "distance")

    def margins(self, stage: Stage) -> ca.SX:
        squares = ca.sumsqr(stage.position(0) - stage.position(1))
        return (squares - self.distance**2) / (2 * self.distance)


@dataclass(frozen=True)
class Ellipse:
    """The second player's position stays outside an ellipse around the first player.

    The states need a ``heading``. The margin is the squared distance in half-axes, less one. Raises
    ValueError if a half-axis is not positive.

    Attributes:
        length: half-axis along the first player's heading [m].
        width: half-axis across it [m].
    """

    players: tuple[int, int]
    length: float
    width: float
    first_step: int = 0
    name: str = "ellipse"

    def __post_init__(self) -> None:
        _check_positive(self, "length")
        _check_positive(self, "width")

    def margins(self, stage: Stage) -> ca.SX:
        heading = stage.own_state("heading")
        along, across = ca.cos(heading), ca.sin(heading)
        dx, dy = ca.vertsplit(stage.position(1) - stage.position(0))
        ahead, beside = dx * along + dy * across, dy * along - dx * across
        return (ahead / self.length) ** 2 + (beside / self.width) ** 2 - 1


@dataclass(frozen=True)
class ControlBound:
    """``lower <= control component <= upper`` in its unit, None if unbounded.

    Raises ValueError if the range has no width.
    """

    players: tuple[int]
    component: str
    lower: float | None = None
    upper: float | None = None
    first_step: int = 0

    def __post_init__(self) -> None:
        _check_range(self, self.lower, self.upper)

    @property
    def name(self) -> str:
        return self.component

    def margins(self, stage: Stage) -> ca.SX:
        if stage.control is None:
            return ca.SX(0, 1)
        return _between(self.lower, stage.own_control(self.component), self.upper)


@dataclass(frozen=True)
class StateBound:
    """``lower <= state component <= upper`` in its unit, None if unbounded.

    Raises ValueError if the range has no width.
    """

    players: tuple[int]
    component: str
    lower: float | None = None
    upper: float | None = None
    first_step: int = 0

    def __post_init__(self) -> None:
        _check_range(self, self.lower, self.upper)

    @property
    def name(self) -> str:
        return self.component

    def margins(self, stage: Stage) -> ca.SX:
        return _between(self.lower, stage.own_state(self.component), self.upper)


@dataclass(frozen=True)
class RoadEdge:
    """The player's position stays on one side of a line.

    The margin is the distance [m] from the line, less ``clearance``. Raises ValueError if the
    direction is zero.

    Attributes:
        point: a point of the line [m].
        inward: the direction, at right angles to the line, that points to the road; any length.
        clearance: smallest distance from the line [m].
    """

    players: tuple[int]
    point: tuple[float, float]
    inward: tuple[float, float]
    clearance: float = 0.0
    first_step: int = 0
    name: str = "road edge"

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.inward) > 0:
            raise ValueError(f"{described(self)}: inward needs a direction, got {self.inward}")

    def margins(self, stage: Stage) -> ca.SX:
        inward = ca.vertcat(*self.inward)
        away = ca.dot(inward, stage.position(0) - ca.vertcat(*self.point))
        return away / ca.norm_2(inward) - self.clearance


def described(constraint: Constraint) -> str:
    """Name and players, for messages."""
    players = " and ".join(str(player) for player in constraint.players)
    plural = "s" if len(constraint.players) > 1 else ""
    return f"constraint {constraint.name!r} of player{plural} {players}"


def constraint_unknowns(constraints: Sequence[Constraint]) -> dict[str, tuple[Unknown, int]]:
    """Unknowns of constraints by name, each with a first player; ValueError if two differ."""
    found: dict[str, tuple[Unknown, int]] = {}
    for constraint in constraints:
        for unknown in unknowns_of(constraint):
            known, _ = found.setdefault(unknown.name, (unknown, constraint.players[0]))
            if known != unknown:
                raise ValueError(
                    f"{described(constraint)}: another constraint declares the unknown "
                    f"{unknown.name!r} differently"
                )
    return found


def refuse_constraints(constraints: Sequence[Constraint], what: str) -> None:
    """Refuse constraints that a method (``what``) would ignore; ValueError names the first one."""
    if constraints:
        raise ValueError(
            f"{what} knows no constraints, but the game has {described(constraints[0])}"
        )


def constraint_stage(
    constraint: Constraint, dynamics: Dynamics, dt: ca.SX | float, *, last: bool
) -> Stage:
    """A stage of new symbols for the players that a constraint looks at."""
    states = tuple(ca.SX.sym(f"x{k}", dynamics.state_size) for k in range(len(constraint.players)))
    return Stage(0, states, None if last else ca.SX.sym("u", dynamics.control_size), dynamics, dt)


def check_constraints(
    constraints: Sequence[Constraint], num_players: int, horizon: int, dynamics: Dynamics, dt: float
) -> None:
    """Refuse constraints that cannot belong to a game.

    Raises ValueError on players or components that do not exist, a step beyond the horizon, or
    constraints of one player that contradict each other.
    """
    for constraint in constraints:
        players, what = constraint.players, described(constraint)
        if not players or len(set(players)) != len(players):
            raise ValueError(f"{what} needs different players")
        if not all(isinstance(i, int) and 0 <= i < num_players for i in players):
            raise ValueError(f"{what}: the game's players are 0 to {num_players - 1}")
        if not (isinstance(constraint.first_step, int) and 0 <= constraint.first_step < horizon):
            raise ValueError(
                f"{what}: first_step must be 0 to {horizon - 1}, got {constraint.first_step!r}"
            )
        component = getattr(constraint, "component", None)
        known = {ControlBound: dynamics.control_names, StateBound: dynamics.state_names}
        names = known.get(type(constraint), ())
        if names and component not in names:
            raise ValueError(f"{what}: {dynamics.name} has the components {', '.join(names)}")
    for player in range(num_players):
        own = [at_means(one) for one in constraints if one.players == (player,)]
        _check_agreement(own, dynamics, dt)


def _check_agreement(own: Sequence[Constraint], dynamics: Dynamics, dt: float) -> None:
    """Refuse linear constraints of one player that no state and control keep with room to spare.

    The linear programme maximises the smallest margin; the constraints that limit it are named.
    """
    rows, offsets, names = [], [], []
    for constraint in own:
        stage = constraint_stage(constraint, dynamics, dt, last=False)
        assert stage.control is not None
        point = ca.vertcat(stage.states[0], stage.control)
        margins = constraint.margins(stage)
        slope = ca.jacobian(margins, point)
        if ca.depends_on(slope, point):
            continue
        at_zero = ca.Function("at_zero", [point], [ca.densify(slope), margins])
        slopes, values = (np.array(part) for part in at_zero(0))
        rows.append(np.hstack([-slopes, np.ones((len(slopes), 1))]))
        offsets.append(values.ravel())
        names += [constraint] * len(slopes)
    if not names:
        return
    A, b = np.vstack(rows), np.concatenate(offsets)
    goal = np.eye(A.shape[1])[-1]
    bounds = [(None, None)] * (A.shape[1] - 1) + [(None, 1.0)]
    from scipy.optimize import linprog  # it loads hundreds of modules, and few games need it

    solution = linprog(-goal, A_ub=A, b_ub=b, bounds=bounds)
    if solution.x is not None and solution.x[-1] <= 0:
        limiting = dict.fromkeys(
            described(constraint)
            for constraint, price in zip(names, solution.ineqlin.marginals, strict=True)
            if price < 0
        )
        raise ValueError(f"contradiction: no motion keeps {' and '.join(limiting)}")


def _between(lower: float | None, value: ca.SX, upper: float | None) -> ca.SX:
    """The margins of a range."""
    margins = [] if lower is None else [value - lower]
    return ca.vertcat(*margins, *([] if upper is None else [upper - value]))


def _extreme(number: Any, side: str) -> Any:
    """A number; of an unknown one, an end of its range."""
    return getattr(number, side) if isinstance(number, Unknown) else number


def _check_positive(constraint: Constraint, field: str) -> None:
    value = _extreme(getattr(constraint, field), "low")
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{described(constraint)}: {field} must be positive, got {value}")


def _check_range(constraint: Constraint, lower: float | None, upper: float | None) -> None:
    lower, upper = _extreme(lower, "high"), _extreme(upper, "low")
    given = [value for value in (lower, upper) if value is not None]
    if not given or not np.isfinite(given).all():
        raise ValueError(
            f"{described(constraint)} needs a finite lower or upper bound, got {lower} and {upper}"
        )
    if len(given) == 2 and not given[0] < given[1]:
        raise ValueError(f"{described(constraint)}: the range {lower} to {upper} has no width")
