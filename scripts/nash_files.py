"""Write CommonRoad files of cars that play the game ``following``, for ``olne-bench people``.

    python scripts/nash_files.py FOLDER [--draws 30]
    olne-bench people FOLDER --weights --open --out OUT

Each file has five cars in one lane, whose weights are uniform on the simplex and who want the speed
at which they begin. They play one open-loop equilibrium of 8 s, seen with errors of 2 cm. So it is
known what weights are worth, and whether the study of recorded drivers can see it.
"""

from pathlib import Path

import shared
import numpy as np

from olne_bench.envs.scenarios.following import (
    CAR,
    GAP,
    OFFSET_SPREAD,
    SPEED_SPREAD,
    TARGETS,
    driver,
)
from olne_bench.envs.tracks.export import Episode, write_commonroad
from olne_bench.envs.tracks.road_file import LaneEntry, RoadFile
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import StraightLane
from olne_bench.games.solve.olne import solve_olne

CARS, STEPS, DT = 5, 81, 0.1
ERROR = 0.02  # [m]
LANE = LaneEntry(points=[(-300.0, 0.0), (600.0, 0.0)])


def main(folder: Path, draws: int = 30) -> None:
    """Write as many files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = 0
    for seed in range(draws):
        states = motion(np.random.default_rng([seed, 46]))
        if states is not None:
            names, times = [f"car_{k}" for k in range(CARS)], DT * np.arange(STEPS)
            road = RoadFile(lanes={"lane": LANE})
            parts = names, times, states, [*CAR.state_names], DT, road
            write_commonroad(folder / f"ZAM_Nash-{seed}_1_T-1.xml", Episode(*parts))
            written += 1
    print(f"{written} of {draws} draws have an equilibrium and are written")


def motion(rng: np.random.Generator) -> np.ndarray | None:
    """States (T, N, 4) of one draw, positions with errors; None without an equilibrium."""
    speeds = rng.uniform(*TARGETS) + rng.uniform(-SPEED_SPREAD, SPEED_SPREAD, CARS)
    behind = np.concatenate([[0.0], np.cumsum(rng.uniform(*GAP, CARS - 1))])
    beside = rng.uniform(-OFFSET_SPREAD, OFFSET_SPREAD, CARS)
    lanes = [(StraightLane((-300.0, left), (1.0, 0.0), 900.0),) for left in beside]
    players = tuple(
        driver(k - 1, speed, lane, DT)
        for k, (speed, lane) in enumerate(zip(speeds, lanes, strict=True))
    )
    start = np.column_stack([-behind, beside, np.zeros(CARS), speeds])
    weights = rng.dirichlet(np.ones(4), CARS)
    found = solve_olne(Game(players, CAR, STEPS, DT), weights, start)
    if not found.certificate.passed:
        return None
    states = found.states.copy()
    states[..., :2] += ERROR * rng.standard_normal(states[..., :2].shape)
    return states


if __name__ == "__main__":
    shared.command(main)
