"""Steps per second of ``highway_v0`` next to raw HighwayEnv with the same vehicles, interleaved.

The raw environment is ``highway-v0`` as installed, with as many controlled vehicles and no other
ones, under the same actions: once with HighwayEnv's usual observation (Kinematics) and once with
none at all. Usage: python scripts/highway_speed.py [ROUNDS]
"""

import sys
import time
from collections.abc import Callable

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np

from olne_bench.envs import highway_v0
from olne_bench.envs.equilibrium import certified_equilibrium
from olne_bench.envs.highway_roads import MAX_ACCELERATION, POLICY_FREQUENCY, SIMULATION_FREQUENCY
from olne_bench.envs.scenarios import get_scenario

PLAYERS = 5


def raw_environment(observation: dict) -> gymnasium.Env:
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


def _rate(step: Callable, actions: list) -> float:
    begin = time.process_time()
    for action in actions:
        step(action)
    return len(actions) / (time.process_time() - begin)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
