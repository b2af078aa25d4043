"""What a drive costs the ego, by its own true features and weights.

A car that is far away counts as nothing, so that it does not matter how many there are: proximity
is counted from where a car is ``RANGE`` lengths ahead. The unit is what a step costs an ego that
stands at its start, alone. What the ego has hit stays hit: after a collision each step costs one,
and no step costs more, so that drives count alike whatever the weights and the road.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from olne_bench.envs.drive.cars import MOTION, STEP, STEPS, Car
from olne_bench.games.model.costs import CarProximity, Feature, Stage

#: Lengths ahead, or widths beside, from which on another car counts as nothing.
RANGE = 5.0


class EgoCost:
    """The cost of single steps of an ego."""

    def __init__(self, ego: Car) -> None:
        (near,) = (one for one in ego.player.preferences if isinstance(one, CarProximity))
        self._weights, self._near = ego.weights, near
        self._proximity = _function(near, players=2)
        self._own = [
            None if feature is near else _function(feature, players=1)
            for feature in ego.player.features
        ]
        stands = ego.start.copy()
        stands[3] = 0.0
        self._standing = self.of_step(stands[None], np.zeros(2))

    def of_step(self, states: np.ndarray, control: np.ndarray) -> float:
        """Cost of a step.

        Args:
            states: (N, 4), the ego first.
            control: (2,) of the ego.
        """
        values = [
            self._proximities(states) if one is None else float(one(states[:1].T, control))
            for one in self._own
        ]
        count = len(self._weights)
        task = sum(values[count:]) * self._weights.mean()
        return float(self._weights @ np.array(values[:count]) + task)

    def share(self, states: np.ndarray, control: np.ndarray) -> float:
        """Cost of a step as a share of that of standing at the start, at most 1."""
        return min(self.of_step(states, control) / self._standing, 1.0)

    def of_drive(
        self, motion: Sequence[np.ndarray], controls: Sequence[np.ndarray], crashed: bool
    ) -> float:
        """Mean share of the steps of a whole drive, 0 to 1.

        Args:
            motion: states (N, 4) at each step, the ego first; the last ones are those at the end.
            controls: (2,) of each step.
            crashed: whether the drive ended in a collision.
        """
        costs = [
            self.share(states, control)
            for states, control in zip(motion[:-1], controls, strict=True)
        ]
        if crashed:
            costs += [1.0] * (STEPS - len(costs))
        return float(np.mean(costs))

    def _proximities(self, states: np.ndarray) -> float:
        far = -self._near.scale * np.log(RANGE**2 + self._near.offset)
        found = [
            float(self._proximity(np.stack([states[0], other]).T, np.zeros(2)))
            for other in states[1:]
        ]
        return float(np.maximum(np.array(found) - far, 0.0).sum())


def _function(feature: Feature, players: int) -> ca.Function:
    """``(states (4, players), control (2,)) -> running cost`` of player 0."""
    states = ca.SX.sym("states", MOTION.state_size, players)
    control = ca.SX.sym("control", MOTION.control_size)
    stage = Stage(0, tuple(ca.horzsplit(states)), control, MOTION, STEP)
    return ca.Function("cost", [states, control], [ca.SX(feature.running_cost(stage))])
