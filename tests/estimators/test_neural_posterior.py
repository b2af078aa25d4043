"""The amortised posterior, with the networks of this package."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.neural_posterior import NeuralPosterior, game_key, network_of
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.incoming_samples import Windows
from olne_bench.games.model.observation import VIEWS, ComponentView, RangeBearingView
from olne_bench.games.solve.olne import solve_olne

SIGMAS = {"two_player": 0.03, "highway_overtaking": 0.02}
FIRST = 900_000  # of seeds; networks are trained on draws of another stream


@lru_cache(maxsize=64)
def drawn(name: str, seed: int) -> tuple[Problem, Observation, np.ndarray]:
    """A problem, an observation in the full view, and the true weights (N, K)."""
    scenario = get_scenario(name, FIRST + seed, weights="dirichlet")
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    rng, sigma = np.random.default_rng(seed), SIGMAS[name]
    y = truth.states + sigma * rng.standard_normal(truth.states.shape)
    return Problem(scenario.game, VIEWS["full"], sigma), Observation(y), scenario.weights


def estimate(problem: Problem, observation: Observation, seed: int = 0) -> Estimate:
    rng = np.random.default_rng(seed)
    return NeuralPosterior().estimate(problem, observation, rng=rng, budget=10.0)


@pytest.mark.parametrize("name", SIGMAS)
def test_samples_lie_on_the_simplex_and_the_point_is_their_mean(name) -> None:
    problem, observation, weights = drawn(name, 0)
    found = estimate(problem, observation)
    assert found.converged
    assert found.samples is not None and found.samples.shape == (1000, *weights.shape)
    assert found.samples.min() >= problem.weight_floor
    np.testing.assert_allclose(found.samples.sum(axis=2), 1.0)
    np.testing.assert_allclose(found.weights, found.samples.mean(axis=0))
    again = estimate(problem, observation)
    np.testing.assert_array_equal(again.samples, found.samples)


@pytest.mark.parametrize("name", SIGMAS)
def test_weights_are_known_better_than_before_and_regions_hold_them(name) -> None:
    errors, prior, within = [], [], []
    for seed in range(24):
        problem, observation, weights = drawn(name, seed)
        found = estimate(problem, observation)
        errors.append(np.square(found.weights - weights).sum())
        prior.append(np.square(0.25 - weights).sum())
        low, high = np.quantile(found.samples, [0.1, 0.9], axis=0)
        within.append((low <= weights) & (weights <= high))
    assert np.mean(errors) < 0.5 * np.mean(prior)
    # 24 draws of 8 or 20 weights, of which those of a player depend on each other.
    assert 0.68 < np.mean(within) < 0.92


def test_more_noise_makes_samples_wider() -> None:
    problem, observation, _ = drawn("two_player", 3)
    widths = [
        estimate(replace(problem, sigma=sigma), observation).samples.std(axis=0).mean()
        for sigma in (0.01, 0.2)
    ]
    assert widths[1] > 1.3 * widths[0]


def test_where_nothing_is_seen_the_prior_is_left() -> None:
    problem, observation, _ = drawn("two_player", 0)
    unseen = np.full_like(observation.y, np.nan)
    unseen[0] = observation.y[0]  # the start says little
    samples = estimate(problem, Observation(unseen)).samples
    np.testing.assert_allclose(samples.mean(axis=0), 0.25, atol=0.1)
    np.testing.assert_allclose(samples.std(axis=0), np.sqrt(3 / 80), atol=0.06)


def test_a_view_is_the_state_with_components_missing() -> None:
    problem, observation, _ = drawn("two_player", 0)
    y = observation.y.copy()
    y[..., 3] = np.nan
    partial = replace(problem, view=VIEWS["partial"], noise_scale=())
    one = estimate(partial, Observation(observation.y[..., :3]))
    np.testing.assert_array_equal(one.samples, estimate(problem, Observation(y)).samples)
    turned = ComponentView("turned", ("heading", "py", "px"))
    other = estimate(
        replace(problem, view=turned, noise_scale=()), Observation(observation.y[..., [2, 1, 0]])
    )
    np.testing.assert_array_equal(one.samples, other.samples)


def test_no_estimate_of_a_stream_depends_on_later_samples() -> None:
    problem, observation, _ = drawn("two_player", 0)
    altered = observation.y.copy()
    altered[7:] = 5.0 - 2.0 * altered[7:]
    found = []
    for y in (observation.y, altered):
        stream = Windows(NeuralPosterior()).start(problem, rng=np.random.default_rng(0))
        found.append([stream.update(sample, budget=10.0) for sample in y[:9]])
    for one, other in list(zip(*found, strict=True))[:7]:
        assert one.converged
        np.testing.assert_array_equal(one.samples, other.samples)
    assert not np.array_equal(found[0][7].samples, found[1][7].samples)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda p: replace(p, game=replace(p.game, horizon=12)), "of 2 players and 12 steps"),
        (lambda p: replace(p, game=get_scenario("random", 0).game), "no network was trained"),
        (lambda p: replace(p, sigma=0.0), "for sigma from 0.003 to 0.2, not 0"),
        (lambda p: replace(p, sigma=0.5), "for sigma from 0.003 to 0.2, not 0.5"),
        (lambda p: replace(p, noise_scale=(1.0, 1.0, 0.1, 1.0)), "noise of one level"),
        (
            lambda p: replace(p, view=RangeBearingView((-3.0, -3.0), 0.8), noise_scale=()),
            "networks see px, py, heading, speed only, and not range, bearing",
        ),
    ],
)
def test_what_no_network_was_trained_for_is_declined(change, reason) -> None:
    problem = change(drawn("two_player", 0)[0])
    said = NeuralPosterior().supports(problem)
    assert said is not None and reason in said and "\n" not in said
    components = len(problem.view.component_names(problem.game.dynamics))
    y = np.zeros((*problem.game.state_shape[:2], components))
    found = estimate(problem, Observation(y))
    assert not found.converged and found.message == said


def test_a_key_is_that_of_one_game_whatever_its_last_digits() -> None:
    game = get_scenario("two_player").game
    goal = game.players[1].task[0]
    near, far = (
        replace(game.players[1], task=(replace(goal, goal=(goal.goal[0] + change, goal.goal[1])),))
        for change in (-1e-12, 1e-3)
    )
    assert game_key(replace(game, players=(game.players[0], near))) == game_key(game)
    assert game_key(replace(game, players=(game.players[0], far))) != game_key(game)
    assert network_of(game).game == game_key(game)


@pytest.mark.learners
def test_the_pass_in_numpy_is_that_of_pytorch() -> None:
    import torch

    problem, observation, _ = drawn("two_player", 0)
    network = network_of(problem.game)
    layers = []
    for matrix, offset in network.layers:
        layer = torch.nn.Linear(matrix.shape[1], matrix.shape[0])
        layer.weight.data, layer.bias.data = torch.from_numpy(matrix), torch.from_numpy(offset)
        layers += [layer, torch.nn.SiLU()]
    from olne_bench.estimators.shared.mixture_network import encoded

    inputs = encoded(
        observation.y[None],
        np.array([problem.sigma]),
        network.centre,
        network.spread,
        np.zeros(1, dtype=int),
        1,
    )
    with torch.no_grad():
        expected = torch.nn.Sequential(*layers[:-1])(torch.from_numpy(inputs))[0].numpy()
    (found,) = network.mixtures(observation.y, problem.sigma)
    count, size = found.means.shape
    np.testing.assert_allclose(found.logits, expected[:count], rtol=1e-4, atol=1e-4)
    means = expected[count : count * (1 + size)].reshape(count, size)
    np.testing.assert_allclose(found.means, means, rtol=1e-4, atol=1e-4)
