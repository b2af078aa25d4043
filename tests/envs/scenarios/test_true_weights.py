"""Weights that scenarios draw from a stated prior."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import check_options, get_scenario, is_family
from olne_bench.envs.scenarios.true_weights import flat_dirichlet
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.plugins import PluginError


def test_the_flat_dirichlet_is_uniform_on_the_simplex() -> None:
    rows = np.concatenate([flat_dirichlet(seed, 5, 4) for seed in range(400)])
    np.testing.assert_allclose(rows.sum(axis=1), 1)
    # Each weight has a beta distribution: P(w > x) = (1 - x)^3.
    for x in (0.02, 0.25, 0.7):
        assert np.mean(rows > x) == pytest.approx((1 - x) ** 3, abs=0.025)
    assert np.abs(flat_dirichlet(0, 5, 4) - flat_dirichlet(1, 5, 4)).max() > 0.1


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_the_published_scenarios_draw_weights_if_asked(name: str) -> None:
    published = get_scenario(name)
    assert not is_family(name) and is_family(name, weights="dirichlet")
    one, other = (get_scenario(name, seed, weights="dirichlet") for seed in (1, 2))
    assert one.game == published.game
    np.testing.assert_array_equal(one.initial_state, published.initial_state)
    assert np.abs(one.weights - other.weights).max() > 0.1
    assert certified_equilibrium(one).certificate.passed


@pytest.mark.parametrize("name", ["random", "highway", "merge"])
def test_families_draw_wide_or_moderate_weights(name: str) -> None:
    wide = get_scenario(name, 2, weights="dirichlet", num_players=3)
    drawn = flat_dirichlet(2, *wide.weights.shape)
    np.testing.assert_allclose(wide.weights, drawn / drawn.sum(axis=1, keepdims=True))
    moderate = get_scenario(name, 2, num_players=3)
    assert np.abs(moderate.weights - wide.weights).max() > 0.05


@pytest.mark.parametrize("name", ["two_player", "random", "two_way"])
def test_unknown_kinds_are_refused(name: str) -> None:
    with pytest.raises(PluginError, match=r"weights must be one of .*dirichlet.*, got 'flat'"):
        check_options(name, weights="flat")
