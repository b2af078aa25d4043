"""Excerpts on a common time grid: which times, which samples, what is left out."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.tracks.grid import MOST_PLAYERS, Excerpt, Grid, on_grid
from olne_bench.errors import UserError

PATH = Path("some.csv")


def track(player: str, times: np.ndarray | list[float], speed: float = 3.0) -> pd.DataFrame:
    """Straight ahead along x."""
    at = np.asarray(times, dtype=float)
    states = {"x": speed * at, "y": 1.0, "heading": 0.0, "speed": speed}
    return pd.DataFrame({"time": at, "player": player, **states})


def grid(*tracks: pd.DataFrame, **excerpt: object) -> Grid:
    return on_grid(PATH, pd.concat(tracks, ignore_index=True), Excerpt(**excerpt))  # type: ignore[arg-type]


EVERY = 0.1 * np.arange(41)


def test_a_window_has_its_ends_and_nothing_outside() -> None:
    found = grid(track("a", EVERY), window=(0.3, 1.2))
    np.testing.assert_allclose(found.times, EVERY[3:13])
    np.testing.assert_allclose(found.states[:, 0, 0], 3 * found.times)
    assert found.step == pytest.approx(0.1)
    assert found.notes == ()


def test_a_window_between_times_is_refused_with_the_times_there_are() -> None:
    with pytest.raises(UserError, match=r"--window 0.31,0.39: some.csv has times from 0 to 4 s"):
        grid(track("a", EVERY), window=(0.31, 0.39))


def test_players_come_in_the_order_asked_for() -> None:
    tracks = [track(name, EVERY, speed) for name, speed in (("a", 1.0), ("b", 2.0), ("c", 3.0))]
    found = grid(*tracks, players=("c", "a"))
    assert found.players == ["c", "a"]
    np.testing.assert_allclose(found.states[-1, :, 0], [12.0, 4.0])
    with pytest.raises(UserError, match=r"--players 'd': some.csv has, at these times: a, b, c"):
        grid(*tracks, players=("a", "d"))
    with pytest.raises(UserError, match=r"--players 'b': some.csv has no position of this player"):
        grid(tracks[0], tracks[1].assign(x=np.nan), players=("b",))


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_who_is_seen_less_than_three_times_is_left_out(samples: int) -> None:
    brief = track("b", EVERY)
    brief.loc[samples:, "y"] = np.nan
    found = grid(track("a", EVERY), brief)
    assert ("b" in found.players) == (samples == 3)
    begins = "player 'b' is seen at 3 of 41" if samples == 3 else "left out, seen less than 3 times"
    assert len(found.notes) == 1 and found.notes[0].startswith(begins)


def test_as_many_players_as_a_game_holds_are_taken() -> None:
    tracks = [track(str(k), EVERY[:3]) for k in range(MOST_PLAYERS)]
    assert len(grid(*tracks).players) == MOST_PLAYERS
    with pytest.raises(UserError, match=f"{MOST_PLAYERS + 1} players"):
        grid(*tracks, track("more", EVERY[:3]))


@pytest.mark.parametrize("step", [0.04, 0.1, 0.25, 2.0])
def test_resampled_times_go_as_far_as_the_data(step: float) -> None:
    found = grid(track("a", EVERY + 7.0), step=step)
    assert found.times[0] == 7.0
    np.testing.assert_allclose(np.diff(found.times), step)
    assert 0 <= 11.0 - found.times[-1] + 1e-9 < step
    np.testing.assert_allclose(found.states[:, 0, 0], 3 * found.times)
    with pytest.raises(UserError, match=r"--resample 2.5: some.csv has 2 such steps, expected at"):
        grid(track("a", EVERY), step=2.5)


def test_gaps_of_a_step_or_more_are_not_bridged() -> None:
    found = grid(track("a", EVERY), track("b", np.delete(EVERY, [10, 20, 21])), step=0.05)
    unseen = found.times[np.isnan(found.states[:, 1, 0])]
    np.testing.assert_allclose(unseen, [0.95, 1.0, 1.05, 1.95, 2.0, 2.05, 2.1, 2.15])
    assert np.isfinite(found.states[:, 0]).all()


def test_nobody_is_seen_before_the_first_or_after_the_last_sample() -> None:
    found = grid(track("a", EVERY), track("b", EVERY[5:30]), step=0.05)
    seen = found.times[np.isfinite(found.states[:, 1, 0])]
    np.testing.assert_allclose(seen[[0, -1]], EVERY[[5, 29]])
    np.testing.assert_allclose(found.states[10:59, 1, 0], 3 * seen)


def test_a_clock_that_differs_a_little_makes_no_further_times() -> None:
    late = track("b", EVERY + 0.004)
    late["x"] = np.arange(41.0)
    found = grid(track("a", EVERY), late)
    np.testing.assert_allclose(found.times, np.linspace(0, 4, 41), atol=0.005)
    # Its samples are those of the nearest times, unchanged.
    np.testing.assert_array_equal(found.states[:, 1, 0], np.arange(41.0))


def test_times_that_belong_to_no_grid_are_refused() -> None:
    with pytest.raises(UserError, match="unequal time steps"):
        grid(track("a", EVERY), track("b", EVERY + 0.04))


def test_headings_do_not_jump_by_a_turn() -> None:
    car = track("a", EVERY)
    heading = np.linspace(2.5, 9.0, 41)
    car["heading"] = (heading + np.pi) % (2 * np.pi) - np.pi
    car.loc[7, "heading"] = np.nan
    found = grid(car, step=0.05).states[:, 0, 2]
    expected = np.linspace(2.5, 9.0, 81)
    expected[13:16] = np.nan
    np.testing.assert_allclose(found, expected)


def test_what_is_told_at_some_times_only_is_known_there() -> None:
    car = track("a", EVERY)
    car.loc[1::2, "speed"] = np.nan
    car["heading"] = np.nan
    states = grid(car).states[:, 0]
    np.testing.assert_array_equal(np.isnan(states[:, 3]), np.arange(41) % 2 == 1)
    assert np.isnan(states[:, 2]).all() and np.isfinite(states[:, :2]).all()


def test_gaps_that_are_far_longer_than_a_step_merge_no_times() -> None:
    times = np.concatenate([np.arange(5) * 0.04 + gap for gap in (0.0, 2.0, 4.0)])
    found = grid(track("a", times))
    assert found.step == pytest.approx(0.04)
    assert len(found.times) == 105
    with pytest.raises(UserError, match="expected at most 100000"):
        grid(track("a", [*times, 1e9]))
