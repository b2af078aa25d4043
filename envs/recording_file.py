"""Recordings on disk: a Parquet table with one row per (episode, time, player).

Columns: ``episode``, ``time`` [s], ``player``, the components of the state and, if known, of the
control that follows it (NaN at an episode's last time). Everything else, from the true weights to
the versions of the libraries, is JSON in the metadata of the table's schema.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from olne_bench.checks import first_problem
from olne_bench.envs.recording import Recording
from olne_bench.envs.recording_metadata import (
    CertificateEntry,
    EpisodeEntry,
    GainsEntry,
    Metadata,
    library_versions,
)
from olne_bench.envs.tracks.checks import STEP_TOLERANCE, check_name
from olne_bench.envs.tracks.of_scenario import road_file
from olne_bench.errors import UserError, bad_input
from olne_bench.files import whole_file
from olne_bench.games.olne import Gains

METADATA_KEY = b"olne_bench"
#: Rows that are read into memory.
MOST_ROWS = 10**7


class RecordingFileError(UserError, ValueError):
    """A file that is not a recording."""


@dataclass(frozen=True)
class RecordingFile:
    """Contents of a recording file.

    Attributes:
        metadata: everything except the motion.
        times: per episode (T,) [s].
        states: per episode (T, N, n), NaN where unknown.
        controls: per episode (T-1, N, m).
    """

    metadata: Metadata
    times: tuple[np.ndarray, ...]
    states: tuple[np.ndarray, ...]
    controls: tuple[np.ndarray, ...]


def of_recordings(
    recordings: Sequence[Recording], seeds: Sequence[int], options: dict[str, Any]
) -> RecordingFile:
    """The file of one scenario's draws.

    Args:
        recordings: recordings of the draws, at least one.
        seeds: seeds of the draws.
        options: the scenario's own options.
    """
    scenario = recordings[0].scenario
    game = scenario.game
    return RecordingFile(
        metadata=Metadata(
            kind="truth",
            scenario=scenario.name,
            options=options,
            weight_names=list(game.weight_names),
            state_names=list(game.dynamics.state_names),
            control_names=list(game.dynamics.control_names),
            dt=game.dt,
            versions=library_versions(),
            episodes=[_entry(r, s) for r, s in zip(recordings, seeds, strict=True)],
        ),
        times=tuple(game.dt * np.arange(len(r.states)) for r in recordings),
        states=tuple(r.states for r in recordings),
        controls=tuple(r.controls for r in recordings),
    )


def write_recording(path: Path, file: RecordingFile) -> None:
    """Write a recording file, completely or not at all.

    Raises:
        UserError: if the file cannot be written.
    """
    table = pa.Table.from_pandas(_frame(file), preserve_index=False)
    metadata = {METADATA_KEY: file.metadata.model_dump_json().encode()}
    table = table.replace_schema_metadata((table.schema.metadata or {}) | metadata)
    with whole_file(path) as unfinished:
        pq.write_table(table, unfinished)


def read_recording(path: Path | str) -> RecordingFile:
    """Read a recording file.

    Raises:
        RecordingFileError: if it is missing or not a recording.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingFileError(f"no recording {str(path)!r}")
    try:
        rows = pq.read_metadata(path).num_rows
        if rows > MOST_ROWS:
            raise RecordingFileError(f"{path} has {rows} rows, at most {MOST_ROWS} are read")
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise RecordingFileError(f"{path} is not a Parquet file: {error}") from error
    entry = (table.schema.metadata or {}).get(METADATA_KEY)
    if entry is None:
        raise RecordingFileError(
            f"{path} is not a recording; 'olne-bench record' and 'olne-bench import' write them"
        )
    try:
        with bad_input(f"{path} is a damaged recording", TypeError, pa.ArrowException):
            return _recording(table, entry)
    except UserError as error:
        raise RecordingFileError(str(error)) from error


def _recording(table: pa.Table, entry: bytes) -> RecordingFile:
    """The recording in a table and its metadata.

    Raises:
        ValueError: if rows are missing, or numbers are impossible.
    """
    try:
        metadata = Metadata.model_validate(json.loads(entry))
    except ValidationError as error:
        raise ValueError(first_problem(error)) from error
    for known in metadata.episodes:
        for player in known.players:
            check_name("its metadata", player)
    names = [*metadata.state_names, *metadata.control_names]
    frame = _numbers(table, ["episode", "time", "player", *names])
    episodes = [
        _arrays(frame[frame["episode"] == index], metadata, len(known.players))
        for index, known in enumerate(metadata.episodes)
    ]
    return RecordingFile(
        metadata,
        times=tuple(times for times, _, _ in episodes),
        states=tuple(states for _, states, _ in episodes),
        controls=tuple(controls for _, _, controls in episodes),
    )


def _numbers(table: pa.Table, names: list[str]) -> pd.DataFrame:
    """Columns of a table, which hold finite numbers, NaN where unknown.

    Raises:
        ValueError: on a column that is missing, is there twice, or holds something else.
    """
    frame = pd.DataFrame()
    for name in names:
        if name in frame or table.column_names.count(name) != 1:
            raise ValueError(f"it has no column {name!r}, or several")
        column = table.column(name)
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            raise ValueError(f"its column {name!r} holds {column.type}, expected numbers")
        frame[name] = column.to_numpy()
        if np.isinf(frame[name]).any():
            raise ValueError(f"its column {name!r} has infinite numbers")
    return frame


def _entry(recording: Recording, seed: int) -> EpisodeEntry:
    certificate = recording.certificate
    return EpisodeEntry(
        players=[f"player_{index}" for index in range(recording.scenario.game.num_players)],
        seed=seed,
        weights=recording.scenario.weights.tolist(),
        certificate=CertificateEntry(
            gains=certificate.gains.tolist(),
            costs=certificate.costs.tolist(),
            tolerance=certificate.tolerance,
            passed=certificate.passed,
            local=_gains(certificate.local),
            global_so_far=_gains(certificate.global_so_far),
        ),
        road=road_file(recording.scenario),
    )


def _gains(gains: Gains | None) -> GainsEntry | None:
    if gains is None:
        return None
    values, starts = gains.values.tolist(), gains.starts.tolist()
    return GainsEntry(gains=values, starts=starts, passed=gains.passed)


def _frame(file: RecordingFile) -> pd.DataFrame:
    names = [*file.metadata.state_names, *file.metadata.control_names]
    frames = []
    for episode, (times, states, controls) in enumerate(
        zip(file.times, file.states, file.controls, strict=True)
    ):
        steps, players, _ = states.shape
        none_after_the_last = np.full((1, *controls.shape[1:]), np.nan)
        values = np.concatenate(
            [states, np.concatenate([controls, none_after_the_last])], axis=2
        ).reshape(steps * players, len(names))
        frame = pd.DataFrame(values, columns=names)
        frame.insert(0, "episode", episode)
        frame.insert(1, "time", np.repeat(times, players))
        frame.insert(2, "player", np.tile(np.arange(players), steps))
        frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def _arrays(
    rows: pd.DataFrame, metadata: Metadata, num_players: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,), states (T, N, n) and controls (T-1, N, m) of one episode's rows."""
    rows = rows.sort_values(["time", "player"])
    times = rows["time"].to_numpy(dtype=float).reshape(-1, num_players)
    if len(times) == 0 or (rows["player"].to_numpy() != _players(times)).any():
        raise ValueError("an episode lacks rows")
    off = np.abs(np.diff(times, axis=0) / metadata.dt - 1)
    if (times != times[:, :1]).any() or not (off < STEP_TOLERANCE).all():
        raise ValueError(f"its times are not {metadata.dt:g} s apart, as its metadata say")
    states = rows[metadata.state_names].to_numpy(dtype=float).reshape(*times.shape, -1)
    width = len(metadata.control_names)
    controls = rows[metadata.control_names].to_numpy(dtype=float).reshape(*times.shape, width)
    return times[:, 0], states, controls[:-1]


def _players(times: np.ndarray) -> np.ndarray:
    steps, players = times.shape
    return np.tile(np.arange(players), steps)
