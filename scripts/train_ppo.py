"""Train Stable-Baselines3's PPO as the ego among Nash traffic; needs the extra ``rl``.

Usage: python scripts/train_ppo.py [STEPS [ENVIRONMENT ...]]
"""

import sys
import time

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from olne_bench.envs.traffic import TrafficReport, traffic_report

CONFIGS = {
    "highway-fast-v0": {"vehicles_count": 8},
    "merge-v1": {},
    "roundabout-v1": {},
    "intersection-v2": {"initial_vehicle_count": 5},
}


class _Totals(BaseCallback):
    """Adds up the traffic reports of all episodes."""

    def __init__(self) -> None:
        super().__init__()
        self.roads: dict[int, TrafficReport] = {}

    def _on_step(self) -> bool:
        for world in self.training_env.envs:
            report = traffic_report(world.unwrapped.road)
            self.roads[id(report)] = report
        return True


def main(steps: int, versions: list[str]) -> None:
    """Print one line per environment."""
    for version in versions:
        config = {"other_vehicles_type": "olne_bench.envs.traffic.NashVehicle", **CONFIGS[version]}
        world = gymnasium.make(version, config=config)
        model = PPO("MlpPolicy", world, n_steps=256, batch_size=64, seed=0, device="cpu")
        totals = _Totals()
        begin = time.perf_counter()
        model.learn(steps, callback=totals)
        seconds = time.perf_counter() - begin
        rewards = [episode["r"] for episode in model.ep_info_buffer]
        reports = totals.roads.values()
        print(
            f"{version}: {model.num_timesteps} steps in {seconds:.0f} s, mean return of the last "
            f"{len(rewards)} episodes {np.mean(rewards):.2f}; plans: "
            f"{sum(r.solved for r in reports)} solved, {sum(r.shifted for r in reports)} shifted, "
            f"{sum(r.braked for r in reports)} braked",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3000, sys.argv[2:] or list(CONFIGS))
