"""Noisy samples of a motion, and what an estimator is told of them: for scripts that measure."""

import numpy as np

from olne_bench.bench.judge.observe import problem_of, sensor_model
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.observation import VIEWS, observe


def noisy(
    scenario: Scenario,
    states: np.ndarray,
    sigma: float,
    view: str = "full",
    *,
    rng: int | np.random.Generator = 0,
    known: bool = False,
) -> tuple[Problem, Observation]:
    """A problem, and what is seen of a motion (T, N, n) with white noise, in the scenario's units.

    Args:
        scenario: whose game it is; ``told``, or, if ``known``, the one without unknown parameters.
        states: the motion.
        sigma: noise level [m].
        view: what is seen of the states.
        rng: source or seed of the noise.
        known: whether parameters are known.
    """
    game = scenario.game if known else scenario.told
    noise = np.random.default_rng(rng).standard_normal(states.shape)
    seen = states + sigma * np.array(scenario.noise_scale) * noise
    problem = problem_of(game, sensor_model(scenario, (VIEWS[view],)), sigma)
    return problem, Observation(observe(problem.view, game.dynamics, seen))
