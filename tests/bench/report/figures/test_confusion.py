"""The figure of who is mistaken for whom."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.figures import confusion, style
from olne_bench.bench.report.statistics.recognition import confusion_table, drivers
from olne_bench.bench.report.study import Study

ESTIMATORS = ("kkt_constrained", "kkt_residual", "uniform")


@pytest.fixture(scope="module")
def study(tempered) -> Study:
    return tempered(3)


@pytest.fixture(scope="module")
def trials(study) -> pd.DataFrame:
    """Estimates of three estimators: nearly exact, rough with some failures, and equal weights."""
    rng, rows = np.random.default_rng(0), []
    for seed in range(20):
        truth = study.scenes.truth("road", seed).weights
        for sigma in (0.0, 0.1, 0.2, 0.3, 0.5, 1.0):
            for name, noise in zip(ESTIMATORS, (sigma, 0.3 + 3 * sigma, None), strict=True):
                rough = (
                    0 * truth + 1
                    if noise is None
                    else truth ** np.exp(np.clip(noise * rng.normal(), -1, 1))
                )
                failed = name == "kkt_residual" and rng.uniform() < sigma / 2
                rows.append(
                    {
                        "scenario": "road",
                        "sensor": "full",
                        "sigma": sigma,
                        "seed": seed,
                        "estimator": name,
                        "status": "crash" if failed else "ok",
                        "weights": None if failed else rough.tolist(),
                    }
                )
    return pd.DataFrame(rows)


def test_a_panel_per_estimator_whose_rows_are_shares(trials, study) -> None:
    with style.applied():
        figure = confusion.draw(confusion_table(drivers(trials, study)))
    assert [axes.get_title() for axes in figure.axes] == list(ESTIMATORS)
    for axes in figure.axes:
        (image,) = axes.get_images()
        np.testing.assert_allclose(image.get_array().sum(axis=1), 1)
    (image,) = figure.axes[-1].get_images()  # equal weights are those of a normal driver
    np.testing.assert_array_equal(image.get_array()[:, 1], 1)


def test_there_is_none_where_drivers_have_no_temperaments(trials) -> None:
    plain = Study(scenarios={"road": ScenarioEntry(name="intersection", label="road")})
    assert confusion_table(drivers(trials, plain)).empty


def test_of_many_estimators_the_floor_is_left_out(trials, study) -> None:
    table = confusion_table(drivers(trials, study))
    more = [table, *(table.assign(estimator=f"e{k}") for k in range(4))]
    titles = [axes.get_title() for axes in confusion.draw(pd.concat(more)).axes]
    assert len(titles) == 6 and "uniform" not in titles
