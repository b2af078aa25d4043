"""What a referee says of priors."""

import numpy as np
import pytest

from olne_bench.bench.judge.priors import exclusion, prior_told
from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.plan.kinds import Rules
from olne_bench.envs.scenarios import get_scenario


@pytest.mark.parametrize(
    ("name", "parameters", "excluded"),
    [
        ("map", {"alpha": 1000}, True),
        ("posterior", {"alpha": 1000}, True),
        ("posterior", {}, False),
        ("kkt_constrained", {}, False),
        ("somewhere/map.py", {"alpha": 1000}, False),  # its own alpha may mean anything
    ],
)
def test_only_a_prior_excludes(name, parameters, excluded):
    scenario = get_scenario("two_player", 1, weights="dirichlet")
    found = exclusion(EstimatorEntry(name=name, parameters=parameters), scenario, scenario.prior)
    assert bool(found) == excluded
    if excluded:
        assert found.startswith(
            "its prior WeightPrior((1000.0,)) gives the truth no mass: weight '"
        )
        assert "\n" not in found


def test_the_weight_that_is_farthest_out_is_named():
    scenario = get_scenario("two_player", 1, weights="dirichlet")
    found = exclusion(
        EstimatorEntry(name="map", parameters={"alpha": 1000}), scenario, scenario.prior
    )
    shown = {
        f"{name!r} of player {i} is {scenario.weights[i, k]:.3g}"
        for i in range(2)
        for k, name in enumerate(scenario.game.weight_names)
        if np.abs(scenario.weights[i, k] - 0.25) > 0.1
    }
    assert any(one in found for one in shown)


def test_a_told_prior_may_exclude_the_truth():
    scenario = get_scenario("two_player", 1, weights="dirichlet")
    told = prior_told(scenario, Rules(prior=1000.0))
    assert "gives the truth no mass" in exclusion(EstimatorEntry(name="ukf"), scenario, told)
    assert prior_told(scenario, Rules()) == scenario.prior
