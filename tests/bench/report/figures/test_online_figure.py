"""Figures of online studies."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures.streams import draw_online, figure_of


def rows(estimators: list[str]) -> pd.DataFrame:
    """Three motions of five samples at two noise levels; nothing was estimated at the first."""
    made = []
    for estimator in estimators:
        for sigma in (0.1, 0.3):
            for seed in range(3):
                for k in range(5):
                    error = (1 + seed) * sigma / (1 + k) if k else np.nan
                    row = {"scenario": "a/b", "sensor": "full", "sigma": sigma, "seed": seed}
                    row |= {"estimator": estimator, "time": 0.4 * k, "status": "ok"}
                    row |= {"cosine_error": error, "fde_1s": 2 * error, "fde_3s": np.nan}
                    made.append(row | {"latency": 0.01 if estimator == "map" else np.nan})
    return pd.DataFrame(made)


def test_medians_and_quartiles_over_motions():
    figure = figure_of("s", rows(["map", "constant_velocity"]))
    panels = figure.axes
    assert len(panels) == 3 * 2  # nothing is known 3 s ahead
    assert [axes.get_title() for axes in panels[:2]] == ["σ = 0.1 m", "σ = 0.3 m"]
    line = next(one for one in panels[0].lines if one.get_color() != "#555555")
    np.testing.assert_allclose(line.get_xdata(), 0.4 * np.arange(1, 5))
    np.testing.assert_allclose(line.get_ydata(), [0.1, 0.2 / 3, 0.05, 0.04])
    assert len(panels[0].lines) == 2 and len(panels[0].collections) == 1
    assert len(panels[4].lines) == 1 or not panels[4].lines[0].get_xdata().size
    assert panels[2].get_ylabel() == "Position error 1 s ahead [m]"


def test_files_have_names_that_any_system_allows(tmp_path):
    skipped = rows(["map"]).assign(status="skipped", scenario="none")
    files = draw_online(pd.concat([rows(["map"]), skipped]), tmp_path, ["png"])
    assert [file.name for file in files] == ["online_a_b_full.png"]
    assert files[0].stat().st_size > 10_000
