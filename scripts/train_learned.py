"""Train what is learned from equilibria of a scenario; needs the extra ``learned``.

    python scripts/train_learned.py posterior SCENARIO [--draws FILE] [--out FILE] [--steps N]
    python scripts/train_learned.py policy SCENARIO [--draws FILE] [--out FILE] [--steps N]

FILE of the draws is made by ``learned_draws.py`` if it is not there. A twentieth of the truths is
held out: the network that is written is the one with the least loss there. The same command writes
the same file on one machine.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import shared
import numpy as np
import torch
from learned_draws import DRAWS, write_draws
from torch import nn
from tqdm import tqdm

from olne_bench.bench.judge.cloned_policy import policy_inputs
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.true_weights import DIRICHLET
from olne_bench.estimators.neural_posterior import game_key
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.mixture_network import LARGEST_LOG, encoded
from olne_bench.games.model.game import Game
from olne_bench.games.model.weight_prior import FLAT

#: Share of the truths that no step sees, and how often the loss on them is looked at.
HELD_OUT, EVERY = 0.05, 1000

#: Of posteriors: least and largest noise level, width of the layers, number of Gaussians, passes,
#: and steps. Five players at once, 15 numbers, were learnt by heart: the held-out loss rose after
#: 6,000 steps, at 10.7.
SETTINGS = {
    "two_player": ((0.003, 0.2), 224, 8, 1, 40_000),
    "highway_overtaking": ((0.002, 0.1), 192, 6, 5, 20_000),
}
BATCH = 256
#: Noisy observations of each truth that is held out.
REPEATS = 4
#: Of the observations, so many have samples missing at random, and as many end early.
GAPS = 0.2

#: Of policies; the last are the largest errors of states and last controls that they are shown, in
#: units of their spread.
POLICY_WIDTH, POLICY_BATCH, ERRORS = 128, 512, (0.1, 0.3)

Name = Annotated[str, sorted(DRAWS)]


def posterior(
    scenario: Name, draws: Path | None = None, out: Path | None = None, steps: int | None = None
) -> None:
    """Train the network of ``neural_posterior``.

    Noise, noise levels, views and gaps are drawn anew for each batch.
    """
    game, weights, states = prepared(scenario, draws)
    steps, begin = steps or SETTINGS[scenario][4], time.process_time()
    out = out or Path(f"estimators/neural_posterior.{scenario}.npz")
    data = Truths.of(scenario, game, weights, states)
    network, loss = trained_posterior(data, steps)
    sigmas, _, components, passes, _ = SETTINGS[scenario]
    own = {"centre": data.centre, "spread": data.spread}
    size = data.points.shape[1] // passes
    numbers = {"sigmas": np.array(sigmas), "components": components, "size": size, "passes": passes}
    write(out, network, game, own, **numbers)
    print(
        f"{scenario}: {len(data.points)} truths, {steps * BATCH} observations, "
        f"{time.process_time() - begin:.0f} s of processor time, loss {loss:.3f} on "
        f"{len(data.held_out)} truths (prior {data.prior_loss:.3f}), "
        f"{out.stat().st_size / 1e3:.0f} kB"
    )


def policy(
    scenario: Name, draws: Path | None = None, out: Path | None = None, steps: int = 12_000
) -> None:
    """Clone how players drive, for studies of streams.

    A network is fitted to the controls of the equilibria, by least absolute errors where they are
    large and least squares else. What it is shown has errors, as states and controls that are read
    off noisy samples have.
    """
    game, _, states = prepared(scenario, draws)
    begin, out = time.process_time(), out or Path(f"bench/judge/cloned_policy.{scenario}.npz")
    data = Steps.of(game, states)
    network, loss = trained_policy(data, steps)
    names = "centre", "spread", "control_spread"
    write(out, network, game, {name: getattr(data, name) for name in names})
    print(
        f"{scenario}: {len(data.states)} truths, {steps * POLICY_BATCH} steps of players, "
        f"{time.process_time() - begin:.0f} s of processor time, loss {loss:.4f} held out "
        f"(last controls held: {data.held_loss:.4f}), {out.stat().st_size / 1e3:.0f} kB"
    )


def prepared(scenario: str, draws: Path | None) -> tuple[Game, np.ndarray, np.ndarray]:
    """The game, and weights and states of its draws; with a fixed seed, on one thread."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    path = draws or Path("runs/learned") / f"{scenario}.npz"
    if not path.exists():
        write_draws(scenario, DRAWS[scenario], path)
    with np.load(path) as file:
        weights, states = file["weights"], file["states"]
    return get_scenario(scenario, 0, weights=DIRICHLET).game, weights, states


def layers(inputs: int, width: int, hidden: int, outputs: int) -> nn.Sequential:
    """A network."""
    sizes = [inputs, *[width] * hidden]
    parts = [part for a, b in pairwise(sizes) for part in (nn.Linear(a, b), nn.SiLU())]
    return nn.Sequential(*parts, nn.Linear(width, outputs))


def trained(
    network: nn.Sequential,
    steps: int,
    batch_loss: Callable[[], torch.Tensor],
    held_loss: Callable[[], torch.Tensor],
    *,
    decay: float,
    most: float = np.inf,
    shown: tuple[int, int] = (1, 3),
) -> float:
    """Train a network, leave it as it was at its least held-out loss, and return that loss.

    Args:
        network: is changed.
        steps: number of batches.
        batch_loss: loss of the next batch.
        held_loss: loss of what is held out.
        decay: of weights.
        most: norm of gradients beyond which they are scaled down.
        shown: a factor of losses that are printed and returned, and their decimals.
    """
    factor, decimals = shown
    optimiser = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    best, least = {k: v.clone() for k, v in network.state_dict().items()}, np.inf
    for step in tqdm(range(1, steps + 1), desc="steps", disable=None, leave=False):
        loss = batch_loss()
        optimiser.zero_grad()
        loss.backward()
        if np.isfinite(most):
            nn.utils.clip_grad_norm_(network.parameters(), most)
        optimiser.step()
        schedule.step()
        if step % EVERY == 0 or step == steps:
            with torch.no_grad():
                now = factor * float(held_loss())
            said = f"loss {factor * float(loss.detach()):.{decimals}f}, held out {now:.{decimals}f}"
            print(f"step {step}: {said}", flush=True)
            if now < least:
                best, least = {k: v.clone() for k, v in network.state_dict().items()}, now
    network.load_state_dict(best)
    return least


def layer_arrays(network: nn.Sequential) -> dict[str, Any]:
    """What ``small_network`` reads; in half precision, as files are to stay small."""
    arrays = {}
    for k, layer in enumerate(one for one in network if isinstance(one, nn.Linear)):
        arrays[f"matrix_{k}"] = layer.weight.detach().numpy().astype(np.float16)
        arrays[f"offset_{k}"] = layer.bias.detach().numpy().astype(np.float16)
    return arrays


def write(
    out: Path, network: nn.Sequential, game: Game, scales: dict[str, np.ndarray], **numbers: Any
) -> None:
    """Write what ``MixtureNetwork`` or ``Policy`` reads."""
    out.parent.mkdir(parents=True, exist_ok=True)
    single: dict[str, Any] = {name: values.astype(np.float32) for name, values in scales.items()}
    np.savez(out, **layer_arrays(network), **single, **numbers, game=game_key(game))


# -------------------------------------------------------------------------------------- posteriors


@dataclass(frozen=True)
class Truths:
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
    def of(cls, name: str, game: Game, weights: np.ndarray, states: np.ndarray) -> "Truths":
        """Truths with weights (D, N, K)."""
        players, count = weights.shape[1:]
        chart = NormalChart(players, count, Problem.weight_floor, FLAT, game.parameters)
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


def trained_posterior(data: Truths, steps: int) -> tuple[nn.Sequential, float]:
    """The network of the least held-out loss, and that loss."""
    _, width, components, passes, _ = SETTINGS[data.name]
    rng = np.random.default_rng(0)
    held = np.repeat(data.held_out, REPEATS)
    tests = [
        _batch(data, held, np.full(len(held), turn), np.random.default_rng(1))
        for turn in range(passes)
    ]
    inputs, truths = (torch.cat(parts) for parts in zip(*tests, strict=True))
    size = truths.shape[1]
    outputs = components * (1 + 2 * size + size * (size - 1) // 2)
    network = layers(inputs.shape[1], width, 3, outputs)
    with torch.no_grad():  # begins near the prior
        network[-1].weight.mul_(0.1)
    others = np.arange(len(data.held_out), len(data.points))

    def batch_loss() -> torch.Tensor:
        chosen = rng.choice(others, BATCH)
        turns = rng.integers(passes, size=BATCH) if passes > 1 else np.zeros(BATCH, dtype=int)
        drawn, meant = _batch(data, chosen, turns, rng)
        return -log_density(network(drawn), meant, components).mean()

    def held_loss() -> torch.Tensor:
        return -log_density(network(inputs), truths, components).mean()

    shown = passes, 3
    return network, trained(
        network, steps, batch_loss, held_loss, decay=1e-2, most=5.0, shown=shown
    )


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
    data: Truths, chosen: np.ndarray, turns: np.ndarray, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Inputs and points of noisy observations of truths, for turns of players."""
    (low, high), _, _, passes, _ = SETTINGS[data.name]
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


# ---------------------------------------------------------------------------------------- policies


@dataclass(frozen=True)
class Steps:
    """Steps of equilibria, in units of their spread.

    Attributes:
        states: (D, T-1, N, n) before a step.
        controls: (D, T, N, m) zero, then those of the steps.
        centre, spread, control_spread: as of ``Policy``.
    """

    states: np.ndarray
    controls: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    control_spread: np.ndarray

    @classmethod
    def of(cls, game: Game, states: np.ndarray) -> "Steps":
        """Steps of motions (D, T, N, 4) of unicycles, whose controls are differences."""
        controls = np.diff(states[..., 2:], axis=1) / game.dt
        size = np.quantile(np.abs(controls), 0.9, axis=(0, 1)) / 1.6  # of the bulk; tails are long
        centre, spread = states.mean(axis=(0, 1)), states.std(axis=(0, 1))
        before = np.concatenate([np.zeros_like(controls[:, :1]), controls], axis=1)
        return cls((states[:, :-1] - centre) / spread, before / size, centre, spread, size)

    @property
    def held_out(self) -> int:
        """Number of truths that are held out, the first ones."""
        return round(HELD_OUT * len(self.states))

    @property
    def held_loss(self) -> float:
        """Held-out loss of going on with the last controls."""
        before, after = (
            torch.from_numpy(one.reshape(-1))
            for one in (self.controls[: self.held_out, :-1], self.controls[: self.held_out, 1:])
        )
        return float(nn.functional.smooth_l1_loss(before, after))

    def batch(
        self, chosen: np.ndarray, times: np.ndarray, rng: np.random.Generator
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Inputs and next controls, in units of their spread."""
        states, last = self.states[chosen, times], self.controls[chosen, times]
        size = rng.random((len(chosen), 1, 1))
        most, most_last = ERRORS
        states = states + most * size * rng.standard_normal(states.shape)
        last = last + most_last * size * rng.standard_normal(last.shape)
        steps = self.states.shape[1]
        inputs = policy_inputs(states, last, (steps - times) / (steps + 1))
        after = self.controls[chosen, times + 1].reshape(len(chosen), -1)
        return torch.from_numpy(inputs), torch.from_numpy(after.astype(np.float32))


def trained_policy(data: Steps, steps: int) -> tuple[nn.Sequential, float]:
    """The network of the least held-out loss, and that loss."""
    rng, length = np.random.default_rng(0), data.states.shape[1]
    held = np.repeat(np.arange(data.held_out), length)
    inputs, after = data.batch(
        held, np.tile(np.arange(length), data.held_out), np.random.default_rng(1)
    )
    network = layers(inputs.shape[1], POLICY_WIDTH, 2, after.shape[1])

    def batch_loss() -> torch.Tensor:
        chosen = rng.integers(data.held_out, len(data.states), POLICY_BATCH)
        drawn, meant = data.batch(chosen, rng.integers(0, length, POLICY_BATCH), rng)
        return nn.functional.smooth_l1_loss(network(drawn), meant)

    def held_loss() -> torch.Tensor:
        return nn.functional.smooth_l1_loss(network(inputs), after)

    return network, trained(network, steps, batch_loss, held_loss, decay=1e-3, shown=(1, 4))


if __name__ == "__main__":
    shared.command(posterior, policy)
