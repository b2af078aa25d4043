"""Cost features as data.

A feature is one basis function of a player's cost (Peters et al. 2021, eqn. runexp-cost): a frozen
dataclass that gives its cost as a CasADi expression, for a running stage (t < T) and for the final
state (t = T). To add one, write a dataclass with these two methods. Solvers put symbols in the
place of its numbers (``games.model.numbers``), so methods calculate with them and do not decide by
them.
"""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import casadi as ca

from olne_bench.games.model.dynamics import Dynamics


@dataclass(frozen=True)
class Stage:
    """What a feature of one player may depend on in one time step.

    Attributes:
        player: index of the player whose cost is written.
        states: one (n,) symbol per player.
        control: (m,) symbol of this player's control; None at the final step.
        dynamics: the motion model, which names the components.
        dt: step [s], a number or a symbol.
    """

    player: int
    states: tuple[ca.SX, ...]
    control: ca.SX | None
    dynamics: Dynamics
    dt: ca.SX | float

    def own_state(self, component: str) -> ca.SX:
        """This player's state component of that name."""
        return self.states[self.player][self.dynamics.state_names.index(component)]

    def own_control(self, component: str) -> ca.SX:
        """This player's control component of that name (running stages only)."""
        assert self.control is not None, "the final step has no control"
        return self.control[self.dynamics.control_names.index(component)]

    def position(self, player: int) -> ca.SX:
        """Position (2,) [m] of any player."""
        return self.states[player][:2]


class Feature(Hashable, Protocol):
    """One basis function of a player's cost."""

    @property
    def name(self) -> str:
        """Name of the feature and, for a preference, of its weight."""

    def running_cost(self, stage: Stage) -> ca.SX | float:
        """Cost of a step t < T."""

    def final_cost(self, stage: Stage) -> ca.SX | float:
        """Cost of the last state, t = T."""


@runtime_checkable
class Resizable(Protocol):
    """A feature whose structure has a size, such as a route; games share that of the largest."""

    @property
    def size(self) -> int:
        """How large this feature is."""

    def resized(self, size: int) -> Feature:
        """An equal feature whose structure depends on the given size alone."""


@runtime_checkable
class Watching(Protocol):
    """A feature that looks at some other players alone, by their indices."""

    @property
    def watched(self) -> tuple[int, ...]:
        """Indices of these players."""

    def watching(self, players: tuple[int, ...]) -> Feature:
        """The same feature with others in their place; with nobody it costs nothing."""


@dataclass(frozen=True)
class Following:
    """``scale * (speed - speed of the leader)^2`` at every step: nothing without a leader.

    The leader is a player's index, -1 for none. The states need a ``speed``.
    """

    leader: int
    scale: float = 1.0
    name: str = "following"

    @property
    def watched(self) -> tuple[int, ...]:
        return (self.leader,) if self.leader >= 0 else ()

    def watching(self, players: tuple[int, ...]) -> "Following":
        return replace(self, leader=players[0] if players else -1)

    def running_cost(self, stage: Stage) -> ca.SX | float:
        if self.leader < 0:
            return 0.0
        speed = stage.dynamics.state_names.index("speed")
        return self.scale * (stage.own_state("speed") - stage.states[self.leader][speed]) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class TimeGap:
    """``scale * (d - standstill - seconds * speed)^2``: so long behind the leader.

    The distance d of centres is along the own heading [m]. The leader is a player's index, -1 for
    none: then it costs nothing. The states need ``heading`` and ``speed``.

    Attributes:
        seconds: wanted gap in time [s].
        standstill: wanted distance of centres where nobody moves [m].
    """

    leader: int
    seconds: float = 1.5
    standstill: float = 7.0
    scale: float = 1.0
    name: str = "time gap"

    @property
    def watched(self) -> tuple[int, ...]:
        return (self.leader,) if self.leader >= 0 else ()

    def watching(self, players: tuple[int, ...]) -> "TimeGap":
        return replace(self, leader=players[0] if players else -1)

    def running_cost(self, stage: Stage) -> ca.SX | float:
        if self.leader < 0:
            return 0.0
        return self.scale * _missing(self, stage, stage.position(self.leader)) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class GivenCar:
    """A car that is no player: it moves as told, whatever players do.

    Features look it up by the time, so the states need a ``clock`` (``dynamics.with_clock``).
    Between samples it is interpolated; after the last one it stays there at its last speed, so
    samples should last as long as the game. Raises ValueError on another number of speeds than
    places, or a step that is not positive.

    Attributes:
        places: (S, 2) [m] at the times 0, ``step``, ...
        speeds: (S,) [m/s].
        step: [s].
    """

    places: tuple[tuple[float, float], ...]
    speeds: tuple[float, ...]
    step: float

    def __post_init__(self) -> None:
        if not self.places or len(self.places) != len(self.speeds):
            counts = f"{len(self.places)} places and {len(self.speeds)} speeds"
            raise ValueError(f"a given car needs a speed at each of its places, got {counts}")
        if not self.step > 0:
            raise ValueError(f"step must be a positive number of seconds, got {self.step}")

    def position(self, stage: Stage) -> ca.SX:
        """Where it is (2,) [m]."""
        xs, ys = zip(*self.places, strict=True)
        return ca.vertcat(self._now(stage, xs), self._now(stage, ys))

    def speed(self, stage: Stage) -> ca.SX:
        """How fast it is [m/s]."""
        return self._now(stage, self.speeds)

    def _now(self, stage: Stage, samples: tuple[float, ...]) -> ca.SX:
        """Each sample's share falls to zero at its neighbours; the last one's does not end."""
        time, total = stage.own_state("clock") / self.step, ca.SX(0)
        for k, sample in enumerate(samples):
            since = time - k if k < len(samples) - 1 else ca.fmin(time - k, 0)
            total += sample * ca.fmax(0, 1 - ca.fabs(since))
        return total


@dataclass(frozen=True)
class FollowingGiven:
    """``Following`` where the leader is no player."""

    car: GivenCar
    scale: float = 1.0
    name: str = "following"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * (stage.own_state("speed") - self.car.speed(stage)) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class TimeGapToGiven:
    """``TimeGap`` where the leader is no player."""

    car: GivenCar
    seconds: float = 1.5
    standstill: float = 7.0
    scale: float = 1.0
    name: str = "time gap"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * _missing(self, stage, self.car.position(stage)) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


def _missing(gap: TimeGap | TimeGapToGiven, stage: Stage, leader: ca.SX) -> ca.SX:
    """How much farther away than wanted a leader at (2,) is [m]."""
    heading, apart = stage.own_state("heading"), leader - stage.position(stage.player)
    distance = apart[0] * ca.cos(heading) + apart[1] * ca.sin(heading)
    return distance - gap.standstill - gap.seconds * stage.own_state("speed")


@dataclass(frozen=True)
class Absent:
    """A preference of other players that this one does not have: it costs nothing.

    Its weight is what the player's others leave of the sum of one. Only a task, which has the mean
    weight, can tell it.
    """

    name: str

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


@dataclass(frozen=True)
class Proximity:
    """``scale * sum_j -log(|p_i - p_j|^2 + offset)``: keep away from the other players.

    Eqn. runexp-prox-cost of the paper. The offset keeps the cost finite where players meet; its
    default is that of the published experiments.
    """

    scale: float = 0.1
    offset: float = 0.1
    name: str = "proximity"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        own = stage.position(stage.player)
        others = [j for j in range(len(stage.states)) if j != stage.player]
        return self.scale * sum(
            -ca.log(ca.sumsqr(own - stage.position(j)) + self.offset) for j in others
        )

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class CarProximity:
    """``scale * sum_j -log(q_ij + offset)``: ``Proximity`` for cars, in metres.

    ``q_ij`` is the squared distance to player j, measured in lengths along and widths across the
    player's own heading, so that a car beside it in the next lane is far and one ahead is near.
    The states need a ``heading``.

    Attributes:
        length: unit of distance along the heading [m].
        width: unit of distance across the heading [m].
        offset: keeps the cost finite where players meet.
    """

    length: float
    width: float
    scale: float = 1.0
    offset: float = 0.1
    name: str = "proximity"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        heading = stage.own_state("heading")
        along, across = ca.cos(heading), ca.sin(heading)
        own = stage.position(stage.player)
        total: ca.SX | float = 0.0
        for j in range(len(stage.states)):
            if j == stage.player:
                continue
            dx, dy = ca.vertsplit(stage.position(j) - own)
            ahead = (dx * along + dy * across) / self.length
            beside = (dy * along - dx * across) / self.width
            total -= ca.log(ahead**2 + beside**2 + self.offset)
        return self.scale * total

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class StateDeviation:
    """``scale * (state component - target)^2`` at every step.

    With ``speed`` it is eqn. runexp-vel-cost; with ``px`` it keeps a lane, with ``heading`` a
    direction. Angles are not wrapped: a target must lie on the branch of the player's heading.
    """

    component: str
    target: float = 0.0
    scale: float = 1.0

    @property
    def name(self) -> str:
        return self.component

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * (stage.own_state(self.component) - self.target) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


@dataclass(frozen=True)
class Tracking:
    """``StateDeviation`` with a scale of its own for the last step."""

    component: str
    target: float = 0.0
    scale: float = 1.0
    final_scale: float = 1.0

    @property
    def name(self) -> str:
        return self.component

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * (stage.own_state(self.component) - self.target) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.final_scale * (stage.own_state(self.component) - self.target) ** 2


@dataclass(frozen=True)
class ControlEffort:
    """``scale * (dt * control component)^2``: eqns. runexp-yawrate-cost and runexp-accel-cost.

    The published experiments penalise the change within one step, hence the factor dt.
    """

    component: str
    scale: float = 1.0

    @property
    def name(self) -> str:
        return self.component

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * (stage.dt * stage.own_control(self.component)) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


@dataclass(frozen=True)
class FinalGoal:
    """``scale * |p_T - goal|^2`` at the last step only: eqn. runexp-goal-cost."""

    goal: tuple[float, float]
    scale: float = 100.0
    name: str = "goal"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.scale * ca.sumsqr(stage.position(stage.player) - ca.vertcat(*self.goal))
