"""Clone how players of a scenario drive, for studies of streams; needs the extra ``learned``.

Usage: python scripts/train_policy.py SCENARIO [--draws FILE] [--out FILE] [--steps N]

A network is fitted to the controls of the equilibria that ``train_learned.py`` uses too, by least
absolute errors where they are large and least squares else. What it is shown has errors, as states
and controls that are read off noisy samples have. The truths that are held out are the same. The
same command writes the same file on one machine.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import shared
import numpy as np
import torch
from learned_draws import DRAWS, write_draws
from torch import nn
from tqdm import tqdm
from train_learned import EVERY, HELD_OUT, layer_arrays

from olne_bench.bench.judge.cloned_policy import policy_inputs
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.true_weights import DIRICHLET
from olne_bench.estimators.neural_posterior import game_key
from olne_bench.games.model.game import Game

WIDTH, BATCH, STEPS = 128, 512, 12_000
#: Largest errors of states and last controls that it is shown, in units of their spread.
ERRORS = 0.1, 0.3


def main(
    scenario: Annotated[str, sorted(DRAWS)],
    draws: Path | None = None,
    out: Path | None = None,
    steps: int = STEPS,
) -> None:
    """Draw, train, write, and print the cost and the loss."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    path = draws or Path("runs/learned") / f"{scenario}.npz"
    if not path.exists():
        write_draws(scenario, DRAWS[scenario], path)
    begin, game = time.process_time(), get_scenario(scenario, 0, weights=DIRICHLET).game
    with np.load(path) as file:
        data = Steps.of(game, file["states"])
    network, loss = trained(data, steps)
    out = out or Path("bench/judge") / f"cloned_policy.{scenario}.npz"
    _write(data, network, game, out)
    print(
        f"{scenario}: {len(data.states)} truths, {steps * BATCH} steps of players, "
        f"{time.process_time() - begin:.0f} s of processor time, loss {loss:.4f} held out "
        f"(last controls held: {data.held_loss:.4f}), {out.stat().st_size / 1e3:.0f} kB"
    )


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


def trained(data: Steps, steps: int) -> tuple[nn.Sequential, float]:
    """The network of the least held-out loss, and that loss."""
    rng, length = np.random.default_rng(0), data.states.shape[1]
    held = np.repeat(np.arange(data.held_out), length)
    inputs, after = data.batch(
        held, np.tile(np.arange(length), data.held_out), np.random.default_rng(1)
    )
    network = nn.Sequential(
        nn.Linear(inputs.shape[1], WIDTH),
        nn.SiLU(),
        nn.Linear(WIDTH, WIDTH),
        nn.SiLU(),
        nn.Linear(WIDTH, after.shape[1]),
    )
    optimiser = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    best, least = {k: v.clone() for k, v in network.state_dict().items()}, np.inf
    for step in tqdm(range(1, steps + 1), desc="steps", disable=None, leave=False):
        chosen = rng.integers(data.held_out, len(data.states), BATCH)
        drawn, meant = data.batch(chosen, rng.integers(0, length, BATCH), rng)
        loss = nn.functional.smooth_l1_loss(network(drawn), meant)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % EVERY == 0 or step == steps:
            with torch.no_grad():
                now = float(nn.functional.smooth_l1_loss(network(inputs), after))
            print(f"step {step}: loss {float(loss.detach()):.4f}, held out {now:.4f}", flush=True)
            if now < least:
                best, least = {k: v.clone() for k, v in network.state_dict().items()}, now
    network.load_state_dict(best)
    return network, least


def _write(data: Steps, network: nn.Sequential, game: Game, out: Path) -> None:
    """Write what ``Policy`` reads."""
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        out,
        **layer_arrays(network),
        centre=data.centre.astype(np.float32),
        spread=data.spread.astype(np.float32),
        control_spread=data.control_spread.astype(np.float32),
        game=game_key(game),
    )


if __name__ == "__main__":
    shared.command(main)
