"""Train Stable-Baselines3's PPO as the ego; needs the extra ``rl``.

python scripts/train_ppo.py traffic [--id ID] [--steps N] [--seeds N] [--out DIR]
python scripts/train_ppo.py driver [--steps N] [--out FILE]
"""

import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import shared
import gymnasium
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from highway_env.envs.common.action import DiscreteMetaAction
from matplotlib.figure import Figure
from scipy import stats
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

import olne_bench.envs  # noqa: F401  registers the ids
from olne_bench.envs.drive.ego_env import EgoEnv

#: First seeds of episodes that nobody is trained on.
HELD_OUT, HELD_OUT_DRIVES = 10_000, 1_000_000
BINS = 10  # points of the learning curve
FILE = Path(__file__).parents[1] / "bench" / "judge" / "learned_driver.ppo.npz"
DRIVER: dict[str, Any] = {
    **{"n_steps": 500, "batch_size": 250, "n_epochs": 10, "learning_rate": 5e-4},
    **{"gamma": 0.97, "gae_lambda": 0.95, "ent_coef": 0.0},
}
#: PPO's settings of HighwayEnv's own example.
TRAFFIC: dict[str, Any] = {
    **{"n_steps": 256, "batch_size": 64, "n_epochs": 10, "learning_rate": 5e-4, "gamma": 0.8}
}
LAST = 100  # episodes that are told of
CHECKED = 100  # drives of drivers that do not learn

Driver = Callable[[np.ndarray], Any]


class Episodes(BaseCallback):
    """Keeps return, length and outcome of each training episode, and prints a line now and then."""

    def __init__(self, every: int = 0) -> None:
        super().__init__()
        self.rows: list[dict[str, float]] = []
        self._every = every

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                row = {"step": self.num_timesteps, "return": info["episode"]["r"]}
                row |= {"length": info["episode"]["l"], "crashed": info["crashed"]}
                self.rows.append(row)
        if self._every and self.num_timesteps % self._every == 0 and self.rows:
            last = pd.DataFrame(self.rows[-LAST:])
            mean, crashed = last["return"].mean(), last["crashed"].mean()
            said = f"{self.num_timesteps}  {len(self.rows)}  {mean:.1f}  {crashed:.0%}"
            print(said, flush=True)
        return True


def driven(world: gymnasium.Env, driver: Driver, first: int, count: int) -> pd.DataFrame:
    """One row for each held-out episode."""
    rows = []
    for seed in range(first, first + count):
        observation, _ = world.reset(seed=seed)
        total, length, over = 0.0, 0, False
        while not over:
            observation, reward, terminated, truncated, info = world.step(driver(observation))
            total, length, over = total + float(reward), length + 1, terminated or truncated
        rows.append({"seed": seed, "return": total, "length": length, "crashed": info["crashed"]})
    return pd.DataFrame(rows)


def say(name: str, rows: pd.DataFrame, decimals: int) -> None:
    """Mean return with its standard error, and the share of collisions."""
    returns = rows["return"]
    error = returns.std(ddof=1) / np.sqrt(len(returns))
    numbers = f"{returns.mean():.{decimals}f} ({error:.{decimals}f})"
    print(f"{name}: mean return {numbers}, {rows['crashed'].mean():.0%} crashed")


def greedy(model: PPO, kind: Callable[[Any], Any] = np.asarray) -> Driver:
    """The driver that does what a model thinks best, as an action of a kind."""
    return lambda observation: kind(model.predict(observation, deterministic=True)[0])


def always(action: int) -> Driver:
    """The driver that repeats one action."""
    return lambda _: action


def traffic(
    id: str = "olne/NashMerge-v0",  # noqa: A002  as Gymnasium calls it
    steps: int = 1024,
    seeds: int = 3,
    evaluations: int = 20,
    out: Path = Path("runs/rl"),
) -> None:
    """Train PPO among Nash traffic, an agent for each seed.

    Then evaluates the agents, drivers that repeat one action ("always IDLE") and a random driver on
    episodes that no agent was trained on. Writes into the folder ``--out``: ``episodes.csv`` (all
    training episodes), ``evaluation.csv`` (all evaluation episodes), ``learning_curve.png`` and
    ``ppo_SEED.zip``. ``--steps`` are of each agent, ``--evaluations`` episodes of each driver.
    """
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    begin, training, rows = time.process_time(), [], []

    def drive(name: str, driver: Driver) -> None:
        found = driven(gymnasium.make(id), driver, HELD_OUT, evaluations)
        rows.append(found.assign(driver=name))

    for seed in range(seeds):
        world = Monitor(gymnasium.make(id))
        model, seen = PPO("MlpPolicy", world, seed=seed, device="cpu", **TRAFFIC), Episodes()
        model.learn(steps, callback=seen)
        model.save(out / f"ppo_{seed}.zip")
        training.append(pd.DataFrame(seen.rows).assign(seed=seed))
        drive(f"PPO, seed {seed}", greedy(model, int))
    print(f"training and driving: {time.process_time() - begin:.0f} s of processor time")
    actions = gymnasium.make(id).action_space
    actions.seed(0)
    for action, name in DiscreteMetaAction.ACTIONS_ALL.items():
        drive(f"always {name}", always(action))
    drive("random", lambda _: actions.sample())
    episodes, evaluation = pd.concat(training), pd.concat(rows)
    episodes.to_csv(out / "episodes.csv", index=False, float_format="%.4f")
    evaluation.to_csv(out / "evaluation.csv", index=False, float_format="%.4f")
    figure = learning_curve(episodes, evaluation, id)
    figure.savefig(out / "learning_curve.png", dpi=110)
    for name, own in evaluation.groupby("driver", sort=False):
        say(str(name), own, 2)


def learning_curve(episodes: pd.DataFrame, evaluation: pd.DataFrame, title: str) -> Figure:
    """Draw the mean over seeds with Student's 95 % interval, and each seed as a thin line."""
    edges = np.linspace(0, episodes["step"].max(), BINS + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    steps = pd.cut(episodes["step"], edges.tolist(), labels=middles.tolist())
    binned = episodes.assign(step=steps.astype(float))
    curves = binned.pivot_table("return", "step", "seed")
    x, mean, count = curves.index, curves.mean(axis=1), curves.shape[1]
    half = stats.t.ppf(0.975, count - 1) * curves.std(axis=1, ddof=1) / np.sqrt(count)
    figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
    axes.plot(x, curves, color="tab:blue", alpha=0.35, linewidth=0.8)
    axes.plot(x, mean, color="tab:blue", marker="o", label=f"PPO while it learns, {count} seeds")
    axes.fill_between(x, mean - half, mean + half, color="tab:blue", alpha=0.15, linewidth=0)
    levels = evaluation.groupby("driver")["return"].mean()
    best = str(levels[levels.index.str.startswith("always")].idxmax())
    for driver, style in ((best, "-."), ("always IDLE", "--"), ("random", ":")):
        axes.axhline(levels[driver], color="black", linestyle=style, linewidth=1, label=driver)
    axes.set(xlabel="environment steps of one agent", ylabel="return of an episode", title=title)
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def driver(steps: int = 200_000, out: Path = FILE) -> None:
    """Train the planner ``ppo`` of studies of drives.

    PPO drives the ego of ``olne/Drive-v0``: all roads and both kinds of traffic, on seeds that no
    study uses. Prints the mean return and the share of collisions of the last episodes, every tenth
    of the time, and at the end beside those of a driver that only follows its route. Writes the
    network as NumPy arrays.
    """
    torch.set_num_threads(1)
    begin = time.process_time()
    kind = {"net_arch": [64, 64], "activation_fn": nn.SiLU, "log_std_init": -0.7}
    # Returns of about one: gradients are clipped, and a value far from them would take them all.
    world = VecNormalize(make_vec_env(EgoEnv, 4, seed=0), norm_obs=False, gamma=DRIVER["gamma"])
    model = PPO("MlpPolicy", world, seed=0, device="cpu", policy_kwargs=kind, **DRIVER)
    print("steps  episodes  return  collisions", flush=True)
    model.learn(steps, callback=Episodes(steps // 10))
    print(f"{steps} steps: {time.process_time() - begin:.0f} s of processor time")
    write(model, out)
    own = {"ppo": greedy(model), "follows its route": lambda _: np.zeros(2)}
    for name, one in own.items():
        say(name, driven(EgoEnv(), one, HELD_OUT_DRIVES, CHECKED), 1)


def write(model: PPO, path: Path) -> None:
    """Write the layers of what acts."""
    linear = [part for part in model.policy.mlp_extractor.policy_net if isinstance(part, nn.Linear)]
    layers = [*linear, model.policy.action_net]
    arrays = {}
    for number, layer in enumerate(layers):
        arrays[f"matrix_{number}"] = layer.weight.detach().numpy()
        arrays[f"offset_{number}"] = layer.bias.detach().numpy()
    assert all(first.out_features == second.in_features for first, second in pairwise(layers))
    np.savez_compressed(path, **arrays)


if __name__ == "__main__":
    shared.command(traffic, driver)
