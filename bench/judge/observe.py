"""Sensors: from a recording to what an estimator is allowed to see."""

import zlib

import numpy as np

from olne_bench.envs.recording import Recording
from olne_bench.estimators.protocol import Observation
from olne_bench.games.observation import View, observe


def sense(
    recording: Recording, view: View, sigma: float, seed: int, trajectory: int = 0
) -> Observation:
    """Observe a recording through a view, with additive white Gaussian noise.

    The standard deviation on each component of the state is sigma times the scenario's
    ``noise_scale``: sigma itself on positions [m].

    The noise is drawn for the full state and then masked by the view, from a stream that depends
    on (scenario, sigma, seed) alone. Every view and estimator so sees the same draw, and
    comparisons between them are paired.

    Args:
        recording: what happened.
        view: the observation model.
        sigma: noise level.
        seed: of the noise.
        trajectory: which of several that are observed; each has noise of its own.
    """
    states = np.concatenate([recording.states, recording.extra_state[None]])
    stream = [zlib.crc32(recording.scenario.name.encode()), round(sigma * 1e9), seed]
    stream += [trajectory] if trajectory else []
    noise = sigma * np.random.default_rng(stream).standard_normal(states.shape)
    noise *= recording.scenario.noise_scale
    y = observe(view, recording.scenario.game.dynamics, states + noise)
    return Observation(y=y[:-1], extra=y[-1])
