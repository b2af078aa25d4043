"""How fast worlds are next to HighwayEnv's own: processor time, all kinds in turn.

python scripts/world_speed.py road [--rounds 200]
python scripts/world_speed.py traffic [--steps N] [--rounds R] [--case NAME] [--against SRC]
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import shared
import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
from highway_env.envs.common.abstract import AbstractEnv

from olne_bench.envs import highway_v0
from olne_bench.envs.roads import highway_roads
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium

PLAYERS = 5
RESETS = range(1, 6)  # seeds
LIMIT = highway_roads.MAX_ACCELERATION
RAW: dict[str, dict[str, Any]] = {
    "Kinematics": {
        "type": "MultiAgentObservation",
        "observation_config": {"type": "Kinematics"},
    },
    "no observation": {"type": "AttributesObservation", "attributes": []},
}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "highway-fast": ("highway-fast-v0", {}),
    "highway-fast-50": ("highway-fast-v0", {"vehicles_count": 50}),
    "highway": ("highway-v0", {}),
    "highway-dense": ("highway-v0", {"vehicles_count": 20, "vehicles_density": 2}),
    "merge": ("merge-v1", {}),
    "roundabout": ("roundabout-v1", {}),
    "intersection": ("intersection-v2", {}),
}
IDM, NASH = "highway_env.vehicle.behavior.IDMVehicle", "olne_bench.envs.traffic.NashVehicle"
SOURCES = Path(__file__).parents[1] / "src"
IDLE = 1


def rate(step: Callable[[Any], object], actions: list[Any]) -> float:
    """Steps per second."""
    seconds, _ = shared.timed(lambda: [step(action) for action in actions])
    return len(actions) / seconds


def printed_by(words: list[str], sources: Path = SOURCES, **variables: str) -> float:
    """The number that this script prints in a fresh process, with a version of the project."""
    environment = os.environ | variables | {"PYTHONPATH": str(sources.resolve())}
    command = [sys.executable, __file__, *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def road(rounds: int = 200, resets: bool = False) -> None:
    """Compare steps per second of ``highway_v0`` with raw HighwayEnv with the same vehicles.

    The raw environment is the installed ``highway-v0`` with the same number of controlled vehicles,
    no others, and the same actions, once with HighwayEnv's usual observation (Kinematics) and once
    without any. Resets are timed separately: a new seed is drawn and solved; a seed that was played
    before, in this process or another one, is read from disk. ``--resets`` measures these alone.
    """
    if resets:
        print(seconds_per_reset())
        return
    scenario = get_scenario("highway", 0, num_players=PLAYERS)
    controls = certified_equilibrium(scenario).controls
    world = highway_v0.parallel_env(scenario)
    raw = {kind: raw_environment(observation) for kind, observation in RAW.items()}
    rates: dict[str, list[float]] = {"highway_v0": [], **{kind: [] for kind in raw}}
    for _ in range(rounds):
        world.reset()
        actions = [{f"player_{i}": u for i, u in enumerate(row)} for row in controls]
        rates["highway_v0"].append(rate(world.step, actions))
        for kind, environment in raw.items():
            rates[kind].append(raw_rate(environment, scenario, controls))
    ours = median(rates.pop("highway_v0"))
    print(f"highway_v0: {ours:.0f} steps/s, {PLAYERS} vehicles, median of {rounds} episodes")
    for kind, others in rates.items():
        other = median(others)
        print(f"raw highway-env, {kind}: {other:.0f} steps/s, ratio {ours / other:.2f}")
    with tempfile.TemporaryDirectory() as cache:
        for kind in ("solved", "read from disk"):
            seconds = printed_by(["road", "--resets"], OLNE_BENCH_CACHE=f"{cache}/cache")
            steps = len(controls) / (seconds + len(controls) / ours)
            print(f"reset, {kind}: {seconds:.2f} s; with it, {steps:.0f} steps/s")


def raw_environment(observation: dict[str, Any]) -> AbstractEnv:
    """Stock ``highway-v0`` with five controlled vehicles."""
    control = {"type": "ContinuousAction", "acceleration_range": [-LIMIT, LIMIT]}
    config = {
        "simulation_frequency": highway_roads.SIMULATION_FREQUENCY,
        "policy_frequency": highway_roads.POLICY_FREQUENCY,
        "controlled_vehicles": PLAYERS,
        "vehicles_count": 0,
        "action": {"type": "MultiAgentAction", "action_config": control},
        "observation": observation,
        "duration": 1000,
    }
    return gymnasium.make("highway-v0", config=config, disable_env_checker=True).unwrapped


def raw_rate(environment: AbstractEnv, scenario: Scenario, controls: np.ndarray) -> float:
    """Steps per second of one episode."""
    environment.reset(seed=0)
    environment.road.vehicles = environment.controlled_vehicles
    places = zip(environment.controlled_vehicles, scenario.initial_state, strict=True)
    for vehicle, state in places:
        vehicle.position = state[:2].copy()
        vehicle.heading, vehicle.speed = float(state[2]), float(state[3])
    scale = np.array([LIMIT, np.pi / 4])
    return rate(environment.step, [tuple(map(tuple, row[:, ::-1] / scale)) for row in controls])


def seconds_per_reset() -> float:
    """Mean time [s] of one reset to each of a few seeds."""
    world = highway_v0.parallel_env("highway", num_players=PLAYERS)
    world.reset(seed=0)  # imports, and compiles what seeds have in common
    return 1 / rate(lambda seed: world.reset(seed=seed), list(RESETS))


def traffic(
    steps: int = 60,
    rounds: int = 3,
    case: tuple[Annotated[str, CASES], ...] = (),
    against: Path | None = None,
    one: tuple[str, ...] = (),
) -> None:
    """Compare the speed of HighwayEnv with Nash traffic and with IDM traffic.

    Prints environment steps per second (with an idle ego): the median over rounds in which the
    kinds of traffic take turns. ``--against`` names the folder ``src`` of another version of this
    project, whose Nash traffic is measured too. ``--one`` measures a case and a kind alone.
    """
    if one:
        name, kind = one
        print(traffic_rate(name, kind, steps))
        return
    kinds = {"IDM": (IDM, SOURCES), "Nash": (NASH, SOURCES)}
    if against:
        kinds["Nash of the other version"] = (NASH, against)
    for name in case or CASES:
        rates: dict[str, list[float]] = {label: [] for label in kinds}
        for _ in range(rounds):
            for label, (kind, sources) in kinds.items():
                words = ["traffic", "--steps", str(steps), "--one", name, kind]
                rates[label].append(printed_by(words, sources))
        text = ", ".join(f"{median(rates[label]):.1f} with {label}" for label in kinds)
        print(f"{name}: steps/s: {text}", flush=True)


def traffic_rate(case: str, kind: str, steps: int) -> float:
    """Steps per second; resets are not counted."""
    version, config = CASES[case]
    world = gymnasium.make(version, config={"other_vehicles_type": kind, **config})
    world.reset(seed=0)
    world.step(IDLE)  # the first one builds the solvers
    spent = 0.0
    for step in range(steps):
        seconds, (_, _, terminated, truncated, _) = shared.timed(partial(world.step, IDLE))
        spent += seconds
        if terminated or truncated:
            world.reset(seed=step)
    return steps / spent


if __name__ == "__main__":
    shared.command(road, traffic)
