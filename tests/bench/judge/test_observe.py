from dataclasses import replace

import numpy as np
import pytest

from olne_bench.bench.judge.observe import sense
from olne_bench.envs.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.observation import VIEWS


@pytest.fixture(scope="module")
def recording():
    return record(get_scenario("two_player"))


def test_views_share_their_noise(recording):
    full = sense(recording, VIEWS["full"], 0.1, seed=3)
    partial = sense(recording, VIEWS["partial"], 0.1, seed=3)
    np.testing.assert_array_equal(full.y[..., :3], partial.y)
    np.testing.assert_array_equal(full.extra[..., :3], partial.extra)


def test_noise_free_observations_are_the_states(recording):
    observation = sense(recording, VIEWS["full"], 0.0, seed=0)
    np.testing.assert_array_equal(observation.y, recording.states)
    np.testing.assert_array_equal(observation.extra, recording.extra_state)


def test_noise_is_reproducible_white_and_of_the_stated_size(recording):
    draws = [sense(recording, VIEWS["full"], 0.05, s).y - recording.states for s in range(200)]
    again = sense(recording, VIEWS["full"], 0.05, 7).y - recording.states
    np.testing.assert_array_equal(draws[7], again)
    noise = np.array(draws)
    assert noise.std() == pytest.approx(0.05, rel=0.02)
    assert abs(noise.mean()) < 1e-3
    correlation = np.corrcoef(noise[:, :-1].ravel(), noise[:, 1:].ravel())[0, 1]
    assert abs(correlation) < 0.02


def test_levels_and_seeds_have_streams_of_their_own(recording):
    def unit(sigma, seed):
        return (sense(recording, VIEWS["full"], sigma, seed).y - recording.states) / sigma

    assert not np.allclose(unit(0.1, 0), unit(0.1, 1))
    assert not np.allclose(unit(0.1, 0), unit(0.2, 0))


def test_noise_has_the_scale_of_the_scenario(recording):
    scale = (1.0, 1.0, 0.1, 2.0)
    scaled = replace(recording, scenario=replace(recording.scenario, noise_scale=scale))
    for view in VIEWS.values():
        noise = sense(recording, view, 0.3, 4).y - sense(recording, view, 0.0, 4).y
        other = sense(scaled, view, 0.3, 4).y - sense(scaled, view, 0.0, 4).y
        relative = view.noise_scale(np.array(scale), recording.scenario.game.dynamics)
        np.testing.assert_allclose(other, noise * relative, rtol=1e-9, atol=1e-15)
