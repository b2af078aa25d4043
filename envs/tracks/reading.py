"""Read a file of tracks into a recording without ground truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from olne_bench.envs.recordings.recording_file import (
    EpisodeEntry,
    Metadata,
    RecordingFile,
    library_versions,
    read_recording,
)
from olne_bench.envs.track_formats import get_format
from olne_bench.envs.track_formats.sumo import read_net
from olne_bench.envs.tracks.checks import check_positions, check_table, unit_problems
from olne_bench.envs.tracks.grid import Excerpt, Frame, Grid, on_grid
from olne_bench.envs.tracks.lanelet2_map import read_lanelets
from olne_bench.envs.tracks.road import Road
from olne_bench.envs.tracks.road_file import RoadFile, lane_entries, read_road_file
from olne_bench.envs.tracks.table import STATE_NAMES, Tracks
from olne_bench.envs.tracks.text import listed, unpacked
from olne_bench.envs.tracks.who import named, told_apart, unit_doubts
from olne_bench.errors import UserError, bad_input

#: Lanes of a map that are farther from all players are left out [m].
_NEAR = 30.0
#: Number of players of a file that is no game.
ANY = 10_000
#: Share of players who may be odd where the others are not.
_ODD = 0.1
_NOWHERE = np.empty((0, 2))


@dataclass(frozen=True)
class Imported:
    """An imported file."""

    recording: RecordingFile  # recording of one episode
    notes: tuple[str, ...]  # what was assumed or left out, one line each


def read_tracks(
    path: Path,
    format_name: str = "csv",
    *,
    excerpt: Excerpt | None = None,
    frame: Frame | None = None,
    road: Path | None = None,
    part: str | None = None,
) -> Imported:
    """Read a file of tracks in one of ``track_formats.format_names()``.

    ``excerpt`` says which times, players and step, by default all. ``frame`` changes positions and
    headings after reading, not lanes. ``road`` is a TOML file of lanes and targets, SUMO network or
    lanelet2 map; by default the TOML file of the same name beside ``path``, if there is one.
    ``part`` is one of a file in which player names repeat.
    """
    with bad_input(f"{path} cannot be read as {format_name}", OSError, TypeError):
        tracks = get_format(format_name).read(path, part)
    with bad_input(str(path)):
        table, unnamed = named(tracks.table)
        table, repeated = told_apart(table)
    check_table(path, table)
    notes = [*tracks.notes, *unnamed, *repeated, *unit_doubts(table)]
    table = (frame or Frame()).apply(table)
    grid = on_grid(path, table, excerpt or Excerpt())
    check_positions(path, grid.states, grid.players)
    grid = _plausible(path, grid, excerpt or Excerpt())
    known, more = _road(path, road, tracks, grid)
    return Imported(_recording(grid, known), (*notes, *grid.notes, *more))


def read_whole(
    path: Path, format_name: str = "csv", road: Path | None = None, part: str | None = None
) -> RecordingFile:
    """A recording (``.parquet``), or a file of tracks with any number of players."""
    if path.suffix == ".parquet":
        return read_recording(path)
    return read_tracks(path, format_name, excerpt=Excerpt(most=ANY), road=road, part=part).recording


def grid_and_road(recording: RecordingFile) -> tuple[Grid, Road | None]:
    """The tracks of a recording's first episode, and its lanes."""
    entry = recording.metadata.episodes[0]
    states = np.full((*recording.states[0].shape[:2], len(STATE_NAMES)), np.nan)
    for k, name in enumerate(STATE_NAMES.values()):
        if name in recording.metadata.state_names:
            column = recording.metadata.state_names.index(name)
            states[..., k] = recording.states[0][..., column]
    grid = Grid(recording.times[0], list(entry.players), states)
    return grid, None if entry.road is None else entry.road.road()


def on_lanes(
    path: Path, format_name: str = "csv", road: Path | None = None, part: str | None = None
) -> tuple[Grid, Road]:
    """``grid_and_road`` of ``read_whole``; UserError if there are no lanes."""
    grid, lanes = grid_and_road(read_whole(path, format_name, road, part))
    if lanes is None:
        raise UserError(f"{path} has no lanes, along which to predict; give them by --road")
    return grid, lanes


def _plausible(path: Path, grid: Grid, excerpt: Excerpt) -> Grid:
    """The grid without a few odd players whom nobody named; UserError where units are wrong."""
    problems = unit_problems(path, grid.states, grid.step, grid.players)
    first = next(iter(problems.values()), "")
    if problems and (excerpt.players or len(problems) > _ODD * len(grid.players)):
        raise UserError(first)
    if not problems:
        return grid
    kept = [k for k, name in enumerate(grid.players) if name not in problems]
    more = f" and {len(problems) - 1} more like it" if len(problems) > 1 else ""
    note = f"left out: {first}{more}"
    players = [grid.players[k] for k in kept]
    return Grid(grid.times, players, grid.states[:, kept], (*grid.notes, note))


def _road(
    path: Path, road: Path | None, tracks: Tracks, grid: Grid
) -> tuple[RoadFile | None, list[str]]:
    """Lanes and targets, and notes on where they come from."""
    beside = unpacked(path).with_suffix(".toml")
    if road is None and beside.is_file():
        road = beside
    if road is None:
        if tracks.road is None or not tracks.road.lanes:
            return None, list(tracks.road.notes) if tracks.road else []
        near = tracks.road.near(_positions(grid), _NEAR)
        return _of_map(near, "the file's map")
    if unpacked(road).suffix.lower() in (".xml", ".osm", ".osm_xy"):
        return _of_map(_near_part(road, tracks.origin, _positions(grid)), str(road))
    if road.suffix.lower() != ".toml":
        raise UserError(f"--road {road}: the name must end in .toml, .xml, .osm or .osm_xy")
    known = read_road_file(road)
    for player in known.players:
        if player not in set(tracks.table["player"]):
            there = listed(list(tracks.table["player"].unique()))
            raise UserError(
                f"{road} has targets of player {player!r}, which is not in {path}; there are: "
                f"{there}"
            )
    players = {name: entry for name, entry in known.players.items() if name in grid.players}
    lanes = known.lanes or (lane_entries(tracks.road) if tracks.road else {})
    known = known.model_copy(update={"players": players, "lanes": lanes})
    with bad_input(str(road)):
        known.check_lanes()
    return known, [f"lanes and targets: {len(known.lanes)} lanes, {len(players)} players of {road}"]


def _of_map(road: Road, name: str) -> tuple[RoadFile, list[str]]:
    return RoadFile(lanes=lane_entries(road)), [*road.notes, f"lanes: {len(road.lanes)} of {name}"]


def _near_part(path: Path, origin: tuple[float, float] | None, positions: np.ndarray) -> Road:
    """The lanes of a map that are near a player; UserError if there are none."""
    is_net = unpacked(path).suffix.lower() == ".xml"
    whole = read_net(path) if is_net else read_lanelets(path, origin)
    near = whole.near(positions, _NEAR)
    if not near.lanes:
        points = np.concatenate([lane.line for lane in whole.lanes.values()] or [_NOWHERE])
        raise UserError(
            f"--road {path}: none of its {len(whole.lanes)} lanes comes within {_NEAR:g} m of a "
            f"player; {_extent('lanes', points)}, {_extent('players', positions)}"
        )
    return near


def _extent(what: str, points: np.ndarray) -> str:
    if not points.size:
        return f"{what} are nowhere"
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    return f"{what} are at x from {left:.0f} to {right:.0f}, y from {low:.0f} to {high:.0f}"


def _positions(grid: Grid) -> np.ndarray:
    positions = grid.states[..., :2].reshape(-1, 2)
    return np.asarray(positions[np.isfinite(positions).all(axis=1)])


def _recording(grid: Grid, road: RoadFile | None) -> RecordingFile:
    metadata = Metadata(
        kind="tracks",
        scenario=road.scenario if road else None,
        state_names=list(STATE_NAMES.values()),
        dt=grid.step,
        versions=library_versions(),
        episodes=[EpisodeEntry(players=grid.players, road=road)],
    )
    none = np.empty((len(grid.times) - 1, len(grid.players), 0))
    return RecordingFile(metadata, (grid.times,), (grid.states,), (none,))
