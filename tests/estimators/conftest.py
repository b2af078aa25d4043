"""Observations of small games for the tests of estimators."""

from collections.abc import Callable

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.game import Game
from olne_bench.games.observation import VIEWS, observe
from olne_bench.games.olne import solve_olne

Seen = Callable[..., tuple[Problem, list[Observation], np.ndarray]]


def _short(game: Game) -> Game:
    return Game(game.players, game.dynamics, horizon=12, dt=2 * game.dt)


@pytest.fixture(scope="session")
def seen() -> Seen:
    """``seen(seed, sigma, view, count)``: a short random crossing with known weights.

    Returns the problem, observations from ``count`` initial states, and the true weights.
    """

    def make(
        seed: int = 1, sigma: float = 0.0, view: str = "full", count: int = 1, players: int = 2
    ) -> tuple[Problem, list[Observation], np.ndarray]:
        scenario = get_scenario("random", seed, num_players=players)
        game, rng = _short(scenario.game), np.random.default_rng(seed)
        observations = []
        for k in range(count):
            start = scenario.initial_state + 0.05 * k * rng.standard_normal((players, 4))
            truth = solve_olne(game, scenario.weights, start)
            assert truth.certificate.passed
            noisy = truth.states + sigma * rng.standard_normal(truth.states.shape)
            observations.append(Observation(observe(VIEWS[view], game.dynamics, noisy)))
        return Problem(game, VIEWS[view], sigma), observations, scenario.weights

    return make
