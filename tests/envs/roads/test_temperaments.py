"""Temperaments of drivers: who is drawn, with which weights, and who can be recognised."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import dirichlet

from olne_bench.envs.roads.road_scenario import RoadFamily
from olne_bench.envs.roads.temperaments import (
    PREFERENCES,
    TEMPERAMENTS,
    checked_shares,
    drawn_temperaments,
    recognised,
    tempered_prior,
    tempered_weights,
)
from olne_bench.envs.scenarios import check_options, get_scenario
from olne_bench.games.model.weight_prior import FLAT, WeightPrior
from olne_bench.plugins import PluginError

SHARES = {"aggressive": 0.6, "cautious": 0.4}
NAMES = np.array(list(TEMPERAMENTS))


def test_shares_are_those_of_the_traffic() -> None:
    shares = checked_shares(SHARES)
    drawn = np.concatenate([drawn_temperaments(seed, 5, shares) for seed in range(400)])
    assert np.mean(drawn == "aggressive") == pytest.approx(0.6, abs=0.03)
    assert not (drawn == "normal").any()
    assert drawn_temperaments(7, 5, shares) == drawn_temperaments(7, 5, shares)
    even = np.concatenate([drawn_temperaments(s, 5, checked_shares(None)) for s in range(400)])
    assert np.mean(even == "normal") == pytest.approx(1 / 3, abs=0.03)


@pytest.mark.parametrize("name", TEMPERAMENTS)
def test_weights_have_the_documented_distribution(name: str) -> None:
    rows = np.concatenate([tempered_weights(seed, (name,) * 4) for seed in range(500)])
    np.testing.assert_allclose(rows.sum(axis=1), 1)
    known = dirichlet(TEMPERAMENTS[name])
    np.testing.assert_allclose(rows.mean(axis=0), known.mean(), atol=0.02)
    np.testing.assert_allclose(rows.var(axis=0), known.var(), rtol=0.2)


def test_the_largest_density_decides() -> None:
    weights = np.random.default_rng(0).dirichlet(np.ones(4), 300)
    shares = {"aggressive": 0.2, "normal": 0.5, "cautious": 0.3}
    densities = [shares[n] * dirichlet(a).pdf(weights.T) for n, a in TEMPERAMENTS.items()]
    expected = NAMES[np.argmax(densities, axis=0)]
    assert (recognised(weights, shares) == expected).all()
    assert (recognised(7.0 * weights, shares) == expected).all()
    assert recognised(weights.reshape(60, 5, 4), shares).shape == (60, 5)
    assert set(expected) == set(NAMES)


def test_a_weight_of_zero_has_a_temperament_and_nobody_is_what_nobody_is() -> None:
    hasty, careful = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
    assert recognised(hasty, checked_shares(None)) == "aggressive"
    assert recognised(careful, checked_shares(None)) == "cautious"
    assert recognised(hasty, checked_shares({"normal": 1})) == "normal"


def test_most_true_weights_are_recognised() -> None:
    shares = checked_shares(None)
    for name, least in (("aggressive", 0.85), ("normal", 0.72), ("cautious", 0.83)):
        rows = tempered_weights(1, (name,) * 1000)
        assert least < np.mean(recognised(rows, shares) == name) < least + 0.1


def test_a_road_draws_what_it_tells() -> None:
    options = {"weights": "temperaments", "shares": SHARES, "num_players": [3, 4]}
    family = check_options("intersection", **options)
    assert isinstance(family, RoadFamily)
    drawn = get_scenario("intersection", 1, **options)
    assert drawn.game.weight_names == PREFERENCES
    expected = tempered_weights(1, family.temperaments(1))
    np.testing.assert_allclose(drawn.weights, expected, rtol=1e-12)
    np.testing.assert_array_equal(family.tempered(1), expected)
    assert len(family.temperaments(1)) == drawn.game.num_players
    assert check_options("intersection").temperaments(1) == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shares": {"hasty": 1.0}}, "unknown temperament 'hasty'; known are: aggressive, normal"),
        ({"shares": {"normal": 0.5}}, "shares of temperaments must sum to 1, got 0.5"),
        (
            {"shares": {"normal": 1.5, "cautious": -0.5}},
            "share of 'normal' must be 0 to 1, got 1.5",
        ),
        ({"shares": {"normal": float("nan")}}, "share of 'normal' must be 0 to 1, got nan"),
        ({"shares": {"normal": True}}, "share of 'normal' must be 0 to 1, got True"),
        ({"shares": "normal"}, "shares must be a table of temperaments"),
        ({"shares": {"normal": 1}, "weights": "moderate"}, "shares need weights = 'temperaments'"),
    ],
)
def test_bad_shares_are_refused(options, message) -> None:
    with pytest.raises(PluginError, match=message):
        check_options("merge", **({"weights": "temperaments"} | options))


def test_the_guide_has_the_parameters() -> None:
    guide = (Path(__file__).parents[3] / "docs" / "highway.md").read_text()
    for name, parameters in TEMPERAMENTS.items():
        assert f"| {name} | {' | '.join(f'{value:g}' for value in parameters)} |" in guide


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, WeightPrior((6.0,))),
        ({"weights": "dirichlet"}, FLAT),
        ({"weights": "temperaments"}, tempered_prior(checked_shares(None))),
        (
            {"weights": "temperaments", "shares": {"normal": 0.25, "cautious": 0.75}},
            WeightPrior((TEMPERAMENTS["normal"], TEMPERAMENTS["cautious"]), (0.25, 0.75)),
        ),
    ],
)
def test_a_scenario_says_how_its_weights_are_drawn(options, expected) -> None:
    assert get_scenario("intersection", 0, num_players=2, **options).prior == expected
