"""Tracks on a grid: frames, windows, steps, gaps; motion and its noise."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.envs.tracks.grid import (
    MOST_PLAYERS,
    Excerpt,
    Frame,
    Grid,
    Motion,
    on_grid,
    roughness,
)
from olne_bench.envs.tracks.table import COLUMNS
from olne_bench.errors import UserError

PATH = Path("some.csv")


def track(player: str, times: np.ndarray | list[float], speed: float = 3.0) -> pd.DataFrame:
    """Straight ahead along x."""
    at = np.asarray(times, dtype=float)
    states = {"x": speed * at, "y": 1.0, "heading": 0.0, "speed": speed}
    return pd.DataFrame({"time": at, "player": player, **states})


def grid(*tracks: pd.DataFrame, **excerpt: object) -> Grid:
    table = pd.concat(tracks, ignore_index=True).reindex(columns=list(COLUMNS))
    return on_grid(PATH, table, Excerpt(**excerpt))  # type: ignore[arg-type]


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


def test_a_window_that_is_longer_than_the_file_is_told() -> None:
    said = "--window -1,9: some.csv has times from 0 to 4 s"
    assert grid(track("a", EVERY), window=(-1, 9)).notes == (said,)
    assert grid(track("a", EVERY), window=(-0.05, 4.05)).notes == ()


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
    left_out = "left out, seen less than 3 times: b"
    begins = "player 'b' is seen at 3 of 41" if samples == 3 else left_out
    assert len(found.notes) == 1 and found.notes[0].startswith(begins)


def test_as_many_players_as_a_game_holds_are_taken() -> None:
    tracks = [track(str(k), EVERY[:3]) for k in range(MOST_PLAYERS)]
    assert len(grid(*tracks).players) == MOST_PLAYERS
    with pytest.raises(UserError, match=f"{MOST_PLAYERS + 1} players, a game has at most 20"):
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


HEADING = 0.4
TABLE = pd.DataFrame(
    {
        "x": 2.0 + np.cos(HEADING) * np.arange(4),
        "y": 5.0 + np.sin(HEADING) * np.arange(4),
        "heading": HEADING,
        "speed": 1.0,
    }
)
FRAMES = [
    Frame(flip_y=flip, rotate=turn, shift=shift)
    for flip in (False, True)
    for turn in (0.0, 0.7, -2.0)
    for shift in ((0.0, 0.0), (30.0, -4.0))
]


@pytest.mark.parametrize("frame", FRAMES, ids=str)
def test_headings_point_along_the_motion_in_every_frame(frame: Frame) -> None:
    moved = frame.apply(TABLE)
    along = np.diff(moved[["x", "y"]], axis=0)
    heading = moved["heading"].to_numpy()[:3]
    np.testing.assert_allclose(along, np.column_stack([np.cos(heading), np.sin(heading)]))
    pd.testing.assert_series_equal(moved["speed"], TABLE["speed"])


def test_a_frame_is_mirrored_then_turned_then_shifted() -> None:
    mirrored = Frame(flip_y=True).apply(TABLE)
    np.testing.assert_array_equal(mirrored["x"], TABLE["x"])
    np.testing.assert_array_equal(mirrored["y"], -TABLE["y"])
    turned = Frame(rotate=0.7).apply(mirrored)
    np.testing.assert_allclose(np.hypot(turned["x"], turned["y"]), np.hypot(TABLE["x"], TABLE["y"]))
    shifted = Frame(shift=(30.0, -4.0)).apply(turned)
    np.testing.assert_allclose(shifted[["x", "y"]] - turned[["x", "y"]], np.tile([30, -4], (4, 1)))
    pd.testing.assert_frame_equal(
        Frame(flip_y=True, rotate=0.7, shift=(30.0, -4.0)).apply(TABLE), shifted
    )


def test_the_same_frame_changes_nothing() -> None:
    assert Frame().apply(TABLE) is TABLE


DT = 0.2
NAMES = ["px", "py", "heading", "speed"]


def circle(speed: float = 6.0, radius: float = 20.0, count: int = 200) -> np.ndarray:
    """States (T, 4) on a circle, counter-clockwise; headings beyond pi."""
    phase = speed / radius * DT * np.arange(count)
    position = radius * np.column_stack([np.cos(phase), np.sin(phase)])
    return np.column_stack([position, phase + np.pi / 2, np.full(count, speed)])


def test_positions_alone_give_headings_and_speeds() -> None:
    states = circle()
    motion = Motion.of(states[:, :2], NAMES[:2], DT)
    inner = slice(1, -1)
    np.testing.assert_allclose(motion.speeds[inner], 6.0, rtol=1e-2)
    # Unwrapped: headings keep growing over turns.
    np.testing.assert_allclose(motion.headings[inner], states[inner, 2], atol=1e-2)
    np.testing.assert_array_equal(motion.positions, states[:, :2])
    assert motion.seen.all()


def test_told_values_come_first_and_positions_fill_in() -> None:
    states = circle()
    states[:, 3] += 1.0
    states[:, 2] += 0.3
    states[50, 3] = states[60, 2] = np.nan
    motion = Motion.of(states, NAMES, DT)
    others = np.arange(200) != 50
    np.testing.assert_array_equal(motion.speeds[others], states[others, 3])
    assert motion.speeds[50] == pytest.approx(6.0, rel=1e-2)
    headings = states[:, 2] - 0.3 * (np.arange(200) == 60)
    headings[60] = circle()[60, 2]
    np.testing.assert_allclose(motion.headings, headings, atol=1e-2)


def test_components_of_other_names_say_nothing() -> None:
    states = circle()
    motion = Motion.of(states, ["px", "py", "yaw", "pace"], DT)
    expected = Motion.of(states[:, :2], NAMES[:2], DT)
    np.testing.assert_array_equal(motion.headings, expected.headings)
    np.testing.assert_array_equal(motion.speeds, expected.speeds)


def test_gaps_are_spanned_by_the_samples_beside_them() -> None:
    states = circle()[:, :2]
    straight = np.column_stack([6.0 * DT * np.arange(9), np.zeros(9)])
    straight[3:5] = np.nan
    motion = Motion.of(straight, NAMES[:2], DT)
    np.testing.assert_array_equal(motion.seen, ~np.isin(np.arange(9), [3, 4]))
    np.testing.assert_allclose(motion.speeds[motion.seen], 6.0)
    assert np.isnan(motion.speeds[3:5]).all()
    states[1:] = np.nan
    alone = Motion.of(states, NAMES[:2], DT)
    assert np.isnan(alone.speeds).all() and np.isnan(alone.headings).all()
    assert alone.seen.sum() == 1
    half = np.array([[0.0, 0.0], [1.0, np.nan], [2.0, 0.0]])
    np.testing.assert_array_equal(Motion.of(half, NAMES[:2], DT).seen, [True, False, True])


def test_who_hardly_moves_has_no_heading() -> None:
    for speed, known in ((0.09, False), (0.11, True)):
        positions = np.column_stack([speed * DT * np.arange(5), np.zeros(5)])
        assert np.isfinite(Motion.of(positions, NAMES[:2], DT).headings).all() == known


@pytest.mark.parametrize("sigma", [0.01, 0.5])
def test_roughness_is_the_noise_of_white_noise(sigma: float) -> None:
    noise = np.random.default_rng(1).normal(0, sigma, (4000, 2, 2))
    assert roughness(noise) == pytest.approx(sigma, rel=0.05)
    at = DT * np.arange(4000.0)
    smooth = np.stack([at + 0.3 * at**2, 5 - at], axis=1)[:, None]
    assert roughness(noise + smooth) == pytest.approx(sigma, rel=0.05)
    noise[::40] = np.nan
    assert roughness(noise) == pytest.approx(sigma, rel=0.05)
    assert np.isnan(roughness(noise[1:4]))
    assert np.isfinite(roughness(noise[1:5]))
