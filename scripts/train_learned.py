"""Train the network of ``neural_posterior`` for a scenario; needs the extra ``learned``.

Usage: python scripts/train_learned.py SCENARIO [--draws FILE] [--out FILE] [--steps N]

FILE of the draws is made by ``learned_draws.py`` if it is not there. Noise, noise levels, views and
gaps are drawn anew for each batch. A twentieth of the truths is held out: the network that is
written is the one with the least loss there. The same command writes the same file on one machine.
"""

import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import shared
import numpy as np
import torch
from learned_draws import DRAWS, write_draws
from torch import nn
from tqdm import tqdm

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.true_weights import DIRICHLET
from olne_bench.estimators.neural_posterior import game_key
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.mixture_network import LARGEST_LOG, encoded

#: Least and largest noise level, width of the layers, number of Gaussians, and passes. Five players
#: at once, 15 numbers, were learnt by heart: the held-out loss rose after 6,000 steps, at 10.7.
SETTINGS = {
    "two_player": ((0.003, 0.2), 224, 8, 1),
    "highway_overtaking": ((0.002, 0.1), 192, 6, 5),
}
BATCH = 256
STEPS = {"two_player": 40_000, "highway_overtaking": 20_000}
#: Share of the truths that no step sees, and how often the loss on them is looked at.
HELD_OUT, EVERY = 0.05, 1000
#: Noisy observations of each of these.
REPEATS = 4
#: Of the observations, so many have samples missing at random, and as many end early.
GAPS = 0.2


def main(
    scenario: Annotated[str, sorted(SETTINGS)],
    draws: Path | None = None,
    out: Path | None = None,
    steps: int | None = None,
) -> None:
    """Draw, train, write, and print the cost and the loss."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    steps = steps or STEPS[scenario]
    draws = draws or Path("runs/learned") / f"{scenario}.npz"
    if not draws.exists():
        write_draws(scenario, DRAWS[scenario], draws)
    begin = time.process_time()
    data = Data.read(scenario, draws)
    network, loss = trained(data, steps)
    out = out or Path("estimators") / f"neural_posterior.{scenario}.npz"
    _write(data, network, out)
    seconds = time.process_time() - begin
    print(
        f"{scenario}: {len(data.points)} truths, {steps * BATCH} observations, "
        f"{seconds:.0f} s of processor time, loss {loss:.3f} on {len(data.held_out)} truths "
        f"(prior {data.prior_loss:.3f}), {out.stat().st_size / 1e3:.0f} kB"
    )


@dataclass(frozen=True)
class Data:
    """Truths of a scenario.

    Attributes:
        name: name of the scenario.
        states: (D, T, N, n) without noise.
        points: (D, N (K-1)) weights in the normal chart.
        held_out: indices of those that are not trained on.
    """

    name: str
    states: np.ndarray
    points: np.ndarray
    held_out: np.ndarray

    @classmethod
    def read(cls, name: str, path: Path) -> "Data":
        """Truths from a file."""
        with np.load(path) as file:
            weights, states = file["weights"], file["states"]
        game = get_scenario(name, 0, weights=DIRICHLET).game
        players, count = weights.shape[1:]
        chart = NormalChart(players, count, Problem.weight_floor, 1.0, game.parameters)
        points = np.array([chart.point(one) for one in weights]).clip(-5, 5)
        return cls(name, states, points, np.arange(round(HELD_OUT * len(points))))

    @property
    def prior_loss(self) -> float:
        """Loss of the standard normal density."""
        held = self.points[self.held_out]
        return float(0.5 * (np.square(held).sum(axis=1) + held.shape[1] * np.log(2 * np.pi)).mean())

    @cached_property
    def centre(self) -> np.ndarray:
        """(T, N, n) mean."""
        return np.asarray(self.states.mean(axis=0))

    @cached_property
    def spread(self) -> np.ndarray:
        """(T, N, n) standard deviation."""
        return np.asarray(self.states.std(axis=0) + 0.02)


def trained(data: Data, steps: int) -> tuple[nn.Sequential, float]:
    """The network of the least held-out loss, and that loss."""
    _, width, components, passes = SETTINGS[data.name]
    rng = np.random.default_rng(0)
    held = np.repeat(data.held_out, REPEATS)
    tests = [
        _batch(data, held, np.full(len(held), turn), np.random.default_rng(1))
        for turn in range(passes)
    ]
    inputs, truths = (torch.cat(parts) for parts in zip(*tests, strict=True))
    size = truths.shape[1]
    network = _network(inputs.shape[1], width, components, size)
    optimiser = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    others = np.arange(len(data.held_out), len(data.points))
    best, least = {k: v.clone() for k, v in network.state_dict().items()}, np.inf
    for step in tqdm(range(1, steps + 1), desc="steps", disable=None, leave=False):
        chosen = rng.choice(others, BATCH)
        turns = rng.integers(passes, size=BATCH) if passes > 1 else np.zeros(BATCH, dtype=int)
        drawn, meant = _batch(data, chosen, turns, rng)
        loss = -log_density(network(drawn), meant, components).mean()
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        if step % EVERY == 0 or step == steps:
            with torch.no_grad():
                now = -passes * float(log_density(network(inputs), truths, components).mean())
            shown = passes * float(loss.detach())
            print(f"step {step}: loss {shown:.3f}, held out {now:.3f}", flush=True)
            if now < least:
                best, least = {k: v.clone() for k, v in network.state_dict().items()}, now
    network.load_state_dict(best)
    return network, least


def _network(inputs: int, width: int, components: int, size: int) -> nn.Sequential:
    outputs = components * (1 + 2 * size + size * (size - 1) // 2)
    network = nn.Sequential(
        nn.Linear(inputs, width),
        nn.SiLU(),
        nn.Linear(width, width),
        nn.SiLU(),
        nn.Linear(width, width),
        nn.SiLU(),
        nn.Linear(width, outputs),
    )
    with torch.no_grad():  # begins near the prior
        network[-1].weight.mul_(0.1)
    return network


def log_density(outputs: torch.Tensor, points: torch.Tensor, components: int) -> torch.Tensor:
    """(B,) logarithms of the mixtures' densities at points (B, D), as of ``MixtureNetwork``."""
    count, size = points.shape
    shapes = [components, components * size, components * size]
    logits, means, logs, rest = outputs.split([*shapes, outputs.shape[1] - sum(shapes)], dim=1)
    logs = logs.reshape(count, components, size).clamp(-LARGEST_LOG, LARGEST_LOG)
    low = np.tril_indices(size, -1)
    triangles = torch.zeros(count, components, size, size)
    triangles[:, :, low[0], low[1]] = rest.reshape(count, components, -1)
    triangles = triangles + torch.diag_embed(logs.exp())
    away = points[:, None, :] - means.reshape(count, components, size)
    errors = (triangles @ away[..., None])[..., 0]
    each = logits.log_softmax(dim=1) + logs.sum(dim=2) - 0.5 * errors.square().sum(dim=2)
    return each.logsumexp(dim=1) - 0.5 * size * float(np.log(2 * np.pi))


def _batch(
    data: Data, chosen: np.ndarray, turns: np.ndarray, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Inputs and points of noisy observations of truths, for turns of players."""
    (low, high), _, _, passes = SETTINGS[data.name]
    low, high = np.log([low, high])
    sigmas = np.exp(rng.uniform(low, high, len(chosen)))
    states = data.states[chosen]
    noise = rng.standard_normal(states.shape, dtype=np.float32)
    seen = states + sigmas[:, None, None, None] * noise
    seen[_missing(states.shape, rng)] = np.nan
    seen[rng.random(len(chosen)) < 0.5, ..., 3] = np.nan  # the paper's partial view has no speed
    inputs = encoded(seen, sigmas, data.centre, data.spread, turns, passes)
    points = data.points[chosen].reshape(len(chosen), passes, -1)[np.arange(len(chosen)), turns]
    return torch.from_numpy(inputs), torch.from_numpy(points.astype(np.float32))


def _missing(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """(B, T, N) which samples are missing: some at random, or all from some time on."""
    count, steps, players = shape[:3]
    kind = rng.random((count, 1, 1))
    share = rng.uniform(0.0, 0.6, (count, 1, 1))
    dropped = (kind < GAPS) & (rng.random((count, steps, players)) < share)
    last = rng.integers(1, steps + 1, (count, 1, 1))
    ended = (kind > 1 - GAPS) & (np.arange(steps)[None, :, None] >= last)
    return np.asarray(dropped | ended)


def layer_arrays(network: nn.Sequential) -> dict[str, Any]:
    """What ``small_network`` reads; in half precision, as files are to stay small."""
    arrays = {}
    for k, layer in enumerate(one for one in network if isinstance(one, nn.Linear)):
        arrays[f"matrix_{k}"] = layer.weight.detach().numpy().astype(np.float16)
        arrays[f"offset_{k}"] = layer.bias.detach().numpy().astype(np.float16)
    return arrays


def _write(data: Data, network: nn.Sequential, out: Path) -> None:
    """Write what ``MixtureNetwork`` reads."""
    game = get_scenario(data.name, 0, weights=DIRICHLET).game
    sigmas, _, components, passes = SETTINGS[data.name]
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        out,
        **layer_arrays(network),
        centre=data.centre.astype(np.float32),
        spread=data.spread.astype(np.float32),
        sigmas=np.array(sigmas),
        components=components,
        size=data.points.shape[1] // passes,
        passes=passes,
        game=game_key(game),
    )


if __name__ == "__main__":
    shared.command(main)
