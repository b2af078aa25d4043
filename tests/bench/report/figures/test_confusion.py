"""The figure of who is mistaken for whom."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report import figures
from olne_bench.bench.report.figures import confusion, draw_figures, style, trial
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.study import Study
from olne_bench.envs.scenarios import check_options

OPTIONS = {"weights": "temperaments", "num_players": 3}
ROAD = ScenarioEntry(name="intersection", label="road", options=OPTIONS, family=True)
STUDY = Study(scenarios={"road": ROAD}, salt="s")
ESTIMATORS = ("kkt_constrained", "kkt_residual", "uniform")


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
    """Estimates of three estimators: nearly exact, rough with some failures, and equal weights."""
    rng, rows = np.random.default_rng(0), []
    family = check_options("intersection", **OPTIONS)
    for seed in range(20):
        truth = family.tempered(STUDY.draw("road", seed).seed)
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


def test_a_row_of_panels_per_level_and_a_column_per_estimator(trials) -> None:
    with style.applied():
        figure = confusion.draw(trials, STUDY)
    assert len(figure.axes) == 5 * len(ESTIMATORS)  # of six levels, five are shown
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == list(ESTIMATORS) and not any(titles[3:])
    assert figure.axes[-3].get_ylabel() == "σ = 1 m"
    for axes in figure.axes:
        (image,) = axes.get_images()
        np.testing.assert_allclose(image.get_array().sum(axis=1), 1)
    for axes in figure.axes[2::3]:  # equal weights are those of a normal driver
        (image,) = axes.get_images()
        np.testing.assert_array_equal(image.get_array()[:, 1], 1)


def test_it_is_drawn_where_drivers_have_temperaments_only(trials, tmp_path, monkeypatch) -> None:
    plain = Study(
        scenarios={"road": ROAD.model_copy(update={"options": {"num_players": 3}})}, salt="s"
    )
    with pytest.raises(NotDrawnError, match="no driver has a temperament"):
        confusion.draw(trials, plain)
    monkeypatch.setattr(figures, "_KINDS", {})  # the others take their time
    monkeypatch.setattr(trial, "is_road", lambda *_: False)
    drawn = [draw_figures(trials, tmp_path, ("png",), study) for study in (STUDY, plain)]
    assert [[file.name for file in one.files] for one in drawn] == [["confusion_road.png"], []]
    assert not drawn[1].notes
