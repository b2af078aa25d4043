"""A driver that has learned by trial and error (PPO), for the ego of a drive; it knows no game.

``scripts/train_ppo.py driver`` trained it in ``envs.drive.ego_env`` and wrote the file beside this.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np

from olne_bench.envs.drive.cars import Car
from olne_bench.envs.drive.ego_env import EgoView
from olne_bench.estimators.shared.small_network import Layers, layers_of, output


class LearnedDriver:
    """Drives one ego."""

    def __init__(self, ego: Car) -> None:
        self._view = EgoView(ego)

    def control(self, samples: np.ndarray) -> np.ndarray:
        """Steering [rad] and acceleration [m/s^2] (2,); samples are (1 + M, 4), the ego first."""
        action = output(_network(), self._view.of(samples))
        return self._view.control(samples[0], action)


@lru_cache(maxsize=1)
def _network() -> Layers:
    with np.load(Path(__file__).with_suffix(".ppo.npz"), allow_pickle=False) as file:
        return layers_of(file)
