"""Tracks: a user's own motion data, read from CSV and checked before anything is made of it.

A file has one row per (player, time): ``time`` [s], ``player`` (any name), ``x`` and ``y`` [m],
and ``heading`` [rad] and ``speed`` [m/s] where they are known. Rows may be grouped by time or by
player. The times of a player must increase, in equal steps that all players share. An empty cell
or ``NaN`` is a missing sample. A player who is out of sight for a while keeps its rows, without
numbers.
"""

from pathlib import Path

import numpy as np

from olne_bench.envs.recording_file import RecordingFile
from olne_bench.envs.recording_metadata import EpisodeEntry, Metadata, library_versions
from olne_bench.envs.tracks_checks import (
    check_everybody_has_rows,
    check_steps,
    check_times_increase,
    check_units,
)
from olne_bench.envs.tracks_table import OPTIONAL, REQUIRED, STATE_NAMES, read_cells, read_numbers


def read_tracks(path: Path) -> RecordingFile:
    """Read a CSV file of tracks as a recording without truth.

    Returns:
        One episode. States are NaN where nothing is known, players are in the order of their
        first rows, and headings are unwrapped.

    Raises:
        UserError: names file, line or player, value and what is expected.
    """
    table = read_numbers(path)
    check_times_increase(path, table)
    times = np.unique(table["time"])
    check_steps(path, times)
    players = list(table["player"].unique())
    check_everybody_has_rows(path, table, times, players)

    ordered = table.assign(order=table["player"].map({p: i for i, p in enumerate(players)}))
    ordered = ordered.sort_values(["time", "order"])
    shape = (len(times), len(players))
    states = np.stack([ordered[name].to_numpy().reshape(shape) for name in STATE_NAMES], axis=-1)
    dt = float((times[-1] - times[0]) / (len(times) - 1))
    check_units(path, states, dt, players)
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
    return [name for name in read_cells(path).columns if name not in REQUIRED + OPTIONAL]


def _unwrapped(headings: np.ndarray) -> np.ndarray:
    """Headings (T, N) without jumps of 2 pi, across gaps as well."""
    result = headings.copy()
    for column in result.T:
        seen = np.isfinite(column)
        column[seen] = np.unwrap(column[seen])
    return result
