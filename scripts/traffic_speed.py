"""Compare the speed of HighwayEnv with Nash traffic and with IDM traffic.

Usage: python scripts/traffic_speed.py [--steps N] [--rounds R] [--case NAME] [--against SRC]

Prints environment steps per second (processor time, with an idle ego): the median over rounds in
which the kinds of traffic take turns. ``--against`` names the folder ``src`` of another version of
this project, whose Nash traffic is measured too.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Annotated

import shared
import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments

CASES: dict[str, tuple[str, dict]] = {
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


def main(
    steps: int = 60,
    rounds: int = 3,
    case: tuple[Annotated[str, CASES], ...] = (),
    against: Path | None = None,
    one: tuple[str, ...] = (),
) -> None:
    """Print one line per case."""
    if one:
        name, kind = one
        print(_steps_per_second(name, kind, steps))
        return
    kinds = {"IDM": (IDM, SOURCES), "Nash": (NASH, SOURCES)}
    if against:
        kinds["Nash of the other version"] = (NASH, against)
    for name in case or CASES:
        rates: dict[str, list[float]] = {label: [] for label in kinds}
        for _ in range(rounds):
            for label, (kind, sources) in kinds.items():
                rates[label].append(_in_a_process(name, kind, sources, steps))
        text = ", ".join(f"{median(rates[label]):.1f} with {label}" for label in kinds)
        print(f"{name}: steps/s: {text}", flush=True)


def _in_a_process(case: str, kind: str, sources: Path, steps: int) -> float:
    """Steps per second of a version of the project, in a fresh process and on one thread."""
    environment = os.environ | {"PYTHONPATH": str(sources.resolve()), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--steps", str(steps), "--one", case, kind]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def _steps_per_second(case: str, kind: str, steps: int) -> float:
    version, config = CASES[case]
    world = gymnasium.make(version, config={"other_vehicles_type": kind, **config})
    world.reset(seed=0)
    world.step(IDLE)  # the first one builds the solvers
    spent = 0.0
    for step in range(steps):
        begin = time.process_time()
        _, _, terminated, truncated, _ = world.step(IDLE)
        spent += time.process_time() - begin
        if terminated or truncated:
            world.reset(seed=step)
    return steps / spent


if __name__ == "__main__":
    shared.command(main)
