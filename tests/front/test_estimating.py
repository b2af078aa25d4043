"""One estimate, and what a solved game says."""

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.map import Map


@pytest.fixture(scope="module")
def scenario():
    return ob.scenario("two_player")


@pytest.fixture(scope="module")
def seen(scenario):
    return ob.observe(scenario, "full", 0.02)


class Ones:
    def __init__(self):
        self.calls = 0

    def estimate(self, problem, observation, *, rng, budget):
        self.calls += 1
        assert self.calls == 1, "an estimator remembers nothing"
        return ob.Estimate(np.ones((problem.game.num_players, problem.game.num_weights)))


class Meddler:
    def estimate(self, problem, observation, *, rng, budget):
        object.__setattr__(problem, "sigma", 7.0)
        return ob.Estimate(np.ones((2, 4)))


class Picky(Ones):
    def supports(self, problem):
        return "not today"


def test_an_estimate_has_weights_a_prediction_and_a_summary(scenario, seen):
    found = ob.estimate(*seen, "map")
    np.testing.assert_allclose(found.weights.sum(axis=1), 1)
    motion = found.predict()
    assert (
        ob.metrics.position_error(motion.states, found.predict(scenario.initial_state).states) < 0.1
    )
    table = found.summary()
    assert list(table.columns[:4]) == list(scenario.game.weight_names)
    assert (table.filter(like="_error") > 0).all(axis=None)
    assert repr(found).startswith("Estimated(by 'map' in ")


def test_a_name_a_class_and_an_object_are_the_same(seen):
    weights = [ob.estimate(*seen, one).weights for one in ("map", Map, Map())]
    np.testing.assert_array_equal(weights[0], weights[1])
    np.testing.assert_array_equal(weights[0], weights[2])


def test_an_estimator_has_a_copy_of_all(seen):
    own = Ones()
    for _ in range(2):
        np.testing.assert_allclose(ob.estimate(*seen, own).weights, 0.25)
    with pytest.raises(ValueError, match=r"'Meddler': it changes the problem: problem\.sigma"):
        ob.estimate(*seen, Meddler)
    assert seen[0].sigma == 0.02


def test_wrong_use_is_one_line(seen, scenario):
    problem, observation = seen
    with pytest.raises(TypeError, match=r"an estimator is a name .*got 3"):
        ob.estimate(problem, observation, 3)
    with pytest.raises(ValueError, match=r"unknown estimator 'mapp'; known are: .*nearest: map"):
        ob.estimate(problem, observation, "mapp")
    with pytest.raises(ValueError, match=r"not today"):
        ob.estimate(problem, observation, Picky)
    with pytest.raises(TypeError, match=r"observation must be a Observation, .*got array"):
        ob.estimate(problem, observation.y, "map")
    forgetful = ob.Problem(scenario.game, ob.views.FullView(), 0.02, noise_scale=(1, 1, 1, 9))
    with pytest.raises(ValueError, match=r"the observation was made with .*use the problem that"):
        ob.estimate(forgetful, observation, "map")


def test_a_prediction_needs_a_start():
    seen = ob.observe("two_player", "partial", 0.02)
    with pytest.raises(ValueError, match=r"give predict the initial_state"):
        ob.estimate(*seen, "uniform").predict()


def test_a_game_without_a_root_is_no_motion(scenario):
    weights = np.array([[1, 0, 0, 0]] * 2)
    with pytest.raises(ob.NoRootError, match=r"no root of the game was found: .* off by"):
        ob.solve_olne(scenario.game, weights, 1e3 * scenario.initial_state)
    with pytest.raises(TypeError, match=r"game must be a Game, got Scenario.*scenario.game"):
        ob.solve_olne(scenario, weights, scenario.initial_state)


def test_information_is_that_of_the_bound(scenario, seen):
    motion = ob.solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    assert repr(motion).startswith("Equilibrium(2 players, 25 states; residual ")
    assert ob.certify(scenario.game, motion, scenario.weights).passed
    information = ob.fisher_information(seen[0], motion, scenario.weights)
    assert information.shape == (16, 16)
    np.testing.assert_allclose(information, information.T)
    # A scaling of a player's weights changes nothing.
    scaling = np.concatenate([scenario.weights[0], np.zeros(12)])
    assert scaling @ information @ scaling < 1e-9 * np.trace(information)
    with pytest.raises(ValueError, match=r"sigma must be positive, got 0.0"):
        ob.fisher_information(ob.problem(scenario), motion, scenario.weights)


def test_a_world_is_that_of_its_road():
    assert ob.parallel_env("two_player").metadata["name"] == "olne_v0"
    assert type(ob.parallel_env("highway")).__module__ == "olne_bench.envs.highway_v0"
