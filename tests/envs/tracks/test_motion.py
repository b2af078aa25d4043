"""Motion of one track: given values first, else values from positions."""

import numpy as np
import pytest

from olne_bench.envs.tracks.grid import Motion, roughness

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
