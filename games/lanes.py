"""Lanes as curves that CasADi differentiates, and the feature that keeps a car on them.

A lane gives local coordinates of a position: the distance along its centre line, the distance to it
(positive to the left of the driving direction in a left-handed frame such as HighwayEnv's, whose
y axis points down), and the heading of the lane. A route is a chain of lanes; its cost passes
smoothly from one to the next, because equilibria need second derivatives everywhere.
"""

from dataclasses import dataclass
from typing import Protocol

import casadi as ca

from olne_bench.games.features import Stage


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


@dataclass(frozen=True)
class LaneKeeping:
    """``scale * (beside / width)^2 + heading_scale * 2 (1 - cos(heading - heading of the lane))``.

    Along a route of several lanes the costs of two neighbours are blended by a logistic function
    of the distance along the earlier one, within about ``blend`` metres of its end. The states
    need a ``heading``; angles need no unwrapping.

    Attributes:
        route: lanes in driving order, at least one.
        width: unit of the lateral deviation [m].
        blend: length of the transition between lanes [m].
    """

    route: tuple[Lane, ...]
    width: float = 1.0
    scale: float = 1.0
    heading_scale: float = 1.0
    blend: float = 2.0
    name: str = "lane"

    def __post_init__(self) -> None:
        if not self.route:
            raise ValueError("a route needs at least one lane, got none")

    def running_cost(self, stage: Stage) -> ca.SX | float:
        position, heading = stage.position(stage.player), stage.own_state("heading")
        cost: ca.SX | float = 0.0
        reached: ca.SX | float = 1.0  # how much of the car has passed all earlier lanes
        for index, lane in enumerate(self.route):
            along, beside, direction = lane.locate(position)
            own = self.scale * (beside / self.width) ** 2
            own += self.heading_scale * 2 * (1 - ca.cos(heading - direction))
            passed: ca.SX | float = 0.0
            if index + 1 < len(self.route):
                # 1/(1+exp) overflows far away; tanh does not.
                passed = (1 + ca.tanh((along - lane.length) / (2 * self.blend))) / 2
            cost += reached * (1 - passed) * own
            reached *= passed
        return cost

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)
