"""Train the planner ``ppo`` of studies of drives; needs the extra ``rl``.

Usage: python scripts/train_driver.py [--steps N] [--out FILE]

Stable-Baselines3's PPO drives the ego of ``olne/Drive-v0``: all roads and both kinds of traffic, on
seeds that no study uses. Prints the mean return and the share of collisions of the last episodes,
every tenth of the time, beside those of a driver that only follows its route. Writes the network
to FILE as NumPy arrays.
"""

import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import shared
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from olne_bench.envs.drive.ego_env import EgoEnv

FILE = Path(__file__).parents[1] / "bench" / "judge" / "learned_driver.ppo.npz"
WIDTHS = [64, 64]
SETTINGS: dict[str, Any] = {
    **{"n_steps": 500, "batch_size": 250, "n_epochs": 10, "learning_rate": 5e-4},
    **{"gamma": 0.97, "gae_lambda": 0.95, "ent_coef": 0.0},
}
LAST = 100  # episodes that are told of
CHECKED = 100  # episodes of drivers that do not learn


def main(steps: int = 200_000, out: Path = FILE) -> None:
    """Train, write, and print how it went."""
    torch.set_num_threads(1)
    begin = time.process_time()
    kind = {"net_arch": WIDTHS, "activation_fn": nn.SiLU, "log_std_init": -0.7}
    # Returns of about one: gradients are clipped, and a value far from them would take them all.
    world = VecNormalize(make_vec_env(EgoEnv, 4, seed=0), norm_obs=False, gamma=SETTINGS["gamma"])
    model = PPO("MlpPolicy", world, seed=0, device="cpu", policy_kwargs=kind, **SETTINGS)
    print("steps  episodes  return  collisions", flush=True)
    model.learn(steps, callback=Progress(steps // 10))
    print(f"{steps} steps: {time.process_time() - begin:.0f} s of processor time")
    write(model, out)
    drivers: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "ppo": lambda seen: model.predict(seen, deterministic=True)[0],
        "follows its route": lambda _: np.zeros(2),
    }
    for name, driver in drivers.items():
        returns, crashed = np.array(driven(driver)).T
        error = returns.std(ddof=1) / np.sqrt(len(returns))
        print(
            f"{name}: mean return {returns.mean():.1f} ({error:.1f}), {crashed.mean():.0%} crashed"
        )


class Progress(BaseCallback):
    """Prints a line now and then."""

    def __init__(self, every: int) -> None:
        super().__init__()
        self._every, self._episodes = every, list[tuple[float, float]]()

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self._episodes.append((info["episode"]["r"], info["crashed"]))
        if self.num_timesteps % self._every == 0 and self._episodes:
            mean, crashed = np.mean(self._episodes[-LAST:], axis=0)
            episodes = len(self._episodes)
            print(f"{self.num_timesteps}  {episodes}  {mean:.1f}  {crashed:.0%}", flush=True)
        return True


def write(model: PPO, path: Path) -> None:
    """Write the layers of what acts."""
    linear = [part for part in model.policy.mlp_extractor.policy_net if isinstance(part, nn.Linear)]
    layers = [*linear, model.policy.action_net]
    arrays = {}
    for number, layer in enumerate(layers):
        arrays[f"matrix_{number}"] = layer.weight.detach().numpy()
        arrays[f"offset_{number}"] = layer.bias.detach().numpy()
    for first, second in pairwise(layers):
        assert first.out_features == second.in_features
    np.savez_compressed(path, **arrays)


def driven(driver: Callable[[np.ndarray], np.ndarray]) -> list[tuple[float, bool]]:
    """Return and collision of episodes that nobody was trained on."""
    world, rows = EgoEnv(), []
    for seed in range(CHECKED):
        observation, told = world.reset(seed=1_000_000 + seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, told = world.step(driver(observation))
            total, over = total + reward, terminated or truncated
        rows.append((total, bool(told["crashed"])))
    return rows


if __name__ == "__main__":
    shared.command(main)
