"""Scenes of the page: which trials can be played, and what they show."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.page.scenes import scene_data


@pytest.fixture(scope="module")
def trials(usual, prediction_error) -> pd.DataFrame:
    truth = usual.scenes.truth("two_player", 0).weights
    other = np.full(truth.shape, 0.25)
    row = {"scenario": "two_player", "sensor": "full", "status": "ok", "published_forward": 1.0}
    row |= {"count": 1, "cosine_error": 0.0, "position_error": 0.0, "weights": truth.tolist()}
    off = {"estimator": "off", "weights": other.tolist(), "cosine_error": 0.5}
    off["position_error"] = prediction_error("two_player", 0, other)
    rows = [
        row | {"estimator": "exact"} | change | {"sigma": sigma, "seed": seed}
        for change in ({}, off)
        for sigma in (0.01, 0.1)
        for seed in range(2)
    ]
    rows[0]["status"] = "crash"
    return pd.DataFrame(rows)


def test_truth_and_predictions_are_paths_in_millimetres(usual, trials) -> None:
    data = scene_data(trials, study=usual)
    truth = usual.scenes.truth("two_player", 0)
    (draw,) = data["draws"].values()
    assert draw["axes"] == ("px", "py") and data["shown"] == ["exact", "off"]
    assert data["dt"] == truth.dt
    expected = truth.states[..., :2].swapaxes(0, 1)
    np.testing.assert_allclose(draw["truth"], expected, atol=5e-4 + 1e-9)
    samples = {(sample["sigma"], sample["seed"]): sample for sample in data["samples"]}
    assert list(samples) == [(0.1, 0), (0.01, 0)]
    for (sigma, _), sample in samples.items():
        noise = np.abs(np.array(sample["observed"]) - expected).mean()
        assert noise == pytest.approx(0.8 * sigma, rel=0.3)
        exact, off = sample["predictions"]
        assert [exact["estimator"], off["estimator"]] == ["exact", "off"]
        difference = np.abs(np.array(off["paths"]) - expected).mean()
        assert difference == pytest.approx(off["errors"]["position_error"], abs=1e-3)
    crashed, played = (samples[place]["predictions"][0] for place in ((0.01, 0), (0.1, 0)))
    assert (crashed["status"], crashed["paths"]) == ("crash", None)
    np.testing.assert_allclose(played["paths"], expected, atol=1e-3)


def test_pages_of_many_scenarios_have_fewer_sequences_of_each(usual, trials) -> None:
    levels = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    one = trials[(trials["sigma"] == 0.1) & (trials["seed"] == 0)]
    many = pd.concat([one.assign(sigma=sigma) for sigma in levels])
    counts = [len(scene_data(many, number=n, study=usual)["samples"]) for n in (1, 40, 1000)]
    assert counts == [8, 3, 2]
