"""Train Stable-Baselines3's PPO as the ego among Nash traffic; needs the extra ``rl``.

Usage: python scripts/train_ppo.py [--id ID] [--steps N] [--seeds N] [--out DIR]

Trains one agent per seed. Then evaluates the agents, drivers that repeat one action ("always
IDLE") and a random driver on episodes that no agent was trained on. Writes into DIR:
``episodes.csv`` (all training episodes), ``evaluation.csv`` (all evaluation episodes),
``learning_curve.png`` and ``ppo_SEED.zip``.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from highway_env.envs.common.action import DiscreteMetaAction
from scipy import stats
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor

import olne_bench.envs  # noqa: F401  registers the ids

HELD_OUT = 10_000  # first seed of the evaluation episodes, which are not trained on
BINS = 10  # points of the learning curve


def main() -> None:
    """Train, evaluate, write, draw, and print one line per driver."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--id", default="olne/NashMerge-v0")
    parser.add_argument("--steps", type=int, default=1024, help="environment steps per agent")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--evaluations", type=int, default=20, help="episodes per driver")
    parser.add_argument("--out", type=Path, default=Path("runs/rl"))
    given = parser.parse_args()
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)

    def make() -> gymnasium.Env:
        return gymnasium.make(given.id)

    begin, training, driven = time.process_time(), [], []
    for seed in range(given.seeds):
        model, episodes = _train(make, seed, given.steps)
        model.save(given.out / f"ppo_{seed}.zip")
        training.append(episodes.assign(seed=seed))
        driven.append(
            _drive(make, _greedy(model), given.evaluations).assign(driver=f"PPO, seed {seed}")
        )
    print(f"training and driving: {time.process_time() - begin:.0f} s of processor time")
    actions = make().action_space
    actions.seed(0)
    for action, name in DiscreteMetaAction.ACTIONS_ALL.items():
        rows = _drive(make, _always(action), given.evaluations)
        driven.append(rows.assign(driver=f"always {name}"))
    random = _drive(make, lambda _: actions.sample(), given.evaluations)
    driven.append(random.assign(driver="random"))
    episodes, evaluation = pd.concat(training), pd.concat(driven)
    episodes.to_csv(given.out / "episodes.csv", index=False, float_format="%.4f")
    evaluation.to_csv(given.out / "evaluation.csv", index=False, float_format="%.4f")
    _draw(episodes, evaluation, given)
    for name, rows in evaluation.groupby("driver", sort=False):
        print(
            f"{name!s}: mean return {rows['return'].mean():.2f} "
            f"({_standard_error(rows['return']):.2f}), {rows['crashed'].mean():.0%} crashed"
        )


def _always(action: int) -> Callable[[np.ndarray], int]:
    return lambda _: action


def _greedy(model: PPO) -> Callable[[np.ndarray], int]:
    return lambda observation: int(model.predict(observation, deterministic=True)[0])


class _Episodes(BaseCallback):
    """Keep the return, length and outcome of each training episode."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[dict[str, float]] = []

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.rows.append(
                    {
                        "step": self.num_timesteps,
                        "return": info["episode"]["r"],
                        "length": info["episode"]["l"],
                        "crashed": info["crashed"],
                    }
                )
        return True


def _train(make: Callable[[], gymnasium.Env], seed: int, steps: int) -> tuple[PPO, pd.DataFrame]:
    """PPO with the settings of HighwayEnv's own example, in one process."""
    model = PPO(
        "MlpPolicy",
        Monitor(make()),
        n_steps=256,
        batch_size=64,
        n_epochs=10,
        learning_rate=5e-4,
        gamma=0.8,
        seed=seed,
        device="cpu",
    )
    episodes = _Episodes()
    model.learn(steps, callback=episodes)
    return model, pd.DataFrame(episodes.rows)


def _drive(
    make: Callable[[], gymnasium.Env], driver: Callable[[np.ndarray], int], count: int
) -> pd.DataFrame:
    """One row for each held-out episode."""
    world, rows = make(), []
    for seed in range(HELD_OUT, HELD_OUT + count):
        observation, _ = world.reset(seed=seed)
        total, length, over = 0.0, 0, False
        while not over:
            observation, reward, terminated, truncated, info = world.step(driver(observation))
            total, length, over = total + float(reward), length + 1, terminated or truncated
        rows.append({"seed": seed, "return": total, "length": length, "crashed": info["crashed"]})
    return pd.DataFrame(rows)


def _standard_error(values: pd.Series) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def _draw(episodes: pd.DataFrame, evaluation: pd.DataFrame, given: argparse.Namespace) -> None:
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
    axes.set(
        xlabel="environment steps of one agent",
        ylabel="return of an episode",
        title=given.id,
    )
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(given.out / "learning_curve.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
