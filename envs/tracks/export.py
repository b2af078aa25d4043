"""Write a recording's motion in formats that other programs read, with a road file beside it."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.envs.recordings.recording_file import RecordingFile
from olne_bench.envs.tracks.grid import Motion
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import RoadFile
from olne_bench.envs.tracks.table import STATE_NAMES
from olne_bench.errors import UserError
from olne_bench.files import whole_file

CAR_LENGTH, CAR_WIDTH = 5.0, 2.0  # [m], HighwayEnv's
_DECIMALS = 12  # digits of positions in XML


@dataclass(frozen=True)
class Episode:
    """One episode of a recording."""

    players: list[str]  # names of the N players
    times: np.ndarray  # (T,) times [s]
    states: np.ndarray  # (T, N, n) states
    state_names: list[str]  # names of the n components
    dt: float  # time step [s]
    road: RoadFile | None  # lanes and targets, as far as known

    @classmethod
    def of(cls, known: RecordingFile, index: int) -> "Episode":
        """The episode with an index."""
        metadata, times, states = known.metadata, known.times[index], known.states[index]
        entry = metadata.episodes[index]
        road = entry.road
        if road is not None and road.scenario is None:
            road = road.model_copy(update={"scenario": metadata.scenario})
        return cls(entry.players, times, states, metadata.state_names, metadata.dt, road)


def write_csv(path: Path, episode: Episode) -> None:
    """Write a file that ``import --format csv`` reads; numbers keep all digits."""
    steps, count, _ = episode.states.shape
    columns = {
        "time": np.repeat(episode.times, count),
        "player": np.tile(np.array(episode.players, dtype=object), steps),
    }
    for column, name in STATE_NAMES.items():
        if name in episode.state_names:
            columns[column] = episode.states[..., episode.state_names.index(name)].ravel()
    with whole_file(path) as unfinished:
        pd.DataFrame(columns).to_csv(unfinished, index=False)


def write_commonroad(path: Path, episode: Episode) -> dict[str, str]:
    """Write a CommonRoad scenario of lanes and obstacles; their numbers, by name of the player."""
    try:
        from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
    except ImportError as error:
        raise UserError(
            "writing CommonRoad files needs commonroad-io: pip install 'olne-bench[commonroad]'"
        ) from error
    from commonroad.common.util import FileFormat
    from commonroad.planning.planning_problem import PlanningProblemSet
    from commonroad.scenario.scenario import Scenario, ScenarioID

    scenario = Scenario(episode.dt, ScenarioID.from_benchmark_id("ZAM_Olne-1_1_T-1", "2020a"))
    numbers = {name: str(k) for k, name in enumerate(episode.players, start=1)}
    for i, name in enumerate(episode.players):
        motion = Motion.of(episode.states[:, i], episode.state_names, episode.dt)
        scenario.add_objects(_obstacle(int(numbers[name]), motion))
    road = episode.road.road() if episode.road else None
    if road is not None:
        scenario.add_objects(_lanelets(road, len(numbers) + 1))
    writer = CommonRoadFileWriter(
        scenario,
        PlanningProblemSet(),
        author="",
        affiliation="",
        source="OLNE Bench",
        tags=set(),
        decimal_precision=_DECIMALS,
        file_format=FileFormat.XML,
    )
    with whole_file(path) as unfinished, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of lanelets without a type
        writer.write_to_file(str(unfinished), OverwriteExistingFile.ALWAYS)
    return numbers


def renamed(road: RoadFile, names: dict[str, str]) -> RoadFile:
    """The road file with other names of players; ``names`` maps old to new ones."""
    players = {names.get(name, name): entry for name, entry in road.players.items()}
    return road.model_copy(update={"players": players})


def _obstacle(number: int, motion: Motion) -> Any:
    from commonroad.geometry.obstacle_shapes.rect_obstacle_shape import RectObstacleShape
    from commonroad.prediction.prediction import TrajectoryPrediction
    from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
    from commonroad.scenario.state import InitialState, KSState
    from commonroad.scenario.trajectory import Trajectory

    shape = RectObstacleShape(width=CAR_WIDTH, length=CAR_LENGTH)
    headings, speeds = (_filled(values) for values in (motion.headings, motion.speeds))
    first, *later = (
        {
            "time_step": int(k),
            "position": motion.positions[k],
            "orientation": float(headings[k]),
            "velocity": float(speeds[k]),
        }
        for k in np.flatnonzero(motion.seen)
    )
    start = InitialState(**first, acceleration=0.0, yaw_rate=0.0, slip_angle=0.0)
    states = [KSState(**values, steering_angle=0.0) for values in later]
    prediction = None
    if states:
        prediction = TrajectoryPrediction(Trajectory(states[0].time_step, states), shape)
    return DynamicObstacle(number, ObstacleType.CAR, shape, start, prediction)


def _filled(values: np.ndarray) -> np.ndarray:
    """Values (T,) with gaps filled, as CommonRoad allows none; zeros if all are unknown."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return np.zeros_like(values)
    return np.asarray(np.interp(np.arange(len(values)), known, values[known]))


def _lanelets(road: Road, first: int) -> list[Any]:
    from commonroad.scenario.lanelet import Lanelet

    numbers = {name: first + k for k, name in enumerate(road.lanes)}
    lanelets = []
    for name, lane in road.lanes.items():
        left, right = _bounds(lane)
        following = [numbers[other] for other in lane.following if other in numbers]
        before = [numbers[other] for other, one in road.lanes.items() if name in one.following]
        lanelets.append(Lanelet(left, (left + right) / 2, right, numbers[name], before, following))
    return lanelets


def _bounds(lane: RoadLane) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 2) half a width to the left and to the right of the centre line."""
    line = lane.line
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    beside = lane.width / 2 * np.column_stack([-along[:, 1], along[:, 0]])
    return line + beside, line - beside
