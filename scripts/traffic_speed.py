"""HighwayEnv with Nash traffic next to the same environments with IDM traffic.

Prints environment steps per second (processor time, an idle ego) and the median time of a re-plan
by number of players. Usage: python scripts/traffic_speed.py [STEPS]
"""

import sys
import time

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np

from olne_bench.envs.traffic import traffic_report

CASES: dict[str, tuple[str, dict]] = {
    "highway-v0": ("highway-v0", {}),
    "highway-v0, 20 vehicles, dense": (
        "highway-v0",
        {"vehicles_count": 20, "vehicles_density": 2},
    ),
    "highway-fast-v0": ("highway-fast-v0", {}),
    "merge-v1": ("merge-v1", {}),
    "roundabout-v1": ("roundabout-v1", {}),
    "intersection-v2": ("intersection-v2", {}),
}
IDM, NASH = "highway_env.vehicle.behavior.IDMVehicle", "olne_bench.envs.traffic.NashVehicle"
IDLE = 1


def main(steps: int) -> None:
    """Print one line per environment, then the re-planning times of all."""
    times: dict[int, list[float]] = {}
    for case in CASES:
        rates = {kind: _steps_per_second(case, kind, steps, times) for kind in (IDM, NASH)}
        print(
            f"{case}: {rates[NASH]:.1f} steps/s with Nash traffic, {rates[IDM]:.1f} with IDM",
            flush=True,
        )
    for players, seconds in sorted(times.items()):
        print(
            f"re-plan of {players} players: median {1e3 * np.median(seconds):.1f} ms, "
            f"90% below {1e3 * np.quantile(seconds, 0.9):.1f} ms ({len(seconds)} plans)"
        )


def _steps_per_second(case: str, kind: str, steps: int, times: dict[int, list[float]]) -> float:
    version, config = CASES[case]
    world = gymnasium.make(version, config={"other_vehicles_type": kind, **config})
    world.reset(seed=0)
    spent = 0.0
    for step in range(steps):
        begin = time.process_time()
        _, _, terminated, truncated, _ = world.step(IDLE)
        spent += time.process_time() - begin
        if terminated or truncated or step == steps - 1:
            for players, seconds in traffic_report(world.unwrapped.road).seconds.items():
                times.setdefault(players, []).extend(seconds)
            world.reset(seed=step)
    return steps / spent


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
