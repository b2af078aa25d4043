"""What a player may return."""

from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.raw_estimate import MOST_EXTRAS, InvalidEstimateError, read_estimate
from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.observation import FullView


@pytest.fixture(scope="module")
def problem():
    game = true_recording(Draw.of(ScenarioEntry(name="two_player"), 0, "")).scenario.game
    return Problem(game, FullView())


def checked(problem, **given):
    return check_estimate(
        read_estimate(SimpleNamespace(**{"weights": np.ones((2, 4))} | given)), problem
    )


@pytest.mark.parametrize("scale", [1e308, 5e-324, 1.0])
def test_weights_of_any_size_are_scaled_to_sum_one(problem, scale):
    weights = checked(problem, weights=np.full((2, 4), scale)).weights
    assert weights.tolist() == [[0.25] * 4] * 2


def test_weights_of_usual_size_are_divided_by_their_sum_to_the_last_bit(problem):
    weights = np.random.default_rng(0).uniform(0, 3, (2, 4))
    expected = weights / weights.sum(axis=1, keepdims=True)
    assert (checked(problem, weights=weights).weights == expected).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"weights": np.ones((2, 4), dtype=complex)}, "weights are not an array of numbers"),
        ({"weights": np.full((2, 4), "1")}, "weights are not an array of numbers"),
        ({"states": np.ones((25, 2, 4), dtype=complex)}, "states are not an array of numbers"),
        ({"covariance": np.triu(np.ones((8, 8)))}, "covariance is not symmetric"),
        ({"covariance": -np.eye(8)}, "covariance is not positive semi-definite"),
        ({"region": "ellipse"}, "region is 'ellipse', known are samples, covariance, likelihood"),
        ({"region": 3}, "region is a int, expected a text"),
        ({"region": "covariance"}, "region is 'covariance', but there is no covariance"),
        ({"region": "samples"}, "region is 'samples', but there is no samples"),
        ({"extras": [1]}, r"extras are \[1\], expected a mapping"),
        ({"extras": {"objective": "low"}}, r"extras\['objective'\] is 'low', expected a number"),
        ({"extras": {"objective": 10**400}}, r"extras\['objective'\] is a int, expected a number"),
        ({"converged": np.array([True, False])}, r"converged is array\(\[ True, False\]\), expec"),
        ({"converged": "no"}, "converged is 'no', expected True or False"),
        ({"message": 3}, "message is 3, expected a text"),
        ({"samples": "many"}, "samples are not an array of numbers"),
        ({"samples": 1.0}, r"samples have the shape \(\), expected \(M, 2, 4\)"),
        ({"samples": np.ones((40, 8))}, r"samples have the shape \(40, 8\), expected \(M, 2, 4\)"),
        ({"samples": np.full((40, 2, 4), np.nan)}, "samples are not finite"),
        ({"samples": np.ones((39, 2, 4))}, "there are 39 samples, expected 40 to 4000"),
        ({"samples": np.ones((4001, 2, 4))}, "there are 4001 samples, expected 40 to 4000"),
        ({"samples": -np.ones((40, 2, 4))}, "samples are negative: the least is -1"),
        ({"samples": np.zeros((40, 2, 4))}, "samples of a player are all zero"),
    ],
)
def test_a_malformed_field_is_named(problem, given, message):
    with pytest.raises(InvalidEstimateError, match=message):
        checked(problem, **given)


def test_a_property_that_raises_is_invalid():
    class Lazy:
        @property
        def weights(self):
            raise ZeroDivisionError

    with pytest.raises(InvalidEstimateError, match="weights cannot be read: ZeroDivisionError"):
        read_estimate(Lazy())


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_a_covariance_that_is_one_up_to_rounding_is_kept(problem, size):
    factor = np.random.default_rng(0).standard_normal((8, 3))
    covariance = size * (factor @ factor.T) * (1 + 1e-12 * np.triu(np.ones((8, 8))))
    assert (checked(problem, covariance=covariance).covariance == covariance).all()
    assert checked(problem, covariance=np.zeros((8, 8))).covariance is not None


def test_samples_are_scaled_to_sum_one(problem):
    samples = np.random.default_rng(0).uniform(0, 3, (40, 2, 4))
    scaled = samples / samples.sum(axis=2, keepdims=True)
    assert (checked(problem, samples=samples).samples == scaled).all()
    assert checked(problem).samples is None


def test_scalar_extras_are_kept(problem):
    numbers = {"starts": np.int64(3), "least": 0.5, "bad": np.nan, "yes": np.True_, "objective": 1}
    others = {"path": np.ones(3), "how": "a\nb", "long": "x" * 1000, 7: 8}
    found = checked(problem, extras=numbers | others)
    kept = {"how": "a b", "least": 0.5, "starts": 3, "yes": True}
    assert found.extras == kept | {"objective": 1.0}
    many = checked(problem, extras={f"n{k:02}": k for k in range(30)}).extras
    assert len(many) == MOST_EXTRAS
    assert checked(problem).extras == {}


@pytest.fixture(scope="module")
def asking():
    """A problem with unknown goals."""
    return Problem(get_scenario("unknown_goals", 0).told, FullView())


def test_parameters_are_kept_in_their_units(asking):
    means = asking.game.parameters.means
    estimate = checked(asking, parameters=means + 0.1, parameter_deviations=np.full((2, 2), 0.01))
    np.testing.assert_allclose(estimate.parameters, means + 0.1)
    np.testing.assert_allclose(estimate.parameter_deviations, 0.01)
    np.testing.assert_allclose(estimate.theta(asking.game)[:, 4:], 0.5)  # deviations of 0.2 m


def test_parameter_samples_belong_to_samples(asking):
    means = asking.game.parameters.means
    many = np.tile(means, (40, 1, 1))
    found = checked(asking, parameters=means, samples=np.ones((40, 2, 4)), parameter_samples=many)
    assert (found.parameter_samples == many).all()
    for given, message in (
        ({"parameter_samples": many}, "parameter_samples belong to samples, which are missing"),
        (
            {"samples": np.ones((40, 2, 4)), "parameter_samples": many[1:]},
            r"parameter_samples have the shape \(39, 2, 2\), expected \(40, 2, 2\)",
        ),
        (
            {"samples": np.ones((40, 2, 4)), "parameter_samples": many * np.nan},
            "parameter_samples are not finite",
        ),
    ):
        with pytest.raises(InvalidEstimateError, match=message):
            checked(asking, parameters=means, **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, r"parameters are missing: the game has unknowns \(goal x, goal y\)"),
        (
            {"parameters": np.zeros((2, 3))},
            r"parameters have the shape \(2, 3\), expected \(2, 2\)",
        ),
        ({"parameters": np.full((2, 2), np.nan)}, "parameters are not finite"),
        ({"parameters": "xy"}, "parameters are not an array of numbers"),
        (
            {"parameters": np.full((2, 2), 9.0)},
            "goal x of player 0 is 9 m, the range is 0.4 to 1.6",
        ),
    ],
)
def test_malformed_parameters_are_named(asking, given, message):
    with pytest.raises(InvalidEstimateError, match=message):
        checked(asking, **given)


def test_malformed_deviations_are_named(asking):
    given = {"parameters": asking.game.parameters.means}
    with pytest.raises(InvalidEstimateError, match="parameter_deviations are negative"):
        checked(asking, **given, parameter_deviations=-np.ones((2, 2)))
    with pytest.raises(InvalidEstimateError, match="parameter_deviations have the shape"):
        checked(asking, **given, parameter_deviations=np.ones(4))


def test_who_gives_up_needs_no_parameters(asking):
    assert checked(asking, converged=False, message="lost").parameters is None


def test_parameters_that_nobody_asked_for_are_not_read(problem):
    assert checked(problem, parameters=np.ones(7)).parameters is None
