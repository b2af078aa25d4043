"""Recordings on disk: a Parquet table with one row per (episode, time, player).

Columns: ``episode``, ``time`` [s], ``player``, the components of the state and, if known, of the
control that follows it (NaN at an episode's last time). Everything else, from the true weights to
the versions of the libraries, is JSON in the metadata of the table's schema.
"""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from olne_bench.checks import first_problem
from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.tracks.checks import LATEST, MOST_STEPS, STEP_TOLERANCE, check_name
from olne_bench.envs.tracks.road_file import RoadFile, road_file
from olne_bench.envs.tracks.text import listed
from olne_bench.errors import UserError, bad_input
from olne_bench.files import whole_file
from olne_bench.games.solve.olne import Gains

_PACKAGES = ("olne-bench", "numpy", "casadi", "pettingzoo", "highway-env", "pyarrow")
METADATA_KEY = b"olne_bench"
#: What is read into memory: rows, and bytes of metadata.
MOST_ROWS, MOST_METADATA = 10**7, 2**25


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class GainsEntry(_Strict):
    """``games.solve.olne.Gains`` as plain numbers."""

    gains: list[float]
    starts: list[int]
    passed: bool


class CertificateEntry(_Strict):
    """``games.solve.olne.Certificate`` as plain numbers.

    Attributes:
        gains: largest gain of each player in any search.
        costs: each player's cost.
        tolerance: allowed gain relative to 1 + |cost|.
        passed: whether every search passed.
        local: gains by nearby plans; None in older files, whose ``gains`` are these.
        global_so_far: gains by plans far away; None if they were not looked for.
    """

    gains: list[float]
    costs: list[float]
    tolerance: float
    passed: bool
    local: GainsEntry | None = None
    global_so_far: GainsEntry | None = None


class EpisodeEntry(_Strict):
    """What is known about one episode.

    Attributes:
        players: names of the N players.
        seed: seed of the draw; None for tracks.
        weights: (N, K) true weights; None for tracks.
        certificate: evidence of the equilibrium; None for tracks.
        road: lanes and the players' targets, as far as known.
    """

    players: list[str] = Field(min_length=1)
    seed: int | None = None
    weights: list[list[float]] | None = None
    certificate: CertificateEntry | None = None
    road: RoadFile | None = None


class Metadata(_Strict):
    """What is known about a whole file.

    Attributes:
        kind: ``truth`` for a world's equilibria, ``tracks`` for motion of unknown weights.
        scenario: name of the scenario; for tracks, that of their road file or None.
        options: the scenario's own options.
        weight_names: names of the K weights; None for tracks.
        state_names: names of the n state components.
        control_names: names of the m control components; none for tracks.
        dt: step [s].
        versions: versions of this package and the libraries that it ran on.
        episodes: one entry each.
    """

    kind: Literal["truth", "tracks"]
    scenario: str | None = None
    options: dict[str, Any] = {}
    weight_names: list[str] | None = None
    state_names: list[str]
    control_names: list[str] = []
    dt: float = Field(gt=0, strict=True)
    versions: dict[str, str]
    episodes: list[EpisodeEntry] = Field(min_length=1)


def library_versions() -> dict[str, str]:
    """Versions of this package and of the libraries that shape a recording."""
    return {name: version(name) for name in _PACKAGES}


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
    """The file of one scenario's draws: their recordings, at least one, seeds, and own options."""
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
    """Write a recording file, completely or not at all; UserError if the file cannot be written."""
    table = pa.Table.from_pandas(_frame(file), preserve_index=False)
    metadata = {METADATA_KEY: file.metadata.model_dump_json().encode()}
    table = table.replace_schema_metadata((table.schema.metadata or {}) | metadata)
    with whole_file(path, new=True) as unfinished:
        pq.write_table(table, unfinished)


def read_recording(path: Path | str) -> RecordingFile:
    """Read a recording file; RecordingFileError if it is missing or not a recording."""
    path = Path(path)
    if not path.is_file():
        raise RecordingFileError(f"no recording {str(path)!r}")
    parser = OSError, pa.ArrowException
    try:
        with bad_input(f"{path} is not a Parquet file", *parser):
            file = pq.ParquetFile(path)
            entry = (file.schema_arrow.metadata or {}).get(METADATA_KEY)
        with file:
            if entry is None:
                raise UserError(
                    f"{path} is not a recording; 'olne-bench record' and 'olne-bench import' "
                    "write them"
                )
            with bad_input(f"{path} is a damaged recording", TypeError, *parser):
                return _recording(file, _metadata(path, entry))
    except UserError as error:
        raise RecordingFileError(str(error)) from error


def _recording(file: pq.ParquetFile, metadata: Metadata) -> RecordingFile:
    """The recording in a file with these metadata."""
    episodes = metadata.episodes
    rows, players = file.metadata.num_rows, sum(len(known.players) for known in episodes)
    if rows > min(MOST_ROWS, MOST_STEPS * players):
        raise ValueError(
            f"it has {rows} rows for {players} players, at most {MOST_STEPS} each and {MOST_ROWS} "
            "in all are read"
        )
    names = [*metadata.state_names, *metadata.control_names]
    frame = _numbers(file, ["episode", "time", "player", *names])
    strange = ~frame["episode"].isin(range(len(episodes)))
    if strange.any():
        raise ValueError(
            f"it has a row of episode {frame['episode'][strange.argmax()]:g}, its metadata have "
            f"{len(episodes)} episodes"
        )
    by_episode = dict(list(frame.groupby("episode")))
    arrays = []
    for index, known in enumerate(episodes):
        try:
            found = by_episode.get(index, frame[:0])
            arrays.append(_arrays(found, metadata, len(known.players)))
        except ValueError as error:
            raise ValueError(f"episode {index}: {error}") from error
    return RecordingFile(metadata, *zip(*arrays, strict=True))


def _metadata(path: Path, entry: bytes) -> Metadata:
    """The checked metadata; ValueError names the first wrong value."""
    if len(entry) > MOST_METADATA:
        raise ValueError(f"its metadata have {len(entry)} bytes, at most {MOST_METADATA} are read")
    try:
        metadata = Metadata.model_validate(json.loads(entry))
    except ValidationError as error:
        raise ValueError(first_problem(error)) from error
    for known in metadata.episodes:
        for player in known.players:
            check_name(f"{path}: its metadata", player)
        again = [name for name, times in Counter(known.players).items() if times > 1]
        if again:
            raise ValueError(f"its metadata name the player {again[0]!r} twice")
        for player in known.road.players if known.road else ():
            if player not in known.players:
                raise ValueError(f"its road has targets of player {player!r}, who is not in it")
    return metadata


def _numbers(file: pq.ParquetFile, names: list[str]) -> pd.DataFrame:
    """Columns of a file, which hold finite numbers, NaN where unknown; no others are read."""
    schema = file.schema_arrow
    for name in names:
        if names.count(name) > 1 or schema.names.count(name) != 1:
            raise ValueError(
                f"it has no column {name!r}, or several; it has: {listed(schema.names)}"
            )
        kind = schema.field(name).type
        if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
            raise ValueError(f"its column {name!r} holds {kind}, expected numbers")
    table = file.read(columns=names)
    frame = pd.DataFrame({name: table.column(name).to_numpy() for name in names})
    for name in names:
        endless = np.isinf(frame[name].to_numpy())
        if endless.any():
            raise ValueError(f"its column {name!r} is infinite in row {int(endless.argmax()) + 1}")
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


def _gains(found: Gains | None) -> GainsEntry | None:
    if found is None:
        return None
    values, starts = found.values.tolist(), found.starts.tolist()
    return GainsEntry(gains=values, starts=starts, passed=found.passed)


def _frame(file: RecordingFile) -> pd.DataFrame:
    names = [*file.metadata.state_names, *file.metadata.control_names]
    frames = []
    for episode, (times, states, controls) in enumerate(
        zip(file.times, file.states, file.controls, strict=True)
    ):
        steps, players, _ = states.shape
        to_the_end = np.pad(controls, ((0, 1), (0, 0), (0, 0)), constant_values=np.nan)
        values = np.concatenate([states, to_the_end], axis=2)
        frame = pd.DataFrame(values.reshape(steps * players, len(names)), columns=names)
        frame.insert(0, "episode", episode)
        frame.insert(1, "time", np.repeat(times, players))
        frame.insert(2, "player", np.tile(np.arange(players), steps))
        frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def _arrays(
    rows: pd.DataFrame, metadata: Metadata, num_players: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,), states (T, N, n) and controls (T-1, N, m) of one episode's rows."""
    strange = ~(rows["time"].abs() < LATEST).to_numpy()
    if strange.any():
        raise ValueError(f"a time is {rows['time'].iloc[strange.argmax()]:g}, expected seconds")
    rows = rows.sort_values(["time", "player"])
    again = rows.duplicated(["time", "player"])
    if again.any():
        time, player = rows[["time", "player"]].to_numpy(dtype=float)[again.argmax()]
        raise ValueError(f"player {player:g} has two rows at time {time:g}")
    full = len(rows) > 0 and len(rows) % num_players == 0
    if not full or (rows["player"] != np.tile(range(num_players), len(rows) // num_players)).any():
        raise ValueError(
            f"its rows are not those of the players 0 to {num_players - 1} at each time"
        )
    times = rows["time"].to_numpy(dtype=float).reshape(-1, num_players)
    off = np.abs(np.diff(times, axis=0) - metadata.dt)
    if (times != times[:, :1]).any() or not (off < STEP_TOLERANCE * metadata.dt).all():
        raise ValueError(f"its times are not {metadata.dt:g} s apart, as its metadata say")
    states = rows[metadata.state_names].to_numpy(dtype=float).reshape(*times.shape, -1)
    width = len(metadata.control_names)
    controls = rows[metadata.control_names].to_numpy(dtype=float).reshape(*times.shape, width)
    return times[:, 0], states, controls[:-1]
