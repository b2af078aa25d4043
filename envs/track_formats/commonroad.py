"""CommonRoad scenarios (XML or protobuf): their dynamic obstacles and their lanelets."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.road import MOST_MAP_BYTES, Road, RoadLane, curves_through
from olne_bench.envs.tracks.table import COLUMNS, Tracks, no_parts
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

DESCRIPTION = "CommonRoad scenarios; lanes from their lanelets; needs olne-bench[commonroad]"


def read(path: Path, part: str | None) -> Tracks:
    """Read the obstacles that have a trajectory; see ``track_formats``."""
    no_parts(part)
    check_input("tracks file", path, MOST_MAP_BYTES)
    scenario = _scenario(path)
    rows: list[tuple[Any, ...]] = []
    skipped = []
    for obstacle in scenario.dynamic_obstacles:
        trajectory = getattr(obstacle.prediction, "trajectory", None)
        if trajectory is None:
            skipped.append(str(obstacle.obstacle_id))
            continue
        for state in [obstacle.initial_state, *trajectory.state_list]:
            rows.append(_row(path, scenario.dt, obstacle, state))
    lanes = {
        str(lanelet.lanelet_id): _lane(path, lanelet)
        for lanelet in scenario.lanelet_network.lanelets
    }
    notes = (f"left out, without a trajectory: {', '.join(skipped)}",) if skipped else ()
    return Tracks(pd.DataFrame(rows, columns=list(COLUMNS)), Road(lanes) if lanes else None, notes)


def commonroad_io() -> None:
    """UserError unless commonroad-io is installed; it says how to install it."""
    try:
        import commonroad  # noqa: F401
    except ImportError as error:
        raise UserError(
            "CommonRoad files need commonroad-io: pip install 'olne-bench[commonroad]'"
        ) from error


def _scenario(path: Path) -> Any:
    commonroad_io()
    from commonroad.common.file_reader import CommonRoadFileReader

    try:
        scenario, _ = CommonRoadFileReader(path).open()
    except Exception as error:  # the library raises whatever its parsers do
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(f"{path} is not a CommonRoad scenario: {reason}") from error
    return scenario


def _lane(path: Path, lanelet: Any) -> RoadLane:
    across = lanelet.left_vertices - lanelet.right_vertices
    with bad_input(f"{path}: lanelet {lanelet.lanelet_id}"):
        return RoadLane(
            curves_through(lanelet.center_vertices),
            float(np.linalg.norm(across, axis=1).mean()),
            tuple(str(number) for number in lanelet.successor),
        )


def _row(path: Path, dt: float, obstacle: Any, state: Any) -> tuple[Any, ...]:
    """One row of the table; the origin of a shape may differ from its centre."""
    position, number = state.position, obstacle.obstacle_id
    if not isinstance(position, np.ndarray) or not isinstance(state.time_step, int):
        raise UserError(f"{path}: obstacle {number} has uncertain states; expected exact ones")
    known = (getattr(state, name, None) for name in ("orientation", "velocity"))
    heading, speed = (np.nan if value is None else float(value) for value in known)
    ahead = float(getattr(obstacle.obstacle_shape, "origin_x_shift", 0.0))
    if ahead != 0.0:
        position = position[:2] - ahead * np.array([np.cos(heading), np.sin(heading)])
    return dt * state.time_step, str(number), float(position[0]), float(position[1]), heading, speed
