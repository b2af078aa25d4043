"""Figures of estimates while a motion goes on."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.figures.online import stream_figures
from olne_bench.bench.report.write import write_figures


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
    table = rows(["map", "constant_velocity"])
    ((_, figure),) = stream_figures(table[table["sigma"] == 0.1])
    titles = ["Cosine error", "Position error 1 s ahead [m]", "Latency [s]"]
    assert [axes.get_title() for axes in figure.axes] == titles  # nothing is known 3 s ahead
    first, _, last = figure.axes
    line = next(one for one in first.lines if one.get_color() != "#555555")
    np.testing.assert_allclose(line.get_xdata(), 0.4 * np.arange(1, 5))
    np.testing.assert_allclose(line.get_ydata(), [0.1, 0.2 / 3, 0.05, 0.04])
    assert len(first.lines) == 2 and len(first.collections) == 1
    assert len(last.lines) == 1 or not last.lines[0].get_xdata().size


def test_each_noise_level_has_a_file_with_a_name_that_any_system_allows(tmp_path):
    skipped = rows(["map"]).assign(status="skipped", scenario="none")
    pictures = write_figures(stream_figures(pd.concat([rows(["map"]), skipped])), tmp_path, ["png"])
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["online_a_b_full_0.1.png", "online_a_b_full_0.3.png"]
    assert files[0].stat().st_size > 10_000
    assert len(pictures) == 2 and pictures[0].startswith("<svg")
    assert write_figures(stream_figures(rows(["map"])), tmp_path, []) == []
