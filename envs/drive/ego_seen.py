"""Who players take the ego for when they plan. They see where it is, not what it has in mind."""

from dataclasses import replace

import numpy as np
from scipy.special import softmax

from olne_bench.envs.drive.cars import STEP, Car, DriveRoad, drive_game, middle_speed
from olne_bench.envs.roads.road_scenario import with_target
from olne_bench.envs.roads.temperaments import TEMPERAMENTS
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.best_response import best_responses

#: How far [m] an ego of a known kind is from where it is expected after a second: it does not know
#: what the others have in mind.
_SPREAD = 0.5


class EgoSeen:
    """The ego as it is."""

    def car(self, ego: Car, state: np.ndarray) -> Car:
        """Who the others take the ego for, which is in this state (4,)."""
        return ego

    def planned(
        self, ego: Car, others: list[Car], states: np.ndarray, controls: np.ndarray, after: int
    ) -> None:
        """Take the plan of all (T, N, 4), (T-1, N, 2), which counts for so many steps."""


class AverageEgo(EgoSeen):
    """A driver with equal weights and the middle of the road's target speeds."""

    def __init__(self, road: DriveRoad) -> None:
        self._speed = middle_speed(road)

    def car(self, ego: Car, state: np.ndarray) -> Car:
        weights = np.full_like(ego.weights, 1 / len(ego.weights))
        return replace(ego, player=with_target(ego.player, self._speed), weights=weights)


class LearntEgo(EgoSeen):
    """The mean of drivers of three temperaments and speeds, each by how well it explains the way.

    Each of them is expected to respond at its best to what the others plan.
    """

    def __init__(self, road: DriveRoad) -> None:
        low, high = road.family.speeds
        means = [np.array(one) / sum(one) for one in TEMPERAMENTS.values()]
        self._kinds = [(mean, speed) for mean in means for speed in (low, (low + high) / 2, high)]
        self._logs = np.zeros(len(self._kinds))
        self._expected: np.ndarray | None = None  # (H, 2) places when they plan next

    def car(self, ego: Car, state: np.ndarray) -> Car:
        if self._expected is not None:
            away = ((self._expected - state[:2]) ** 2).sum(axis=1)
            self._logs -= np.minimum(away, 100 * _SPREAD**2) / (2 * _SPREAD**2)
        shares = softmax(self._logs)
        weights = shares @ np.stack([mean for mean, _ in self._kinds])
        speed = float(shares @ [speed for _, speed in self._kinds])
        return replace(ego, player=with_target(ego.player, speed), weights=weights)

    def planned(
        self, ego: Car, others: list[Car], states: np.ndarray, controls: np.ndarray, after: int
    ) -> None:
        expected = []
        for weights, speed in self._kinds:
            players = [with_target(ego.player, speed), *(car.player for car in others)]
            game, plans = drive_game(players, len(states)), controls[None, :, 0]
            theta = np.stack([weights, *(car.weights for car in others)])
            found = best_responses(game, 0, plans, states, controls, theta)
            joint = controls[:after].copy()
            if found.converged[0]:
                joint[:, 0] = found.controls[0, :after]
            expected.append(rollout(game.dynamics, states[0], joint, STEP)[-1, 0, :2])
        self._expected = np.array(expected)
