import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.identifiability import (
    MOST_DRAWS,
    REFERENCE_SIGMA,
    identifiability_by_noise,
    identifiability_table,
)

SIGMAS = (0.0, REFERENCE_SIGMA, 0.1, 0.5)


def trials(scenario: str, seeds: int = 2, **changes: object) -> pd.DataFrame:
    """Trials at all noise levels, with equal weights as estimates."""
    rows = [
        {"scenario": scenario, "sensor": "full", "estimator": "e", "sigma": sigma, "seed": seed}
        | {"status": "ok", "count": 1, "cosine_error": 0.1, "weights": [[0.25] * 4] * 2}
        | changes
        for sigma in SIGMAS
        for seed in range(seeds)
    ]
    return pd.DataFrame(rows)


def test_more_noise_leaves_more(usual) -> None:
    table = identifiability_by_noise(trials("two_player"), usual)
    assert sorted(table["sigma"].unique()) == sorted(SIGMAS[1:])  # none without noise
    assert (table["draws"] == 1).all()
    for _, weight in table.groupby(["player", "weight"]):
        assert (np.diff(weight.sort_values("sigma")["left"]) > 0).all()
        np.testing.assert_allclose(
            weight["bound"] / weight["sigma"], weight["bound"].iloc[0] / REFERENCE_SIGMA
        )
    shares = table.groupby("sigma")["identified"].mean()
    assert shares[REFERENCE_SIGMA] == 1
    assert shares[0.5] == 0


def test_at_the_reference_noise_it_is_the_other_table(usual) -> None:
    rows = trials("highway_overtaking")
    both = identifiability_by_noise(rows, usual).merge(
        identifiability_table(rows, usual), on=["scenario", "sensor", "player", "weight"]
    )
    both = both[both["sigma"] == REFERENCE_SIGMA]
    assert len(both) == 20
    np.testing.assert_allclose(both["left_x"], both["left_y"])
    np.testing.assert_array_equal(both["identified_x"].astype(bool), both["identified_y"])


def test_of_a_family_some_draws_count(usual) -> None:
    many = trials("unknown_goals", MOST_DRAWS + 3)
    table = identifiability_by_noise(many, usual)
    assert (table["draws"] == MOST_DRAWS).all()
    alone = identifiability_by_noise(many[many["seed"] == 0], usual)
    assert not np.allclose(table["left"], alone["left"], rtol=0.01)
    assert {"goal x [m]", "goal y [m]"} < set(table["weight"])


def test_what_cannot_be_played_or_was_not_tried_has_no_row(usual) -> None:
    for rows in (trials("gone"), trials("two_player", sensor="gone")):
        assert identifiability_by_noise(rows, usual).empty
    for status in ("skipped", "harness_error"):
        assert identifiability_by_noise(trials("two_player", status=status), usual).empty
