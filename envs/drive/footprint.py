"""Cars that stay out of each other, as a hard constraint of a game."""

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.games.model.costs import Stage

#: A car is inside two circles, in the middles of its front and its rear half.
_OFFSET = Vehicle.LENGTH / 4
_RADIUS = float(np.hypot(Vehicle.LENGTH / 4, Vehicle.WIDTH / 2))
_SHARPNESS = 8  # of the smooth minimum
_LEAST = 1e-6  # squared distance [m^2]: the margin has a slope where middles coincide


@dataclass(frozen=True)
class CarsApart:
    """The circles around two cars do not overlap: 3.2 m between middles of halves.

    So cars in a lane are 5.7 m apart and cars side by side 3.2 m, while lanes are 4 m wide. The
    margin is ``(s - d^2) / (2 d)`` [m] with the distance d that circles need and a smooth minimum s
    of the four squared distances, which is smaller than all of them: by 8 % where two are equal.

    Attributes:
        players: whose cars.
        first_step: from which on they keep apart.
        more: distance between the circles [m].
    """

    players: tuple[int, int]
    first_step: int = 0
    more: float = 0.0
    name: str = "cars apart"

    def margins(self, stage: Stage) -> ca.SX:
        one, other = (_middles(stage, player) for player in (0, 1))
        squares = [ca.sumsqr(a - b) + _LEAST for a, b in product(one, other)]
        powers = sum(square**-_SHARPNESS for square in squares)
        apart = 2 * _RADIUS + self.more
        return (powers ** (-1 / _SHARPNESS) - apart**2) / (2 * apart)


def _middles(stage: Stage, player: int) -> list[ca.SX]:
    """Middles (2,) of the front and the rear half of a car [m]."""
    heading = stage.states[player][stage.dynamics.state_names.index("heading")]
    ahead = _OFFSET * ca.vertcat(ca.cos(heading), ca.sin(heading))
    return [stage.position(player) + ahead, stage.position(player) - ahead]
