"""Players that leave the equilibrium."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.estimators.imperfect import Imperfect, Kicks, _moved, _noises
from olne_bench.estimators.map import Map
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Estimate, Observation
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import observe
from olne_bench.games.solve.olne import solve_olne

SIGMA = 0.003


def estimated(estimator, problem, observation) -> Estimate:
    return estimator.estimate(problem, observation, rng=np.random.default_rng(0), budget=60.0)


@pytest.fixture
def kicked(seen):
    """``kicked(deviation, seed)``: what is seen of players whose acceleration is kicked."""
    problem, _, weights = seen(sigma=0.0)
    problem = replace(problem, sigma=SIGMA)

    def make(deviation: float, seed: int = 0) -> tuple[Observation, np.ndarray]:
        rng, game = np.random.default_rng(seed), problem.game
        # The start of the fixture's game.
        start = seen(sigma=0.0)[1][0].y[0]
        truth = solve_olne(game, weights, start)
        controls = truth.controls.copy()
        controls[..., 1] += deviation * rng.standard_normal(controls.shape[:2])
        states = rollout(game.dynamics, start, controls, game.dt)
        clean = observe(problem.view, game.dynamics, states)
        return Observation(clean + SIGMA * rng.standard_normal(clean.shape)), weights

    return problem, make


def test_samples_move_as_controls_do(kicked):
    problem, make = kicked
    observation, _ = make(0.0)
    density, peaks = Posterior().peaks(problem, observation, np.inf)
    place = peaks[0].place
    states, _ = density.seen_at(place)
    moved = _moved(density, place)
    steps, players = len(states) - 1, problem.game.num_players
    moved = moved.reshape(*observation.y.shape, -1, steps, players)
    root = place.roots[0]
    n, m = states[0].size, players * moved.shape[3]
    controls = root[:-1, n : n + m].reshape(steps, players, -1)
    there = rollout(problem.game.dynamics, states[0], controls, problem.game.dt)
    np.testing.assert_allclose(there, states, atol=1e-6)
    controls[3, 1, 0] += 1e-5
    away = rollout(problem.game.dynamics, states[0], controls, problem.game.dt) - there
    np.testing.assert_allclose(moved[..., 0, 3, 1], away / 1e-5 / SIGMA, rtol=1e-3, atol=1e-3)


def test_players_that_keep_to_the_equilibrium_are_not_accused(kicked):
    problem, make = kicked
    told = []
    for seed in range(6):
        observation, _ = make(0.0, seed)
        density, peaks = Posterior().peaks(problem, observation, np.inf)
        place = peaks[0].place
        moved, seen = _moved(density, place), np.isfinite(observation.y)
        told += [
            Kicks.most_likely(place, moved, seen, lasting=lasting) for lasting in (False, True)
        ]
    assert np.median([one.gain for one in told]) < 2
    observation, _ = make(0.0)
    plain = estimated(Posterior(), problem, observation)
    found = estimated(Imperfect(), problem, observation)
    np.testing.assert_allclose(found.weights, plain.weights, atol=0.05)
    assert "leave" not in found.message


def test_kicks_are_found_and_their_size(kicked):
    problem, make = kicked
    found = [estimated(Imperfect(), problem, make(0.1, seed)[0]) for seed in range(4)]
    sizes = [one.extras["kick_acceleration"] for one in found]
    assert 0.07 < np.median(sizes) < 0.14
    assert all(one.extras["kick_yaw_rate"] < 0.02 for one in found)
    assert all("players leave the equilibrium" in one.message for one in found)


def test_weights_are_nearer_and_their_regions_wider(kicked):
    problem, make = kicked
    errors = {"map": [], "imperfect": []}
    for seed in range(6):
        observation, weights = make(0.1, seed)
        found = estimated(Imperfect(), problem, observation)
        plain = estimated(Map(), problem, observation)
        errors["map"].append(np.abs(plain.weights - weights).sum())
        errors["imperfect"].append(np.abs(found.weights - weights).sum())
        assert np.trace(found.covariance) > 2 * np.trace(plain.covariance)
    assert np.mean(errors["imperfect"]) < 0.8 * np.mean(errors["map"])


def test_players_that_plan_again_are_known_to_plan_on(kicked):
    problem, make = kicked
    game, errors, later = problem.game, {Map: [], Imperfect: []}, []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        (observation, weights), states = make(0.0, seed), []
        at = observation.y[0]
        while len(states) < game.horizon:
            plan = solve_olne(game, weights, at).states
            states += [*plan[:3]]
            at = plan[3]
        true = np.array(states[: game.horizon])
        seen = Observation(true + SIGMA * rng.standard_normal(true.shape))
        follows = solve_olne(game, weights, true[-1]).states
        for kind, off in errors.items():
            found = estimated(kind(), problem, seen)
            off.append(np.abs(solve_olne(game, found.weights, true[-1]).states - follows).max())
        assert found.states.shape == true.shape
        later.append(found.extras["plans_later"])
        assert found.extras["noise_lasting"] == 0 == found.extras["noise_bias"]
    assert np.median(later) > 0
    assert "players plan for" in found.message
    assert np.mean(errors[Imperfect]) < 0.7 * np.mean(errors[Map])


def test_players_that_do_not_plan_again_plan_to_the_last_sample(kicked):
    problem, make = kicked
    found = [estimated(Imperfect(), problem, make(0.0, seed)[0]) for seed in range(3)]
    assert all(one.extras["plans_later"] == 0 for one in found)


def test_more_noise_than_told_is_no_kick(kicked):
    problem, make = kicked
    told = replace(problem, sigma=SIGMA / 2)
    found = [estimated(Imperfect(), told, make(0.0, seed)[0]) for seed in range(4)]
    assert np.median([one.extras["noise_factor"] for one in found]) == pytest.approx(2, rel=0.15)
    for one in found:
        assert one.extras["plans_later"] == 0 == one.extras["noise_bias"]
        assert "times as told" in one.message and "leave" not in one.message


def test_a_bias_is_no_kick(kicked):
    problem, make = kicked
    errors = {Posterior: [], Imperfect: []}
    for seed in range(4):
        observation, weights = make(0.0, seed)
        players, components = observation.y.shape[1:]
        bias = 3 * SIGMA * np.random.default_rng(seed).standard_normal((players, components))
        shown = Observation(observation.y + bias)
        for kind, off in errors.items():
            found = estimated(kind(), problem, shown)
            off.append(np.abs(found.weights - weights).sum())
        assert "errors last, or there is a bias" in found.message
        assert found.extras["plans_later"] == 0
    assert np.mean(errors[Imperfect]) < 0.5 * np.mean(errors[Posterior])


def test_noise_parts_are_of_the_same_player_and_component():
    seen = np.ones((3, 2, 1), dtype=bool)
    seen[1, 0] = False  # samples left: (0, 0), (0, 1), (1, 1), (2, 0), (2, 1)
    white, lasting, bias = _noises(seen)
    np.testing.assert_array_equal(white, np.eye(5))
    assert lasting[0] == pytest.approx([1, 0, 0, 0.64, 0])
    assert lasting[1] == pytest.approx([0, 1, 0.8, 0, 0.64])
    np.testing.assert_array_equal(bias, lasting > 0)


def test_gaps_stay_gaps(kicked):
    problem, make = kicked
    observation, _ = make(0.05)
    y = observation.y.copy()
    y[4:6, 1] = np.nan
    found = estimated(Imperfect(), problem, Observation(y))
    assert found.converged
    assert np.isfinite(found.samples).all()
