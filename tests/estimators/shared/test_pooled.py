"""Several motions of unlike cars with common drivers."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.shared.pooled import Recorded, checked

DRIVERS = ((0, 1), (2, 0), (1, 2))
LIMITS = {"budget": 30.0}


@pytest.fixture(scope="module")
def truth():
    return np.random.default_rng(3).dirichlet(np.full(4, 4.0), 3)


def motions(truth, sigma):
    """Three motions of two players each, of different lengths, seen by different sensors."""
    rng, found = np.random.default_rng(0), []
    for k, drivers in enumerate(DRIVERS):
        scenario = ob.scenario("two_player")
        game = replace(scenario.game, horizon=25 - 4 * k)
        motion = ob.solve_olne(game, truth[list(drivers)], scenario.initial_state)
        view = (ob.views.FullView(), ob.views.VIEWS["partial"])[k % 2]
        y = ob.views.observe(view, game.dynamics, motion.states)
        level = sigma * (1 + k)
        y = y + level * rng.standard_normal(y.shape)
        found.append(Recorded(ob.Problem(game, view, level), ob.Observation(y), drivers))
    return found


@pytest.mark.parametrize("estimator", [KktConstrained(), Map()])
def test_drivers_of_different_games_are_recovered_without_noise(truth, estimator) -> None:
    found = estimator.together(motions(truth, 1e-6), rng=np.random.default_rng(0), **LIMITS)
    assert found.converged, found.message
    np.testing.assert_allclose(found.weights, truth, atol=1e-3)
    assert [len(states) for states in found.states] == [25, 21, 17]


def test_more_motions_leave_less_open(truth) -> None:
    seen, rng = motions(truth, 0.01), np.random.default_rng(0)
    together = Map().together(seen, rng=rng, **LIMITS)
    first = Map().together(seen[:1], rng=rng, **LIMITS)
    alone = Map().estimate(seen[0].problem, seen[0].observation, rng=rng, **LIMITS)
    np.testing.assert_allclose(first.weights, alone.weights, atol=1e-6)
    np.testing.assert_allclose(first.covariance, alone.covariance, rtol=1e-3, atol=1e-8)
    assert np.trace(together.covariance[:8, :8]) < 0.9 * np.trace(first.covariance)
    errors = (together.weights - truth).ravel() / np.sqrt(np.diag(together.covariance))
    assert np.sqrt(np.mean(errors**2)) < 2


def test_samples_are_as_wide_as_the_covariance(truth) -> None:
    seen = motions(truth, 0.004)[:2]
    found = Posterior(first=200).together(seen, rng=np.random.default_rng(0), **LIMITS)
    probable = Map().together(seen, rng=np.random.default_rng(0), **LIMITS)
    assert found.samples is not None
    assert found.samples.shape == (1000, 3, 4)
    np.testing.assert_allclose(found.samples.sum(axis=2), 1)
    widths = np.sqrt(np.diag(found.covariance) / np.diag(probable.covariance))
    assert 0.7 < np.median(widths) < 1.4


def test_a_driver_who_is_never_seen_is_named(truth) -> None:
    seen = motions(truth, 0.01)[:1]
    y = seen[0].observation.y.copy()
    y[:, 1] = np.nan
    hidden = [replace(seen[0], observation=ob.Observation(y))]
    found = KktConstrained().together(hidden, rng=np.random.default_rng(0), **LIMITS)
    assert not found.converged
    assert found.message == "never seen, hence not identified: player 1"


def test_what_does_not_fit_is_refused(truth) -> None:
    one, two, _ = motions(truth, 0.01)
    for bad, words in (
        ([], "at least one motion"),
        ([replace(one, drivers=(0, 0))], "2 different numbers"),
        ([replace(one, drivers=(0, 1, 2))], "2 different numbers"),
        ([one, replace(two, drivers=(3, 1))], r"numbered 0 to 2, got \[0, 1, 3\]"),
        (
            [replace(one, problem=replace(one.problem, sigma_spread=1.0))],
            "noise level of motion 0 must be known",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            checked(bad)
    scenario = ob.scenario("highway", seed=0, num_players=3)
    problem, seen = ob.observe(scenario, sigma=0.1)
    with pytest.raises(ValueError, match=r"motion 1 has the weights .*, motion 0 has"):
        checked([one, Recorded(problem, seen, (0, 1, 2))])
