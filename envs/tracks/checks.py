"""Checks of tracks: each raises a ``UserError`` that names the place, or does nothing."""

from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.road import FARTHEST, check_shown
from olne_bench.errors import UserError

FEWEST_STEPS = 3
FASTEST = 100.0  # [m/s]; above it, something is not in metres and seconds
LONGEST_STEP = 10.0  # [s]; above it, times are not in seconds
SHORTEST_STEP = 1e-4  # [s]; below it, times are not in seconds
MOST_STEPS = 100_000  # of a recording: hours of video
LATEST = 1e13  # [s]; times beyond it cannot be told apart
LARGEST_HEADING = 8 * np.pi  # [rad], four full turns; above it, headings are in degrees
STEP_TOLERANCE = 0.05  # as a share of a step, for clocks that are not exact
_EXACT = 1e-6  # [s], tolerance of computed times
_MOST_DIGITS, _WHOLE = 6, 1e-3  # of times that were rounded; tolerance of a whole number
UNIT_FACTOR = 2.0  # largest ratio of speeds to displacements; miles per hour differ by 2.2
UNIT_WINDOW = 1.0  # [s] for displacements; noise would dominate shorter ones
LEAST_AGREEMENT = 0.5  # median cosine of the angle between heading and motion
DRIVING = 1.0  # [m/s] above which headings must agree with the direction of motion
DEGREES = 2e-3  # [1/s], more than the change of a longitude or a latitude of cars
#: [m/s], the same where others are faster, by whom units show: tracks of who creeps are rough.
CREEPING = 2.0
STANDSTILL = 0.05  # [m/s] below which speeds and displacements are not compared


def check_table(path: Path, table: pd.DataFrame) -> None:
    """Refuse rows without a time, infinite numbers, and names that cannot be shown."""
    times = table["time"].to_numpy(dtype=float)
    wrong = ~(np.abs(times) < LATEST)
    if wrong.any():
        row = int(wrong.argmax())
        raise UserError(
            f"{path}, row {row + 1}: its time is {times[row]:g}, expected a number of seconds"
        )
    for name in ("x", "y", "heading", "speed"):
        endless = np.isinf(table[name].to_numpy(dtype=float))
        if endless.any():
            raise UserError(
                f"{path}, row {int(endless.argmax()) + 1}: {name} is infinite; a value that is "
                "not known is left empty"
            )
    for player in table["player"].unique():
        check_name(str(path), player)


def check_name(place: str, player: str) -> None:
    """Refuse a player's name that is empty, long, or has characters that are not seen."""
    try:
        check_shown("player", player)
    except ValueError as error:
        raise UserError(f"{place}: {error}") from error


def check_times(path: Path, table: pd.DataFrame) -> None:
    """Refuse players with two rows at one time."""
    again = table.duplicated(["player", "time"]).to_numpy()
    if again.any():
        row = table.iloc[int(again.argmax())]
        raise UserError(f"{path}: player {row['player']!r} has time {row['time']:g} twice")


def check_steps(path: Path, times: np.ndarray) -> None:
    """Refuse times (T,) of a recording that are too few, not on a grid or not in seconds."""
    usual = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    steps = count_steps(path, times, usual)
    if (np.diff(steps) < 1).any():
        raise unequal_steps(path, times, usual)


def count_steps(path: Path, times: np.ndarray, usual: float) -> np.ndarray:
    """The number of steps (T,) before each of rising times (T,), if a step is ``usual`` [s].

    Times may differ from a grid as they do where they were rounded, or by ``STEP_TOLERANCE``.
    UserError if they are too few, not on a grid, or not in seconds.
    """
    if len(times) < FEWEST_STEPS:
        raise UserError(f"{path} has {len(times)} times, expected at least {FEWEST_STEPS}")
    for wrong, side, limit in (
        (usual < SHORTEST_STEP, "below", SHORTEST_STEP),
        (usual > LONGEST_STEP, "above", LONGEST_STEP),
    ):
        if wrong:
            raise UserError(
                f"{path}: time steps of {usual:g}, {side} {limit:g} s; expected time in seconds"
            )
    span = float(times[-1] - times[0])
    check_number_of_steps(path, span, usual)
    steps = np.zeros(len(times), dtype=int)
    steps[1:] = np.cumsum(np.round(np.diff(times) / usual))
    step = span / max(steps[-1], 1)
    if (np.abs(times - times[0] - step * steps) > _tolerance(times, step)).any():
        raise unequal_steps(path, times, usual)
    return steps


def _tolerance(times: np.ndarray, step: float) -> float:
    """By how much times may differ from a grid whose ends are the first and the last of them."""
    unit = resolution(times)
    rounded = unit > 0 and abs(step / unit - round(step / unit)) > STEP_TOLERANCE
    return max(STEP_TOLERANCE * step, unit if rounded else 0.0) + _EXACT


def resolution(times: np.ndarray) -> float:
    """The power of ten [s] to which times are rounded; 0 if they are not."""
    for digits in range(_MOST_DIGITS + 1):
        scaled = times * 10.0**digits
        if (np.abs(scaled - np.round(scaled)) < _WHOLE).all():
            return float(10.0**-digits)
    return 0.0


def unequal_steps(path: Path, times: np.ndarray, usual: float) -> UserError:
    """What to say of times (T,) that are not on a grid."""
    steps = np.diff(times)
    k = int(np.abs(steps / usual - np.round(steps / usual).clip(1)).argmax())
    return UserError(
        f"{path}: unequal time steps: {steps[k]:g} s after time {times[k]:g}, mostly "
        f"{usual:.2g} s; --resample {usual:.2g} makes them equal"
    )


def check_number_of_steps(path: Path, seconds: float, step: float) -> None:
    """Refuse more steps than a recording can have, before there are arrays of so many."""
    if not seconds / step < MOST_STEPS:
        raise UserError(
            f"{path} spans {seconds:g} s, {seconds / step:.3g} steps of {step:g} s; expected at "
            f"most {MOST_STEPS}: choose a shorter --window or a longer --resample"
        )


def check_positions(path: Path, states: np.ndarray, players: list[str]) -> None:
    """Refuse players without any position in states (T, N, 4), or who are not on the earth."""
    for i, player in enumerate(players):
        farthest = np.nanmax(np.abs(states[:, i, :2]), initial=0.0)
        if farthest > FARTHEST:
            raise UserError(
                f"{path}: player {player!r} is at a position of {farthest:g}, beyond "
                f"{FARTHEST:g} m; expected metres"
            )
        if not np.isfinite(states[:, i, :2]).all(axis=-1).any():
            raise UserError(f"{path}: player {player!r} has no position at any time")


def check_units(path: Path, states: np.ndarray, dt: float, players: list[str]) -> None:
    """Refuse states (T, N, 4), px, py, heading, speed, not in metres, seconds and radians."""
    for problem in unit_problems(path, states, dt, players).values():
        raise UserError(problem)


def unit_problems(path: Path, states: np.ndarray, dt: float, players: list[str]) -> dict[str, str]:
    """What speaks against the units of each player; UserError on what speaks against all."""
    window = min(len(states) - 1, max(1, round(UNIT_WINDOW / dt)))
    steps = states[window:, :, :2] - states[:-window, :, :2]
    from_positions = np.linalg.norm(steps, axis=-1) / (window * dt)
    # Cosine of the angle between heading and motion; a car in reverse has a negative speed.
    off = states[:-window, :, 2] - np.arctan2(steps[..., 1], steps[..., 0])
    agreement = np.cos(off) * np.where(states[:-window, :, 3] < 0, -1, 1)
    agreement[~(from_positions > DRIVING)] = np.nan
    _check_metres(path, states, from_positions)
    fast = np.nanmax(from_positions, initial=0.0) > CREEPING
    problems = {}
    for i, player in enumerate(players):
        who, speeds, moved = (
            f"{path}: player {player!r}",
            np.abs(states[:, i, 3]),
            from_positions[:, i],
        )
        try:
            _check_sizes(who, speeds, moved, np.abs(states[:, i, 2]))
            _check_headings(who, agreement[np.isfinite(agreement[:, i]), i])
            _check_speeds(who, speeds, moved, CREEPING if fast else STANDSTILL)
        except UserError as error:
            problems[player] = str(error)
    return problems


def _check_headings(who: str, agreement: np.ndarray) -> None:
    if agreement.size and np.median(agreement) < LEAST_AGREEMENT:
        raise UserError(
            f"{who} has headings that point away from its motion; expected "
            "radians, from the x axis towards the y axis"
        )


def _check_metres(path: Path, states: np.ndarray, from_positions: np.ndarray) -> None:
    """Refuse positions that change steadily, or while cars drive, but by hardly anything."""
    fastest = float(np.nanmax(from_positions, initial=0.0))
    steps = np.diff(states[..., :2], axis=0)
    straight = np.linalg.norm(np.nansum(steps, axis=0), axis=-1)
    along = np.nansum(np.linalg.norm(steps, axis=-1), axis=0)
    driven = (straight > along / 2).any() or np.nanmax(np.abs(states[..., 3]), initial=0) > DRIVING
    if 0 < fastest < DEGREES and driven:
        raise UserError(
            f"{path}: x and y change by at most {fastest:.2g} per second; expected metres, are "
            "these degrees?"
        )


def _check_sizes(
    who: str, speeds: np.ndarray, from_positions: np.ndarray, headings: np.ndarray
) -> None:
    for values, most, words in (
        (speeds, FASTEST, "has a speed of {0:g}, above {1:g} m/s; expected metres per second"),
        (
            from_positions,
            FASTEST,
            "moves at {0:g} m/s, above {1:g}; expected x and y in metres and time in seconds",
        ),
        (headings, LARGEST_HEADING, "has a heading of {0:g}; expected radians"),
    ):
        if (values > most).any():
            raise UserError(f"{who} {words.format(np.nanmax(values), most)}")


def _check_speeds(who: str, speeds: np.ndarray, from_positions: np.ndarray, least: float) -> None:
    """Compare given speeds (T,) above ``least`` with those of positions (T - window,)."""
    window = len(speeds) - len(from_positions)
    both = np.isfinite(speeds[window:]) & np.isfinite(from_positions)
    if not both.any():
        return
    windows = np.lib.stride_tricks.sliding_window_view(speeds, window + 1)
    mean_speed = float(np.nanmean(windows[both], axis=1).mean())
    seen = float(from_positions[both].mean())
    if max(mean_speed, seen) > max(least, UNIT_FACTOR * min(mean_speed, seen)):
        raise UserError(
            f"{who} has a mean speed of {mean_speed:.3g}, but its positions move at "
            f"{seen:.3g} m/s; expected metres, seconds and metres per second"
        )
