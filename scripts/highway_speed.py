"""Compare steps per second of ``highway_v0`` with raw HighwayEnv with the same vehicles.

The raw environment is the installed ``highway-v0`` with the same number of controlled vehicles, no
others, and the same actions, once with HighwayEnv's usual observation (Kinematics) and once without
any. The measurements are interleaved. Resets are timed separately: a new seed is drawn and solved;
a seed that was played before, in this process or another one, is read from disk.
Usage: python scripts/highway_speed.py [ROUNDS]
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
from highway_env.envs.common.abstract import AbstractEnv

from olne_bench.envs import highway_v0
from olne_bench.envs.roads.highway_roads import (
    MAX_ACCELERATION,
    POLICY_FREQUENCY,
    SIMULATION_FREQUENCY,
)
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium

PLAYERS = 5
RESETS = range(1, 6)  # seeds


def raw_environment(observation: dict) -> AbstractEnv:
    """Stock ``highway-v0`` with five controlled vehicles."""
    limits = [-MAX_ACCELERATION, MAX_ACCELERATION]
    control = {"type": "ContinuousAction", "acceleration_range": limits}
    config = {
        "simulation_frequency": SIMULATION_FREQUENCY,
        "policy_frequency": POLICY_FREQUENCY,
        "controlled_vehicles": PLAYERS,
        "vehicles_count": 0,
        "action": {"type": "MultiAgentAction", "action_config": control},
        "observation": observation,
        "duration": 1000,
    }
    return gymnasium.make("highway-v0", config=config, disable_env_checker=True).unwrapped


def main(rounds: int) -> None:
    """Print the medians over rounds of one episode each, and their ratios."""
    scenario = get_scenario("highway", 0, num_players=PLAYERS)
    controls = certified_equilibrium(scenario).controls
    world = highway_v0.parallel_env(scenario)
    kinematics = {"type": "Kinematics"}
    raw = {
        "Kinematics": raw_environment(
            {"type": "MultiAgentObservation", "observation_config": kinematics}
        ),
        "no observation": raw_environment({"type": "AttributesObservation", "attributes": []}),
    }

    def play_world() -> float:
        world.reset()
        actions = [{f"player_{i}": u for i, u in enumerate(row)} for row in controls]
        return _rate(world.step, actions)

    def play_raw(kind: str) -> float:
        environment = raw[kind]
        environment.reset(seed=0)
        environment.road.vehicles = environment.controlled_vehicles
        for vehicle, state in zip(
            environment.controlled_vehicles, scenario.initial_state, strict=True
        ):
            vehicle.position = state[:2].copy()
            vehicle.heading, vehicle.speed = float(state[2]), float(state[3])
        scale = np.array([MAX_ACCELERATION, np.pi / 4])
        actions = [tuple(map(tuple, row[:, ::-1] / scale)) for row in controls]
        return _rate(environment.step, actions)

    rates: dict[str, list[float]] = {"highway_v0": [], **{kind: [] for kind in raw}}
    for _ in range(rounds):
        rates["highway_v0"].append(play_world())
        for kind in raw:
            rates[kind].append(play_raw(kind))
    ours = np.median(rates["highway_v0"])
    print(f"highway_v0: {ours:.0f} steps/s, {PLAYERS} vehicles, median of {rounds} episodes")
    for kind in raw:
        other = np.median(rates[kind])
        print(f"raw highway-env, {kind}: {other:.0f} steps/s, ratio {ours / other:.2f}")

    steps = len(controls)
    for kind, seconds in zip(("solved", "read from disk"), reset_seconds(), strict=True):
        rate = steps / (seconds + steps / ours)
        print(f"reset, {kind}: {seconds:.2f} s; with it, {rate:.0f} steps/s")


def reset_seconds() -> list[float]:
    """Mean time of a reset [s]: for new seeds, and for the same seeds in another process."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"OLNE_BENCH_CACHE": f"{folder}/cache"}
        command = [sys.executable, __file__, "--resets"]
        return [
            float(subprocess.run(command, env=environment, check=True, capture_output=True).stdout)
            for _ in range(2)
        ]


def time_resets() -> None:
    """Print the mean time [s] of one reset to each of a few seeds."""
    world = highway_v0.parallel_env("highway", num_players=PLAYERS)
    world.reset(seed=0)  # imports, and compiles what seeds have in common
    begin = time.process_time()
    for seed in RESETS:
        world.reset(seed=seed)
    print((time.process_time() - begin) / len(RESETS))


def _rate(step: Callable, actions: list) -> float:
    begin = time.process_time()
    for action in actions:
        step(action)
    return len(actions) / (time.process_time() - begin)


if __name__ == "__main__":
    if sys.argv[1:] == ["--resets"]:
        time_resets()
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
