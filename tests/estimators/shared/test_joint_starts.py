"""When the joint method has tried enough starts."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.joint_problem import JointSettings, JointSolution
from olne_bench.estimators.shared.joint_starts import (
    End,
    Search,
    joint_attempts,
    largest_explicable,
)
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE, Dynamics
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import View, observe
from olne_bench.games.solve.olne import solve_olne

RNG = np.random.default_rng(0)


@dataclass(frozen=True)
class Turned(View):
    """Positions in a turned frame, and the heading. Starts cannot read off where players are."""

    name: str = "turned"

    def expected(self, state: ca.SX, dynamics: Dynamics) -> ca.SX:
        cos, sin = np.cos(0.2), np.sin(0.2)
        turned = cos * state[0] - sin * state[1], sin * state[0] + cos * state[1]
        return ca.vertcat(*turned, state[2])

    def component_names(self, dynamics: Dynamics) -> tuple[str, ...]:
        return ("ahead", "left", "heading")


@pytest.fixture(scope="module")
def passing() -> tuple[Game, np.ndarray, np.ndarray]:
    """Two players who pass each other, their weights and their motion (T, N, 4)."""
    own = (StateDeviation("speed", target=0.3), ControlEffort("acceleration", scale=10.0))
    wants = (Proximity(), *own, ControlEffort("yaw_rate"))
    players = tuple(Player(wants, (FinalGoal((x, 0.0)),)) for x in (1.0, -1.0))
    game = Game(players, UNICYCLE, horizon=15, dt=0.4)
    first = np.array([[-1, 0.2, 0, 0.3], [1, -0.2, np.pi, 0.3]])
    weights = np.random.default_rng(0).uniform(0.5, 1, (2, 4))
    return game, weights, solve_olne(game, weights, first).states


def observed(
    game: Game, states: np.ndarray, seed: int, sigma: float
) -> tuple[Problem, np.ndarray, float]:
    """The problem, noisy observations, and the squared error of the truth."""
    noise = sigma * np.random.default_rng(seed).standard_normal((*states.shape[:2], 3))
    y = observe(Turned(), game.dynamics, states) + noise
    return Problem(game, Turned(), sigma, noise_scale=(1.0, 1.0, 1.0)), y, float(np.sum(noise**2))


def test_starts_go_on_until_the_noise_explains_the_fit(passing) -> None:
    game, _, states = passing
    numbers = []
    for seed in range(6):
        problem, y, error = observed(game, states, seed, 0.01)
        estimate = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=60)
        assert estimate.converged
        assert estimate.message == ""
        assert estimate.extras["objective"] <= error
        numbers.append(estimate.extras["starts"])
    assert max(numbers) > 6  # for some, none of the starts of the first kinds was enough


def test_starts_are_the_same_again(passing) -> None:
    game, _, states = passing
    problem, y, _ = observed(game, states, 2, 0.01)
    one, two = (
        KktConstrained().estimate(
            problem, Observation(y), rng=np.random.default_rng(seed), budget=60
        )
        for seed in (0, 1)
    )
    np.testing.assert_array_equal(one.weights, two.weights)
    assert one.extras["starts"] == two.extras["starts"]


def test_a_fit_that_noise_does_not_explain_is_told(passing) -> None:
    game, _, states = passing
    problem, y, _ = observed(game, states, 0, 0.01)
    wrong = Problem(game, problem.view, 0.001, noise_scale=problem.noise_scale)
    estimate = KktConstrained().estimate(wrong, Observation(y), rng=RNG, budget=60)
    assert estimate.message.startswith("noise does not explain the squared error of 0.00")


def test_what_noise_leaves_grows_with_its_level_and_with_the_samples(passing) -> None:
    game, _, states = passing
    problem, y, error = observed(game, states, 0, 0.02)
    limit = largest_explicable(problem, [y])
    assert error < limit < 3 * error
    assert largest_explicable(problem, [y, y]) > 1.5 * limit
    y[:, 1] = np.nan
    assert largest_explicable(problem, [y]) < 0.7 * limit
    silent = Problem(game, problem.view, 0.0)
    assert 0 < largest_explicable(silent, [y]) < 1e-5


@pytest.mark.parametrize(
    ("ends", "explained", "settled"),
    [
        ([1.0], True, False),
        ([1.0, 1.00001], True, True),
        ([1.0, 1.1], True, False),
        ([1.0, 9.0, 1.0], True, True),
        ([9.0, 9.0], False, True),
        ([9.0, 8.0, 8.0], False, False),
        ([9.0, np.inf, 9.0], False, False),
        ([np.inf, 1.0, np.inf, 1.0], True, True),
        ([np.inf, np.inf], False, False),
    ],
)
def test_two_starts_that_agree_settle_it(passing, monkeypatch, ends, explained, settled) -> None:
    game, _, states = passing
    problem, y, _ = observed(game, states, 0, 0.02)
    search = Search.of(problem, y, JointSettings(), deadline=0.0)
    monkeypatch.setattr(search, "_explicable", 2.0)
    search.ends = [End(end, end) for end in ends]
    assert search.explained == explained
    assert search.settled == settled


def test_a_start_close_to_a_known_optimum_ends_at_that_one(passing) -> None:
    game, _, states = passing
    for seed in range(4):
        problem, y, _ = observed(game, states, seed, 0.03)
        settings = JointSettings(noise_scale=problem.noise_scale)
        search = Search.of(problem, y, settings, deadline=np.inf)
        found: list[JointSolution] = list(joint_attempts(problem, y, settings, np.inf))
        search.known = [one for one in found if one.converged]
        for one in found:
            end = search._end(one)
            assert end == End() or end.error in [known.objective for known in search.known]
