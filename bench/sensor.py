"""The sensor: what an estimator gets to see of a recording."""

import zlib

import numpy as np

from envs.recording import Recording
from estimators.protocol import Observation
from games.observation import View, observe

#: Noise levels are told apart to a billionth when the noise is seeded.
_SIGMA_STEPS = 1e9


def sense(recording: Recording, view: View, sigma: float, seed: int) -> Observation:
    """Observe a recording through a view, with additive white Gaussian noise.

    The noise belongs to (scenario, sigma, seed): it is drawn for the full state and masked
    afterwards, so that all views and estimators meet the same noise and comparisons are paired.

    Args:
        recording: the episode.
        view: observation model.
        sigma: standard deviation of each state component's noise, in the component's unit.
        seed: of the sequence.

    Returns:
        ``y`` (T, N, d) and the sample at T+1, ``extra`` (N, d).
    """
    scenario = recording.scenario
    rng = np.random.default_rng(
        [zlib.crc32(scenario.name.encode()), round(sigma * _SIGMA_STEPS), seed]
    )
    states = np.concatenate([recording.states, recording.extra_state[None]])
    noisy = states + sigma * rng.standard_normal(states.shape)
    y = observe(view, scenario.game.dynamics, noisy)
    return Observation(y=y[:-1], extra=y[-1])
