"""An excerpt of tracks on a common time grid: frame, window, players, step; and motion on it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.checks import (
    FEWEST_STEPS,
    check_number_of_steps,
    check_times,
    count_steps,
    resolution,
    unequal_steps,
)
from olne_bench.envs.tracks.table import SLOWEST, STATE_NAMES
from olne_bench.envs.tracks.text import listed
from olne_bench.envs.tracks.who import vehicles
from olne_bench.errors import UserError, bad_input

MOST_PLAYERS = 20  # larger games take hours
_ROUNDING = 1e-6  # [s], tolerance of computed times
#: Times between exact ends are off by half a digit at most; beyond this share, ends were rounded.
_ENDS = 0.55
_BRIDGED = 1.5  # largest gap that is interpolated, in steps of the data
_NEIGHBOURS = 0.35  # samples whose distance differs by less from the median are neighbours
_ROUGHNESS_ORDER = 3
_ROUGHNESS_NORM = 20.0  # 1 + 9 + 9 + 1, squared coefficients of a third difference


@dataclass(frozen=True)
class Frame:
    """A change of frame, applied in this order; headings change accordingly."""

    flip_y: bool = False  # whether to reverse the direction of y
    rotate: float = 0.0  # angle [rad] from the x axis towards the y axis
    shift: tuple[float, float] = (0.0, 0.0)  # shift in x and y [m]

    def apply(self, table: pd.DataFrame) -> pd.DataFrame:
        """The table of tracks in the new frame."""
        if self == Frame():
            return table
        sign = -1.0 if self.flip_y else 1.0
        x, y = table["x"], sign * table["y"]
        cos, sin = np.cos(self.rotate), np.sin(self.rotate)
        return table.assign(
            x=cos * x - sin * y + self.shift[0],
            y=sin * x + cos * y + self.shift[1],
            heading=sign * table["heading"] + self.rotate,
        )


@dataclass(frozen=True)
class Excerpt:
    """Which part of a file to use."""

    window: tuple[float, float] | None = None  # first and last time [s]. Default: all times
    #: Names in the wanted order. Default: all that are seen often enough.
    players: tuple[str, ...] = ()
    step: float | None = None  # time step of the result [s]. Default: that of the data
    most: int = MOST_PLAYERS  # largest number of players


@dataclass(frozen=True)
class Grid:
    """Tracks on common, equally spaced times."""

    times: np.ndarray  # (T,) times [s]
    players: list[str]  # names of the N players
    #: (T, N, 4) in the order of ``STATE_NAMES``, NaN where unknown; headings unwrapped.
    states: np.ndarray
    notes: tuple[str, ...] = field(default=())  # what was left out, one line each

    @property
    def step(self) -> float:
        """Time between two states [s]."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))


def on_grid(path: Path, table: pd.DataFrame, excerpt: Excerpt) -> Grid:
    """Put an excerpt of a table of tracks on a common time grid."""
    table, beyond = _window(path, table, excerpt.window)
    table, notes = _chosen(path, table, excerpt.players)
    notes = [*beyond, *notes]
    check_times(path, table)
    if excerpt.step is None:
        table, times, more = _on_own_times(path, table)
        notes += more
    else:
        times = _resampled_times(path, table, excerpt.step)
    names = list(excerpt.players) or list(table["player"].unique())
    if len(names) > excerpt.most:
        raise UserError(
            f"{path}: {len(names)} players, a game has at most {excerpt.most}; 'olne-bench groups' "
            f"finds those that interact; choose by --players; there are: {listed(names)}"
        )
    by_player = dict(list(table.groupby("player", sort=False)))
    bridged = _BRIDGED if excerpt.step else 0.0
    columns = [_resampled(by_player[name], times, bridged) for name in names]
    states = np.stack(columns, axis=1)
    seen = np.isfinite(states[..., :2]).all(axis=-1).sum(axis=0)
    notes += [
        f"player {name!r} is seen at {count} of {len(times)} times; the others are missing samples"
        for name, count in zip(names, seen, strict=True)
        if count < len(times)
    ]
    return Grid(times, names, states, tuple(notes))


def _window(
    path: Path, table: pd.DataFrame, window: tuple[float, float] | None
) -> tuple[pd.DataFrame, list[str]]:
    """The rows in a window, and a note if it is longer than the file."""
    if window is None or table.empty:
        return table, []
    first, last = window
    inside = table["time"].between(first - _ROUNDING, last + _ROUNDING)
    low, high = table["time"].min(), table["time"].max()
    told = f"--window {first:g},{last:g}: {path} has times from {low:g} to {high:g} s"
    if not inside.any():
        raise UserError(told)
    step = _usual_step(table)
    return table[inside], [told] if first < low - step or last > high + step else []


def _chosen(
    path: Path, table: pd.DataFrame, players: tuple[str, ...]
) -> tuple[pd.DataFrame, list[str]]:
    """Rows of the chosen players, or of all that are seen often enough, and notes."""
    with bad_input(str(path)):
        table, notes = (table, []) if players else vehicles(table)
    seen = table[table[["x", "y"]].notna().all(axis=1)].groupby("player", sort=False).size()
    known = list(table["player"].unique())
    for player in players:
        if player not in known:
            raise UserError(f"--players {player!r}: {path} has, at these times: {listed(known)}")
        if seen.get(player, 0) == 0:
            raise UserError(
                f"--players {player!r}: {path} has no position of this player at these times"
            )
    if players:
        return table[table["player"].isin(players)], notes
    brief = [name for name in known if seen.get(name, 0) < FEWEST_STEPS]
    if len(brief) == len(known):
        return table, notes  # nothing to choose from; the checks report the problem
    if brief:
        notes.append(f"left out, seen less than {FEWEST_STEPS} times: {listed(brief)}")
    return table[~table["player"].isin(brief)], notes


def _on_own_times(path: Path, table: pd.DataFrame) -> tuple[pd.DataFrame, np.ndarray, list[str]]:
    """The table with the times of a grid, the grid, and a note if times were not on it."""
    known, places = np.unique(table["time"], return_inverse=True)
    usual = _usual_step(table)
    steps = count_steps(path, known, usual)
    times = np.linspace(known[0], known[-1], steps[-1] + 1)
    if np.abs(known - times[steps]).max() > max(_ENDS * resolution(known), _ROUNDING):
        step = np.polyfit(steps, known - known[0], 1)[0]
        times = known[0] + step * np.arange(steps[-1] + 1)
    table = table.assign(time=times[steps][places])
    if table.duplicated(["player", "time"]).any():
        raise unequal_steps(path, known, usual)
    off = float(np.abs(known - times[steps]).max())
    if off <= max(resolution(known), _ROUNDING):
        return table, times, []
    step = (times[-1] - times[0]) / steps[-1]
    return (
        table,
        times,
        [
            f"times differ by up to {off:.2g} s from steps of {step:.6g} s; a sample counts at the "
            "nearest step"
        ],
    )


def _resampled_times(path: Path, table: pd.DataFrame, step: float) -> np.ndarray:
    known = np.unique(table["time"])
    if len(known):
        check_number_of_steps(path, known[-1] - known[0], step)
    count = int(np.floor((known[-1] - known[0]) / step + _ROUNDING)) if len(known) else 0
    if count + 1 < FEWEST_STEPS:
        raise UserError(
            f"--resample {step:g}: {path} has {count + 1} such steps, expected at least "
            f"{FEWEST_STEPS}"
        )
    return np.asarray(known[0] + step * np.arange(count + 1))


def _usual_step(table: pd.DataFrame) -> float:
    """The mean time between a player's samples [s] or 0; rounded times would mislead a median."""
    steps = table.sort_values("time").groupby("player")["time"].diff().dropna()
    steps = steps[np.abs(steps / steps.median() - 1) < _NEIGHBOURS]
    return float(steps.mean()) if len(steps) else 0.0


def _resampled(rows: pd.DataFrame, times: np.ndarray, bridged: float) -> np.ndarray:
    """States (T, 4) at times, interpolated over gaps of up to ``bridged`` steps; else NaN."""
    result = np.full((len(times), len(STATE_NAMES)), np.nan)
    rows = rows.sort_values("time")
    every = np.diff(rows["time"].to_numpy())
    usual = float(np.median(every)) if len(every) else 0.0
    for k, name in enumerate(STATE_NAMES):
        seen = rows[rows[name].notna()]
        if seen.empty:
            continue
        at, values = seen["time"].to_numpy(), seen[name].to_numpy()
        if name == "heading":
            values = np.unwrap(values)
        result[:, k] = _between(at, values, times, bridged * usual)
    return result


def _between(at: np.ndarray, values: np.ndarray, times: np.ndarray, bridged: float) -> np.ndarray:
    """Values at times; a sample also counts for times that differ from its own by rounding."""
    after = np.searchsorted(at, times).clip(0, len(at) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(at[after] - times) <= np.abs(at[before] - times), after, before)
    same = np.abs(at[nearest] - times) <= _ROUNDING
    inside = (at[before] <= times) & (times <= at[after]) & (at[after] - at[before] <= bridged)
    straight = np.interp(times, at, values)
    return np.where(same, values[nearest], np.where(inside, straight, np.nan))


@dataclass(frozen=True)
class Motion:
    """One player's motion; NaN where unknown."""

    positions: np.ndarray  # (T, 2) positions [m]
    headings: np.ndarray  # (T,) headings [rad], given or computed from the positions
    speeds: np.ndarray  # (T,) speeds [m/s], given or computed from the positions

    @classmethod
    def of(cls, states: np.ndarray, names: list[str], dt: float) -> "Motion":
        """The motion in states (T, n) with these names of components."""
        positions = states[:, :2]
        velocity = _velocity(positions, dt)
        speeds = np.linalg.norm(velocity, axis=1)
        headings = np.where(speeds > SLOWEST, np.arctan2(velocity[:, 1], velocity[:, 0]), np.nan)
        for name, values in zip(names, states.T, strict=True):
            if name == "heading":
                headings = np.where(np.isfinite(values), values, headings)
            if name == "speed":
                speeds = np.where(np.isfinite(values), values, speeds)
        seen = np.isfinite(headings)
        headings[seen] = np.unwrap(headings[seen])
        return cls(positions, headings, speeds)

    @property
    def seen(self) -> np.ndarray:
        """(T,) whether there is a position."""
        return np.asarray(np.isfinite(self.positions).all(axis=1))


def roughness(positions: np.ndarray) -> float:
    """Estimate the noise of positions (T, N, 2) [m] from their roughness.

    The third differences of white noise have the variance 20 sigma^2; those of a motion whose
    acceleration hardly changes within a few steps are about zero. The motion can only add to them,
    so this is an upper estimate. It is NaN if there are no four samples in a row.
    """
    rough = np.diff(positions, n=_ROUGHNESS_ORDER, axis=0)
    rough = rough[np.isfinite(rough)]
    return float(np.sqrt(np.mean(rough**2) / _ROUGHNESS_NORM)) if rough.size else float("nan")


def _velocity(positions: np.ndarray, dt: float) -> np.ndarray:
    """Velocities (T, 2) [m/s] from neighbouring samples; NaN where there are none."""
    seen = np.flatnonzero(np.isfinite(positions).all(axis=1))
    velocity = np.full(positions.shape, np.nan)
    if len(seen) > 1:
        velocity[seen] = np.gradient(positions[seen], seen * dt, axis=0)
    return velocity
