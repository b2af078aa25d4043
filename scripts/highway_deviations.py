"""Try a thousand random deviations of single players per scenario, through the public API.

Prints the largest gain over the OLNE, as a multiple of the certificate's tolerance; it must be at
most 1. Usage: python scripts/highway_deviations.py [TRIALS [FAMILY ...]]
"""

import sys

import numpy as np

from olne_bench.envs import highway_v0
from olne_bench.envs.equilibrium import certified_equilibrium
from olne_bench.envs.highway_roads import ROAD_NAMES
from olne_bench.envs.scenarios import get_scenario

#: Units of steering [rad] and acceleration [m/s^2]; 1 mrad moves a fast car by half a metre.
UNITS = np.array([0.01, 1.0])


def play(world: highway_v0.HighwayWorld, player: str, offsets: np.ndarray) -> tuple[float, bool]:
    """A player's return if it deviates by offsets (T-1, 2), and whether the game was completed."""
    _, infos = world.reset()
    total = 0.0
    for offset in offsets:
        actions = {p: infos[p]["olne_action"] for p in world.agents}
        actions[player] = actions[player] + offset
        _, rewards, terminated, _, infos = world.step(actions)
        total += rewards[player]
        if terminated[player]:
            break
    return total, not world.agents


def main(trials: int, families: list[str]) -> None:
    """Print one line per family."""
    for name in families:
        scenario = get_scenario(name, 0, num_players=3)
        certificate = certified_equilibrium(scenario).certificate
        world = highway_v0.parallel_env(scenario)
        rng = np.random.default_rng(0)
        gains, whole = [], 0
        for trial in range(trials):
            index = trial % scenario.game.num_players
            shape = (scenario.game.horizon - 1, 2)
            offsets = 10 ** rng.uniform(-4, -1) * rng.standard_normal(shape) * UNITS
            total, came_through = play(world, f"player_{index}", offsets)
            cost = certificate.costs[index]
            gains.append((total + cost) / (certificate.tolerance * (1 + abs(cost))))
            whole += came_through
        print(
            f"{name}: {trials} deviations, largest gain {max(gains):.2g} tolerances, "
            f"median {np.median(gains):.2g}; {whole} played to the end",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000, sys.argv[2:] or list(ROAD_NAMES))
