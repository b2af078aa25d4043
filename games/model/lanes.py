"""Lanes as curves that CasADi differentiates, and the feature that keeps a car on them.

A lane gives local coordinates of a position: the distance along its centre line, the distance to it
(positive to the left of the driving direction in a left-handed frame such as HighwayEnv's, whose y
axis points down), and the heading of the lane. A route is a chain of lanes, whose cost passes
smoothly from one to the next. Solvers see it as a table of numbers (``RouteTable``): draws of a
road, whose routes differ in kinds and numbers of lanes, then share one solver.
"""

import math
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Protocol

import casadi as ca

from olne_bench.games.model.costs import Stage


class Lane(Protocol):
    """A centre line of finite length [m]."""

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """``(along [m], beside [m], heading of the lane there [rad])`` of a position (2,)."""


@dataclass(frozen=True)
class StraightLane:
    """A lane from ``start`` [m] in the unit ``direction``."""

    start: tuple[float, float]
    direction: tuple[float, float]
    length: float

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        dx, dy = position[0] - self.start[0], position[1] - self.start[1]
        cos, sin = self.direction
        return dx * cos + dy * sin, dy * cos - dx * sin, ca.atan2(ca.SX(sin), ca.SX(cos))

    def general(self) -> "GeneralLane":
        """The same lane as numbers."""
        heading = math.atan2(self.direction[1], self.direction[0])
        return GeneralLane(self.start, self.direction, heading, self.length)


@dataclass(frozen=True)
class SineLane:
    """A sine of ``amplitude`` [m], ``pulsation`` [rad/m] and ``phase`` [rad] about an axis."""

    axis: StraightLane
    amplitude: float
    pulsation: float
    phase: float

    @property
    def length(self) -> float:
        return self.axis.length

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        along, beside, heading = self.axis.locate(position)
        angle = self.pulsation * along + self.phase
        return (
            along,
            beside - self.amplitude * ca.sin(angle),
            heading + ca.atan(self.amplitude * self.pulsation * ca.cos(angle)),
        )

    def general(self) -> "GeneralLane":
        """The same lane as numbers."""
        return replace(
            self.axis.general(),
            amplitude=self.amplitude,
            pulsation=self.pulsation,
            phase=self.phase,
        )


@dataclass(frozen=True)
class ArcLane:
    """An arc of ``radius`` [m] about ``centre`` [m] from ``start_phase`` to ``end_phase`` [rad].

    Phases grow in the driving direction if ``end_phase`` is the larger, and fall otherwise.
    """

    centre: tuple[float, float]
    radius: float
    start_phase: float
    end_phase: float

    @property
    def length(self) -> float:
        return self.radius * abs(self.end_phase - self.start_phase)

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        turn = 1.0 if self.end_phase > self.start_phase else -1.0
        middle = (self.start_phase + self.end_phase) / 2
        dx, dy = position[0] - self.centre[0], position[1] - self.centre[1]
        cos, sin = ca.cos(middle), ca.sin(middle)
        # Measured from the middle of the arc, so that the cut of atan2 lies opposite to it.
        phase = ca.atan2(dy * cos - dx * sin, dx * cos + dy * sin)
        along = turn * phase * self.radius + self.length / 2
        beside = turn * (self.radius - ca.sqrt(dx**2 + dy**2))
        return along, beside, middle + phase + turn * ca.pi / 2

    def general(self) -> "GeneralLane":
        """The same lane as numbers."""
        turn = 1.0 if self.end_phase > self.start_phase else -1.0
        middle = (self.start_phase + self.end_phase) / 2
        return GeneralLane(
            origin=self.centre,
            direction=(math.cos(middle), math.sin(middle)),
            heading=middle + turn * math.pi / 2,
            length=self.length,
            arc=1.0,
            turn=turn,
            radius=self.radius,
        )


@dataclass(frozen=True)
class GeneralLane:
    """Any of the lanes above, as numbers in one formula.

    With a, b the coordinates of a position along and across ``direction`` from ``origin``, a
    straight lane or a sine has ``arc`` 0 and an arc has ``arc`` 1. What belongs to the other kind
    is multiplied by zero, and is finite with all its derivatives.

    Attributes:
        origin: start of the axis, or centre of the arc [m].
        direction: unit vector of the axis, or from the centre to the middle of the arc.
        heading: of the axis, or in the middle of the arc [rad].
        length: of the centre line [m].
        amplitude, pulsation, phase: of a sine; zero for others.
        arc: 1 for an arc, else 0.
        turn: 1 where the phase of the arc grows in the driving direction, else -1.
        radius: of the arc [m].
    """

    origin: tuple[float, float]
    direction: tuple[float, float]
    heading: float
    length: float
    amplitude: float = 0.0
    pulsation: float = 0.0
    phase: float = 0.0
    arc: float = 0.0
    turn: float = 1.0
    radius: float = 1.0

    def locate(self, position: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        dx, dy = position[0] - self.origin[0], position[1] - self.origin[1]
        cos, sin = self.direction
        a, b = dx * cos + dy * sin, dy * cos - dx * sin
        axis = 1 - self.arc
        angle = self.pulsation * a + self.phase
        # Off an arc its formula is taken at (1, 0), where nothing is singular.
        x, y = self.arc * a + axis, self.arc * b
        phase = ca.atan2(y, x)
        along = axis * a + self.arc * (self.turn * phase * self.radius + self.length / 2)
        off_axis = b - self.amplitude * ca.sin(angle)
        off_arc = self.turn * (self.radius - ca.sqrt(x**2 + y**2))
        slope = ca.atan(self.amplitude * self.pulsation * ca.cos(angle))
        return along, axis * off_axis + self.arc * off_arc, self.heading + slope + phase

    def point(self, along: float) -> tuple[float, float]:
        """Position [m] on the centre line."""
        a, b = along, self.amplitude * math.sin(self.pulsation * along + self.phase)
        if self.arc:
            phase = (along - self.length / 2) / (self.turn * self.radius)
            a, b = self.radius * math.cos(phase), self.radius * math.sin(phase)
        cos, sin = self.direction
        return self.origin[0] + a * cos - b * sin, self.origin[1] + a * sin + b * cos


#: Lanes with a formula in numbers.
_KNOWN = (StraightLane, SineLane, ArcLane)

#: Largest distance [m] from the end of a lane to the next lane.
MOST_GAP = 8.0


@dataclass(frozen=True)
class LaneKeeping:
    """``scale * ((beside - offset) / width)^2 + heading_scale * 2 (1 - cos(heading - lane's))``.

    Along a route of several lanes the costs of two neighbours are blended by a logistic function of
    the distance past the end of the earlier one, within about ``blend`` metres. Beside the lane
    this distance counts for more. For who turns off at a right angle stays a few metres past the
    end for ever, as does who leaves an arc straight on, while the distance to the lane grows: a
    small share of its cost would grow without bound. The states need a ``heading``; angles need no
    unwrapping. Raises ValueError on a route without lanes, or of lanes that do not join.

    Attributes:
        route: lanes in driving order, at least one.
        width: unit of the lateral deviation [m].
        blend: length of the transition between lanes [m].
        offset: where in the lane, to its left [m]; may be unknown.
    """

    route: tuple[Lane, ...]
    width: float = 1.0
    scale: float = 1.0
    heading_scale: float = 1.0
    blend: float = 2.0
    name: str = "lane"
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not self.route:
            raise ValueError("a route needs at least one lane, got none")
        self._check_joints()

    def _check_joints(self) -> None:
        """Each lane ends on the next one, or close to it, as where a car changes its lane."""
        for index, (lane, following) in enumerate(pairwise(self.route)):
            if not isinstance(lane, _KNOWN):
                continue  # only what locates positions is known of it
            end = lane.general().point(lane.length)
            located = following.locate(ca.SX(end))[:2]
            along, beside = (float(ca.evalf(ca.SX(value))) for value in located)
            away = max(abs(beside), -along, along - following.length)
            if away > MOST_GAP:
                raise ValueError(
                    f"lanes {index} and {index + 1} of a route do not join: one ends at "
                    f"({end[0]:.1f}, {end[1]:.1f}), {away:.1f} m away from the next"
                )

    def direction_at(self, position: tuple[float, float]) -> float:
        """Heading [rad] of the lane of the route that is nearest to a position [m]."""
        found = []
        for lane in self.route:
            located = lane.locate(ca.SX(position))
            along, beside, heading = (float(ca.evalf(ca.SX(value))) for value in located)
            outside = max(0.0, -along, along - lane.length)
            found.append((math.hypot(outside, beside), heading))
        return min(found)[1]

    def running_cost(self, stage: Stage) -> ca.SX | float:
        position, heading = stage.position(stage.player), stage.own_state("heading")
        cost: ca.SX | float = 0.0
        reached: ca.SX | float = 1.0  # how much of the car has passed all earlier lanes
        for lane, goes_on in zip(self.route, self._goes_on(), strict=True):
            along, beside, direction = lane.locate(position)
            own = self.scale * ((beside - self.offset) / self.width) ** 2
            own += self.heading_scale * 2 * (1 - ca.cos(heading - direction))
            past = (along - lane.length) * ca.sqrt(1 + (beside / self.blend) ** 2)
            # 1/(1+exp) overflows far away; tanh does not.
            passed = goes_on * (1 + ca.tanh(past / (2 * self.blend))) / 2
            cost += reached * (1 - passed) * own
            reached *= passed
        return cost

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)

    def _goes_on(self) -> tuple[float, ...]:
        """For every lane 1 where another follows, 0 for the last."""
        return (*(1.0 for _ in self.route[1:]), 0.0)

    @property
    def size(self) -> int:
        """Number of lanes."""
        return len(self.route)

    def resized(self, size: int) -> "RouteTable":
        """The same cost as a table of ``size`` lanes, the last repeated; ValueError if too few."""
        spare = size - len(self.route)
        if spare < 0:
            raise ValueError(f"a route of {len(self.route)} lanes does not fit into {size}")
        lanes = tuple(lane.general() if isinstance(lane, _KNOWN) else lane for lane in self.route)
        own = {field.name: getattr(self, field.name) for field in fields(LaneKeeping)}
        own["route"] = (*lanes, *lanes[-1:] * spare)
        return RouteTable(**own, goes_on=(*self._goes_on(), *(0.0,) * spare))


@dataclass(frozen=True)
class RouteTable(LaneKeeping):
    """``LaneKeeping`` as a table of numbers, which has room for a longer route.

    Attributes:
        goes_on: for every lane 1 where another follows, 0 for the last and for those behind it.
    """

    goes_on: tuple[float, ...] = ()

    def _goes_on(self) -> tuple[float, ...]:
        return self.goes_on
