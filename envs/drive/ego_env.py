"""The ego of a drive as an environment of Gymnasium, for drivers that learn."""

from typing import Any

import gymnasium
import numpy as np

from olne_bench.envs.drive.cars import ROADS, STEPS
from olne_bench.envs.drive.costs import EgoCost
from olne_bench.envs.drive.ego_view import LARGEST, SIZE, EgoView
from olne_bench.envs.drive.first_cars import TRAFFIC, NoDriveError
from olne_bench.envs.drive.seen import seen
from olne_bench.envs.drive.world import DriveWorld

#: Seeds of these drives start here: those of studies are smaller.
FIRST_SEED = 10_000_000


class EgoEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A drive of 20 s on a road, in traffic, which are both drawn unless they are named.

    The observation (SIZE,) is ``EgoView.of`` noisy samples; the action (2,) is added to following
    the route (``EgoView.control``). A step is rewarded with less than nothing: with what it costs
    the ego, as a share of what it costs to stand at the start, at most one. A collision ends the
    episode and costs one for each step that is left.
    """

    def __init__(
        self, road: str | None = None, traffic: str | None = None, sigma: float = 0.1
    ) -> None:
        """Nothing is drawn yet.

        Args:
            road: one of ``cars.ROADS``; None draws one for each episode.
            traffic: one of ``world.TRAFFIC``; None draws one.
            sigma: standard deviation of the noise on the others' positions [m].

        Raises:
            ValueError: on an unknown road or traffic.
        """
        for what, given, known in (("road", road, tuple(ROADS)), ("traffic", traffic, TRAFFIC)):
            if given is not None and given not in known:
                raise ValueError(f"unknown {what} {given!r}; known are: {', '.join(known)}")
        self._roads = tuple(ROADS) if road is None else (road,)
        self._traffic = TRAFFIC if traffic is None else (traffic,)
        self._sigma = sigma
        self.observation_space = gymnasium.spaces.Box(-LARGEST, LARGEST, (SIZE,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self._world = self._drawn()
        ego = self._world.cars[0]
        self._view, self._cost = EgoView(ego), EgoCost(ego)
        return self._observed(), {"crashed": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        before = self._world.states()
        control = self._view.control(before[0], np.asarray(action, dtype=float))
        self._world.advance(control)
        reward = -self._cost.share(before, control)
        crashed = self._world.crashed
        if crashed:
            reward -= STEPS - self._world.step
        return self._observed(), reward, crashed, self._world.over and not crashed, self._told()

    def _told(self) -> dict[str, Any]:
        return {"crashed": self._world.crashed}

    def _drawn(self) -> DriveWorld:
        """A drive that can be driven."""
        while True:
            road = str(self.np_random.choice(self._roads))
            traffic = str(self.np_random.choice(self._traffic))
            number = FIRST_SEED + int(self.np_random.integers(10**8))
            try:
                return DriveWorld(road, number, traffic=traffic)
            except NoDriveError:
                continue

    def _observed(self) -> np.ndarray:
        rng = self.np_random
        _, samples = seen(self._world, self._sigma, lambda _: rng)
        return self._view.of(samples)
