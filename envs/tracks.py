"""Tracks: a user's own motion data, read from CSV and checked before anything is made of it.

One row per (player, time): ``time`` [s], ``player`` (any name), ``x`` and ``y`` [m], and where
known ``heading`` [rad] and ``speed`` [m/s]. Rows may be grouped by time or by player; the times of
a player must increase, in equal steps that all players share. An empty cell or ``NaN`` is a
missing sample. A player that is out of sight for a while keeps its rows, without numbers.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.recording_file import EpisodeEntry, Metadata, RecordingFile, library_versions
from olne_bench.errors import UserError

REQUIRED = ("time", "player", "x", "y")
OPTIONAL = ("heading", "speed")
STATE_NAMES = {"x": "px", "y": "py", "heading": "heading", "speed": "speed"}
FEWEST_STEPS = 3
FASTEST = 100.0  # [m/s]; beyond it something is not in metres and seconds
LONGEST_STEP = 10.0  # [s]; beyond it times are not in seconds
LARGEST_HEADING = 8 * np.pi  # [rad], four full turns; beyond it these are degrees
STEP_TOLERANCE = 0.05  # of a step, for times that were rounded when written
UNIT_FACTOR = 2.0  # by which speeds may differ from displacements; miles per hour differ by 2.2
UNIT_WINDOW = 1.0  # [s] over which displacements are taken, as noise would swell shorter ones
DRIVING = 1.0  # [m/s] above which a heading has to agree with where positions go
STANDSTILL = 0.05  # [m/s] below which the two are not compared
_MISSING = {"", "nan", "na", "n/a", "null"}
_FIRST_LINE = 2  # of data, after the header


def read_tracks(path: Path) -> RecordingFile:
    """Read a CSV file of tracks as a recording without truth.

    Returns:
        One episode whose states are NaN where nothing is known. Players are in the order of
        their first rows; headings are unwrapped.

    Raises:
        UserError: names file, line or player, value and what is expected.
    """
    table = _read_numbers(path)
    _check_times_increase(path, table)
    times = np.unique(table["time"])
    _check_steps(path, times)
    players = list(table["player"].unique())
    _check_everybody_has_rows(path, table, times, players)

    ordered = table.assign(order=table["player"].map({p: i for i, p in enumerate(players)}))
    ordered = ordered.sort_values(["time", "order"])
    shape = (len(times), len(players))
    states = np.stack([ordered[name].to_numpy().reshape(shape) for name in STATE_NAMES], axis=-1)
    dt = float((times[-1] - times[0]) / (len(times) - 1))
    _check_units(path, states, dt, players)
    states[..., 2] = _unwrapped(states[..., 2])
    metadata = Metadata(
        kind="tracks",
        state_names=list(STATE_NAMES.values()),
        dt=dt,
        versions=library_versions(),
        episodes=[EpisodeEntry(players=players)],
    )
    return RecordingFile(metadata, (times,), (states,), (np.empty((len(times) - 1, shape[1], 0)),))


def ignored_columns(path: Path) -> list[str]:
    """Columns of a file that ``read_tracks`` makes no use of."""
    return [name for name in _read_cells(path).columns if name not in REQUIRED + OPTIONAL]


def _read_cells(path: Path) -> pd.DataFrame:
    if not path.is_file():
        raise UserError(f"no tracks file {str(path)!r}")
    try:
        cells = pd.read_csv(
            path,
            dtype=str,
            header=None,
            index_col=False,
            keep_default_na=False,
            skip_blank_lines=False,
            encoding="utf-8-sig",
        )
    except pd.errors.EmptyDataError as error:
        raise UserError(f"{path} is empty; expected the columns {', '.join(REQUIRED)}") from error
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise UserError(f"{path} is not a CSV file: {error}") from error
    names = cells.iloc[0].fillna("").str.strip()
    if names.duplicated().any():
        raise UserError(f"{path}: column {names[names.duplicated()].iloc[0]!r} is there twice")
    rows = cells.iloc[1:].fillna("").set_axis(list(names), axis=1)
    rows.index += _FIRST_LINE - 1  # line numbers, so that messages can name them
    return rows[(rows != "").any(axis=1)]  # blank lines say nothing


def _read_numbers(path: Path) -> pd.DataFrame:
    """The columns of tracks, the optional ones NaN where absent, by line number."""
    cells = _read_cells(path)
    absent = [name for name in REQUIRED if name not in cells.columns]
    if absent:
        raise UserError(
            f"{path}: missing column{'s'[: len(absent) > 1]} {', '.join(absent)}; "
            f"it has: {', '.join(cells.columns)}"
        )
    table = pd.DataFrame({"player": cells["player"].str.strip()}, index=cells.index)
    _require(path, table["player"], "player")
    for name in ("time", *STATE_NAMES):
        if name in cells.columns:
            table[name] = _numbers(path, cells[name].str.strip(), name)
        else:
            table[name] = np.nan
    _require(path, cells["time"].where(table["time"].notna(), ""), "time")
    return table


def _numbers(path: Path, cells: pd.Series, name: str) -> pd.Series:
    known = ~cells.str.lower().isin(_MISSING)
    numbers = pd.to_numeric(cells.where(known), errors="coerce").astype(float)
    wrong = known & ~np.isfinite(numbers)
    if wrong.any():
        line = _first_line(wrong)
        raise UserError(f"{path}, line {line}: {name} is {cells[line]!r}, expected a finite number")
    return numbers


def _first_line(wrong: pd.Series) -> int:
    return int(wrong.index.to_numpy()[wrong.to_numpy().argmax()])


def _require(path: Path, cells: pd.Series, name: str) -> None:
    empty = cells == ""
    if empty.any():
        raise UserError(f"{path}, line {_first_line(empty)}: the row has no {name}")


def _check_times_increase(path: Path, table: pd.DataFrame) -> None:
    for player, rows in table.groupby("player", sort=False):
        times, lines = rows["time"].to_numpy(), rows.index.to_numpy()
        repeated = rows["time"].duplicated().to_numpy()
        if repeated.any():
            k = int(repeated.argmax())
            raise UserError(
                f"{path}, line {lines[k]}: player {player!r} has time {times[k]:g} twice"
            )
        falling = np.diff(times) < 0
        if falling.any():
            k = int(falling.argmax())
            raise UserError(
                f"{path}, line {lines[k + 1]}: time {times[k + 1]:g} of player {player!r} follows "
                f"on {times[k]:g}; times must increase"
            )


def _check_steps(path: Path, times: np.ndarray) -> None:
    if len(times) < FEWEST_STEPS:
        raise UserError(f"{path} has {len(times)} times, expected at least {FEWEST_STEPS}")
    steps = np.diff(times)
    usual = float(np.median(steps))
    if usual > LONGEST_STEP:
        raise UserError(
            f"{path}: time steps of {usual:g}, above {LONGEST_STEP:g} s; expected time in seconds"
        )
    unequal = np.abs(steps - usual) > STEP_TOLERANCE * usual
    if unequal.any():
        k = int(unequal.argmax())
        raise UserError(
            f"{path}: unequal time steps: {steps[k]:g} s after time {times[k]:g}, "
            f"mostly {usual:g} s; expected equal ones"
        )


def _check_everybody_has_rows(
    path: Path, table: pd.DataFrame, times: np.ndarray, players: list[str]
) -> None:
    for player in players:
        absent = np.setdiff1d(times, table.loc[table["player"] == player, "time"])
        if absent.size:
            raise UserError(
                f"{path}: player {player!r} has no row at time {absent[0]:g} "
                f"({absent.size} of {len(times)} are missing); "
                "give it rows with empty cells where it was not seen"
            )
        own = table.loc[table["player"] == player, ["x", "y"]]
        if own.isna().any(axis=1).all():
            raise UserError(f"{path}: player {player!r} has no position at any time")


def _check_units(path: Path, states: np.ndarray, dt: float, players: list[str]) -> None:
    headings, speeds = np.abs(states[..., 2]), np.abs(states[..., 3])
    window = min(len(states) - 1, max(1, round(UNIT_WINDOW / dt)))
    steps = states[window:, :, :2] - states[:-window, :, :2]
    from_positions = np.linalg.norm(steps, axis=-1) / (window * dt)
    # Cosine between heading and motion; a car in reverse has a negative speed.
    off = states[:-window, :, 2] - np.arctan2(steps[..., 1], steps[..., 0])
    agreement = np.cos(off) * np.where(states[:-window, :, 3] < 0, -1, 1)
    agreement[~(from_positions > DRIVING)] = np.nan
    for i, player in enumerate(players):
        who = f"{path}: player {player!r}"
        if (speeds[:, i] > FASTEST).any():
            raise UserError(
                f"{who} has a speed of {np.nanmax(speeds[:, i]):g}, above {FASTEST:g} m/s; "
                "expected metres per second"
            )
        if (from_positions[:, i] > FASTEST).any():
            raise UserError(
                f"{who} moves at {np.nanmax(from_positions[:, i]):g} m/s, above {FASTEST:g}; "
                "expected x and y in metres and time in seconds"
            )
        if (headings[:, i] > LARGEST_HEADING).any():
            raise UserError(
                f"{who} has a heading of {np.nanmax(headings[:, i]):g}; expected radians"
            )
        told = agreement[np.isfinite(agreement[:, i]), i]
        if told.size and told.mean() < 0:
            raise UserError(
                f"{who} has headings that point away from where its positions go; expected "
                "radians, from the x axis towards the y axis"
            )
        both = np.isfinite(speeds[window:, i]) & np.isfinite(from_positions[:, i])
        if not both.any():
            continue
        windows = np.lib.stride_tricks.sliding_window_view(speeds[:, i], window + 1)
        mean_speed = float(np.nanmean(windows[both], axis=1).mean())
        seen = float(from_positions[both, i].mean())
        if max(mean_speed, seen) > max(STANDSTILL, UNIT_FACTOR * min(mean_speed, seen)):
            raise UserError(
                f"{who} has a mean speed of {mean_speed:.3g}, but its positions move at "
                f"{seen:.3g} m/s; expected metres, seconds and metres per second"
            )


def _unwrapped(headings: np.ndarray) -> np.ndarray:
    """Headings (T, N) without jumps of 2 pi, across gaps as well."""
    result = headings.copy()
    for column in result.T:
        seen = np.isfinite(column)
        column[seen] = np.unwrap(column[seen])
    return result
