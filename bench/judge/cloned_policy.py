"""Behaviour cloning: a network that drives on as players of the simulator did.

It maps what all players do now to what they do next, and knows neither weights nor costs. It was
fitted to the controls of the equilibria that ``neural_posterior`` was trained on. There is one for
each known game, in a file beside this one; ``scripts/train_learned.py policy`` trains it.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from olne_bench.estimators.neural_posterior import game_key
from olne_bench.estimators.shared.small_network import Layers, layers_of, output
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game

#: Inputs and outputs beyond so many of their spreads do not occur in training.
FARTHEST = 12.0


@dataclass(frozen=True)
class Policy:
    """A trained policy of all players of a game."""

    layers: Layers
    centre: np.ndarray  # (N, n) mean of the states over training
    spread: np.ndarray  # (N, n) their standard deviation
    control_spread: np.ndarray  # (N, m) size of the controls
    game: str  # identifies the game that it was trained for

    @classmethod
    def read(cls, path: Path) -> "Policy":
        """A policy that was written by the script that trains it."""
        with np.load(path, allow_pickle=False) as file:
            return cls(
                layers=layers_of(file),
                centre=file["centre"],
                spread=file["spread"],
                control_spread=file["control_spread"],
                game=str(file["game"]),
            )

    def controls(self, states: np.ndarray, controls: np.ndarray, left: float) -> np.ndarray:
        """The next controls (N, m); ``left`` is the share of the horizon that is left."""
        given = policy_inputs(
            ((states - self.centre) / self.spread)[None],
            (controls / self.control_spread)[None],
            np.array([left]),
        )[0]
        found = output(self.layers, given).clip(-FARTHEST, FARTHEST)
        return np.asarray(found.reshape(controls.shape) * self.control_spread)


def policy_inputs(states: np.ndarray, controls: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Inputs (B, I) of the network.

    States (B, N, n) and the last controls (B, N, m) are in units of their spread; ``left`` (B,) is
    the share of the horizon that is left.
    """
    flat = [one.reshape(len(one), -1).clip(-FARTHEST, FARTHEST) for one in (states, controls)]
    return np.concatenate([*flat, left[:, None]], axis=1, dtype=np.float32)


def policy_of(game: Game) -> Policy | None:
    """The policy of a game; None where none was trained."""
    return _policies().get(game_key(game))


@lru_cache(maxsize=1)
def _policies() -> dict[str, Policy]:
    here = Path(__file__)
    policies = [Policy.read(path) for path in here.parent.glob(f"{here.stem}.*.npz")]
    return {policy.game: policy for policy in policies}


def driven(
    policy: Policy, game: Game, states: np.ndarray, controls: np.ndarray, steps: int
) -> np.ndarray:
    """States (steps + 1, N, n) from states (N, n) on; controls (N, m) are of the last step."""
    found = [states]
    for left in range(steps, 0, -1):
        controls = policy.controls(found[-1], controls, left / game.horizon)
        found.append(rollout(game.dynamics, found[-1], controls[None], game.dt)[-1])
    return np.array(found)
