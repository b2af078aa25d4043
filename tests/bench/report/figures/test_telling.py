"""The choice of the trial that pictures show."""

import pandas as pd
import pytest

from olne_bench.bench.report.figures.telling import telling_level, telling_trial


def trials(errors: dict[str, dict[tuple[float, int], float | None]]) -> pd.DataFrame:
    """Position errors of estimators by noise level and seed; None for no prediction."""
    return pd.DataFrame(
        [
            {
                "estimator": name,
                "sensor": "full",
                "sigma": sigma,
                "seed": seed,
                "status": "failed_forward" if error is None else "ok",
                "published_forward": 1,
                "position_error": error,
            }
            for name, cells in errors.items()
            for (sigma, seed), error in cells.items()
        ]
    )


GOOD = {(0.0, 0): 0.0, (0.1, 0): 0.1, (0.5, 0): 0.2, (0.1, 1): 0.1, (0.5, 1): 0.3}


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        ({(0.0, 0): 0.0, (0.1, 0): 0.9, (0.5, 0): 0.5, (0.5, 1): 0.4}, (0.1, 0)),
        ({(0.0, 0): 0.0, (0.1, 0): 0.9, (0.5, 0): 0.5, (0.5, 1): 4.0}, (0.5, 1)),
        # Without noise all are equal and nothing is visible, even if all others lack a prediction.
        ({(0.0, 0): 0.0, (0.1, 0): None, (0.5, 0): None, (0.5, 1): None}, (0.5, 1)),
        ({(0.0, 0): None}, (0.5, 1)),
    ],
)
def test_methods_differ_where_it_is_shown(bad, expected):
    assert telling_trial(trials({"good": GOOD, "bad": bad})) == expected


def test_a_level_goes_by_its_median_and_the_floor_does_not_count():
    bad = {(0.1, 0): 0.9, (0.1, 1): 0.9, (0.5, 0): 0.2, (0.5, 1): 9.0, (0.5, 2): 0.2}
    floor = dict.fromkeys(bad, 50.0)
    assert telling_level(trials({"good": GOOD, "bad": bad, "uniform": floor})) == 0.1


def test_what_the_published_step_misses_is_not_drawn_and_does_not_count():
    found = trials({"good": GOOD, "bad": {(0.1, 0): 0.9, (0.5, 0): 5.0}})
    found.loc[found["position_error"] == 5.0, "published_forward"] = 0
    assert telling_trial(found)[0] == 0.1


def test_without_any_prediction_it_is_the_largest_level():
    assert telling_trial(trials({"a": {(0.1, 3): None, (0.5, 4): None}})) == (0.5, 3)
