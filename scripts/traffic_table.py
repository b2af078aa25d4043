"""Crashes, near misses, lane changes, speed and standing cars of Nash traffic, beside IDM's.

    python scripts/traffic_table.py runs/traffic.csv --hours 10
    python scripts/traffic_table.py runs/traffic.csv --hours 0.5 --road merge --kind Nash

Stock environments of HighwayEnv without the ego, 20 s an episode; the seed is the episode's number.
Each episode is a row of the file, and a later call goes on until each road and kind of traffic has
so many vehicle-hours. Prints rates per vehicle-hour, with exact 95 % intervals for crashes, and
writes them to rates.csv beside FILE. Cars that begin within 2 m of another one, or crash into such
a car, count apart (``spawned``).
"""

import csv
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import shared
import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
import pandas as pd
from highway_env.vehicle.kinematics import Vehicle
from scipy.stats import chi2

from olne_bench.envs.roads.footprint import gaps

RATE = 5  # [1/s] of looks
SECONDS = 20
NEAR, SPAWNED = 0.5, 2.0  # [m] between cars
STANDS, STANDING = 0.5, 10.0  # [m/s], [s]
ROADS: dict[str, tuple[str, dict[str, Any]]] = {
    "highway": ("highway-v0", {"vehicles_count": 20}),
    "highway, dense": ("highway-v0", {"vehicles_count": 20, "vehicles_density": 3}),
    "highway-fast": ("highway-fast-v0", {}),
    "merge": ("merge-v1", {}),
    "roundabout": ("roundabout-v1", {}),
    "intersection": ("intersection-v2", {"spawn_probability": 0.6 / RATE}),
    "two-way": ("two-way-v0", {}),
}
KINDS = {
    "IDM": "highway_env.vehicle.behavior.IDMVehicle",
    "Nash": "olne_bench.envs.traffic.NashVehicle",
}
COUNTS = ("crashes", "spawned", "near", "changes", "standing")
COLUMNS = ("road", "kind", "seed", "seconds", *COUNTS, "metres")


def main(
    out: Path,
    hours: float = 10.0,
    road: tuple[Annotated[str, ROADS], ...] = (),
    kind: tuple[Annotated[str, KINDS], ...] = (),
) -> None:
    """Play what is missing, then print."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(",".join(COLUMNS) + "\n")
    for name in road or ROADS:
        for own in kind or KINDS:
            for row in _missing(out, name, own, 3600 * hours):
                with out.open("a", newline="") as file:
                    csv.writer(file).writerow(row)
    rates = table(pd.read_csv(out))
    rates.round(3).to_csv(out.with_name("rates.csv"))
    print(rates.to_string(float_format=lambda value: f"{value:.3g}"))


def _missing(out: Path, road: str, kind: str, seconds: float) -> Iterator[list[object]]:
    rows = pd.read_csv(out)
    own = rows[(rows["road"] == road) & (rows["kind"] == kind)]
    played, seed = float(own["seconds"].sum()), len(own)
    while played < seconds:
        found = episode(road, kind, seed)
        yield [road, kind, seed, *found.values()]
        played, seed = played + found["seconds"], seed + 1


def episode(road: str, kind: str, seed: int) -> dict[str, float]:
    """Vehicle-seconds, counts and metres of one episode."""
    name, config = ROADS[road]
    config = {"policy_frequency": RATE, "duration": 10 * SECONDS, **config}
    config["other_vehicles_type"] = KINDS[kind]
    world: Any = gymnasium.make(name, config=config, disable_env_checker=True).unwrapped
    world.reset(seed=seed)
    for ego in world.controlled_vehicles:
        world.road.vehicles.remove(ego)
    watch, found = Watch(), dict.fromkeys(("seconds", *COUNTS, "metres"), 0.0)
    for _ in range(SECONDS * RATE):
        for what, number in watch.look(world.road.vehicles).items():
            found[what] += number
        world.step(world.action_type.actions_indexes["IDLE"])
    world.close()
    return found


class Watch:
    """What has happened to the cars of an episode."""

    def __init__(self) -> None:
        self._lanes: dict[int, Any] = {}
        self._stood: dict[int, float] = {}
        self._spawned: set[int] = set()
        self._crashed: set[int] = set()
        self._near: set[tuple[int, int]] = set()
        self._cars: list[Vehicle] = []  # so that no id is used again

    def look(self, cars: list[Vehicle]) -> dict[str, float]:
        """Vehicle-seconds, metres, and what is new since the last look."""
        near, new = self._pairs(cars), [car for car in cars if id(car) not in self._lanes]
        self._cars += new
        close = {k for pair, apart in near.items() if apart < SPAWNED for k in pair}
        self._spawned |= {id(car) for car in new} & close
        crashed = {id(car) for car in cars if car.crashed} - self._crashed
        apart = {k for k in crashed if k in self._spawned or self._hit_spawned(k, near)}
        self._crashed |= crashed
        whole = {pair for pair in near if not self._crashed & set(pair)}
        misses = {pair for pair in whole if near[pair] < NEAR} - self._near
        changes, standing = sum(map(self._changed, cars)), sum(map(self._stands, cars))
        self._near |= misses
        return {
            "seconds": len(cars) / RATE,
            "crashes": len(crashed - apart),
            "spawned": len(apart),
            "near": len(misses),
            "changes": changes,
            "standing": standing,
            "metres": sum(car.speed for car in cars) / RATE,
        }

    def _pairs(self, cars: list[Vehicle]) -> dict[tuple[int, int], float]:
        """Gaps [m] of all pairs."""
        if len(cars) < 2:
            return {}
        rooms = gaps(np.array([[*car.position, car.heading, car.speed] for car in cars]))
        return {
            (id(cars[i]), id(cars[j])): float(rooms[i, j])
            for i, j in combinations(range(len(cars)), 2)
        }

    def _hit_spawned(self, car: int, near: dict[tuple[int, int], float]) -> bool:
        hit = {k for pair, room in near.items() if car in pair and room < NEAR for k in pair}
        return bool((hit - {car}) & self._spawned)

    def _changed(self, car: Vehicle) -> bool:
        """Whether it has another lane of the same road."""
        before = self._lanes.get(id(car), car.lane_index)
        self._lanes[id(car)] = car.lane_index
        return bool(before[:2] == car.lane_index[:2] and before[2] != car.lane_index[2])

    def _stands(self, car: Vehicle) -> bool:
        """Whether it has stood for long, for the first time since it drove."""
        stands = car.speed < STANDS and not car.crashed
        before = self._stood.get(id(car), 0.0)
        self._stood[id(car)] = before + 1 / RATE if stands else 0.0
        return before < STANDING <= self._stood[id(car)]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Rates per vehicle-hour by road and kind of traffic; speed [m/s]."""
    sums = rows.drop(columns="seed").groupby(["road", "kind"], sort=False).sum()
    hours = sums["seconds"] / 3600
    found = sums[list(COUNTS)].div(hours, axis=0)
    low, high = chi2.ppf(0.025, 2 * sums["crashes"]), chi2.ppf(0.975, 2 * sums["crashes"] + 2)
    found.insert(1, "low", np.nan_to_num(low) / 2 / hours)
    found.insert(2, "high", high / 2 / hours)
    return found.assign(speed=sums["metres"] / sums["seconds"], hours=hours)


if __name__ == "__main__":
    shared.command(main)
