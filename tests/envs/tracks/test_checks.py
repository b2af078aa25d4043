"""Implausible tracks are refused; those just within the limits are not."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.tracks.checks import check_positions, check_steps, check_times, check_units
from olne_bench.errors import UserError

PATH = Path("some.csv")
DT = 0.25
NAMES = ["still", "car"]


def states(speed: float = 8.0, heading: float = 0.7, count: int = 13) -> np.ndarray:
    """States (T, 2, 4) of a car that stands, and of one that drives straight ahead."""
    at = DT * np.arange(count)
    car = [speed * np.cos(heading) * at, speed * np.sin(heading) * at]
    moving = np.column_stack([*car, np.full(count, heading), np.full(count, speed)])
    still = np.tile([1.0, 2.0, 0.0, 0.0], (count, 1))
    return np.stack([still, moving], axis=1)


def said_of(told: np.ndarray, players: list[str] = NAMES, dt: float = DT) -> str:
    """The message of the check on states; empty if they pass."""
    try:
        check_units(PATH, told, dt, players)
    except UserError as error:
        return str(error)
    return ""


def test_the_first_repetition_is_named() -> None:
    table = pd.DataFrame({"player": list("aabab"), "time": [0.0, 1.0, 1.0, 1.0, 1.0]})
    with pytest.raises(UserError, match=r"some.csv: player 'a' has time 1 twice"):
        check_times(PATH, table)
    check_times(PATH, table.iloc[:3])


def test_steps_may_be_whole_multiples_and_rounded() -> None:
    check_steps(PATH, np.array([0.0, 1.0, 2.0, 5.0, 6.0, 7.0]))
    check_steps(PATH, np.array([0.0, 1.0, 2.04, 3.0, 4.0]))
    check_steps(PATH, np.array([0.0, 10.0, 20.0]))
    for times, words in (
        ([0.0, 1.0], "has 2 times, expected at least 3"),
        ([0.0, 10.1, 20.2], "time steps of 10.1, above 10 s"),
        ([0.0, 1.0, 2.13, 3.13, 4.13], "unequal time steps: 1.13 s after time 1, mostly 1 s"),
        ([0.0, 1.0, 2.0, 2.3, 3.3], "unequal time steps: 0.3 s after time 2, mostly 1 s"),
        ([0.0, 1.0, 2.0, 2.02, 3.02], "unequal time steps: 0.02 s after time 2, mostly 1 s"),
        ([0.0, 1.0, 2.0, 4.4, 5.4], "unequal time steps: 2.4 s after time 2, mostly 1 s"),
    ):
        with pytest.raises(UserError, match=words):
            check_steps(PATH, np.array(times))


def test_a_position_has_both_coordinates() -> None:
    told = states()
    told[1:, 1, 0] = np.nan
    check_positions(PATH, told, NAMES)
    told[0, 1, 1] = np.nan
    with pytest.raises(UserError, match=r"some.csv: player 'car' has no position at any time"):
        check_positions(PATH, told, NAMES)


@pytest.mark.parametrize("heading", [-3.0, -1.0, 0.7, 2.0])
@pytest.mark.parametrize("dt", [0.05, DT, 2.0])
def test_who_drives_as_told_is_not_refused(heading: float, dt: float) -> None:
    told = states(heading=heading)
    told[..., :2] *= dt / DT
    assert not said_of(told, dt=dt)
    told[:, 1, 2:] += [np.pi, 0.0]  # the same in reverse
    told[:, 1, 3] *= -1
    assert not said_of(told, dt=dt)


@pytest.mark.parametrize("off", [0.9 * np.pi / 3, 1.1 * np.pi / 3, np.pi])
@pytest.mark.parametrize("sign", [-1, 1])
def test_headings_may_not_point_away(off: float, sign: int) -> None:
    told = states()
    told[:, 1, 2] += sign * off
    assert ("car' has headings that point away" in said_of(told)) == (off > np.pi / 3)


def test_headings_are_judged_by_all_times_at_which_a_car_drives() -> None:
    told = states()
    told[:4, 1, 2] += np.pi
    assert not said_of(told)
    told[:8, 1, 2] = 0.7 + np.pi
    assert "point away" in said_of(told)
    for speed in (0.9, 1.1):
        slow = states(speed)
        slow[:, 1, 2] += np.pi
        assert ("point away" in said_of(slow)) == (speed > 1)


@pytest.mark.parametrize(
    ("factor", "refused"), [(1.9, False), (2.1, True), (0.55, False), (0.45, True)]
)
def test_speeds_and_displacements_agree_to_a_factor_of_two(factor: float, refused: bool) -> None:
    told = states()
    told[:, 1, 3] = factor * told[:, 1, 3]
    said = said_of(told)
    assert bool(said) == refused
    if refused:
        told_and_seen = f"mean speed of {8 * factor:.3g}, but its positions move at 8 m/s"
        assert f"car' has a {told_and_seen}" in said


def test_speeds_of_those_who_hardly_move_are_not_compared() -> None:
    told = states()
    told[:, 0, 3] = 1.9
    assert not said_of(told)
    told[:, 0, 3] = 2.1
    assert "'still' has a mean speed of 2.1" in said_of(told)
    alone = told[:, :1]
    for speed, refused in ((0.04, False), (0.06, True)):
        alone[:, 0, 3] = speed
        assert bool(said_of(alone, NAMES[:1])) == refused


def test_speeds_are_means_over_the_windows_that_displacements_span() -> None:
    at = DT * np.arange(25)
    told = states(count=25)
    told[:, 1, 0], told[:, 1, 1] = 0.5 * 4 * at**2, 0.0  # from standstill
    told[:, 1, 2], told[:, 1, 3] = 0.0, 4 * at
    for factor, refused in ((1.93, False), (2.07, True), (1 / 1.93, False), (1 / 2.07, True)):
        scaled = told.copy()
        scaled[:, 1, 3] *= factor
        assert ("mean speed" in said_of(scaled)) == refused
    assert not said_of(np.where(np.arange(25)[:, None, None] < 20, told, np.nan))


def test_noise_of_positions_is_no_speed() -> None:
    """Over one step of 0.05 s this noise moves at 0.8 m/s, over a second at 0.04."""
    still = states(count=41)[:, :1]
    still[:, 0, :2] += np.random.default_rng(0).normal(0, 0.02, (41, 2))
    check_units(PATH, still, 0.05, NAMES[:1])
    with pytest.raises(UserError, match="mean speed of 0, but its positions move"):
        check_units(PATH, still[:5], 0.05, NAMES[:1])


@pytest.mark.parametrize(
    ("component", "value", "words"),
    [
        (3, 100.5, "car' has a speed of 100.5, above 100 m/s"),
        (3, -101.0, "car' has a speed of 101, above 100 m/s"),
        (2, 25.2, "car' has a heading of 25.2; expected radians"),
        (2, -25.2, "car' has a heading of 25.2; expected radians"),
    ],
)
def test_one_impossible_sample_will_do(component: int, value: float, words: str) -> None:
    told = states()
    told[5, 1, component] = value
    assert words in said_of(told)
    told[5, 1, component] *= 0.99
    assert words not in said_of(told)


def test_positions_that_are_no_metres_are_refused() -> None:
    told = states()
    told[:, 1, 2:] = np.nan
    assert not said_of(told)
    told[:, 1, :2] *= 12.4
    assert not said_of(told)
    told[:, 1, :2] *= 1.02
    assert "'car' moves at 101.184 m/s, above 100; expected x and y in metres" in said_of(told)
