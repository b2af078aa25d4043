"""Trajectories of the page: which trials can be played, and what of them."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.report.page.scenes import _chosen, scene_data

LEVELS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)


def chosen(levels, bundle, sequences, seeds=3):
    trials = pd.DataFrame([(sigma, seed) for sigma in levels for seed in range(seeds)])
    scene = SimpleNamespace(trials=trials.set_axis(["sigma", "seed"], axis=1))
    return _chosen(scene, bundle, sequences)


def test_the_bundle_comes_first_and_then_a_few_levels_from_the_largest_on() -> None:
    found = chosen(LEVELS, 0.2, sequences=2)
    assert found[:2] == [(0.2, 0), (0.2, 1)]
    rest = [sigma for sigma, seed in found[2:]]
    assert rest == sorted(rest, reverse=True)
    assert len(rest) == 3
    assert (rest[0], rest[-1]) == (0.5, 0.0)  # the largest and the least are among them
    assert {seed for _, seed in found[2:]} == {0}


@pytest.mark.parametrize("levels", [LEVELS[:1], LEVELS[:2], LEVELS[:4]])
def test_of_few_levels_all_are_shown(levels) -> None:
    found = chosen(levels, levels[-1], sequences=9)
    assert {sigma for sigma, _ in found} == set(levels)
    assert sum(sigma == levels[-1] for sigma, _ in found) == 3


@pytest.fixture(scope="module")
def trials(usual, prediction_error) -> pd.DataFrame:
    truth = true_recording(usual.draw("two_player", 0)).scenario.weights
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
    data = scene_data(trials, number=1, study=usual)
    truth = true_recording(usual.draw("two_player", 0))
    assert data["axes"] == ["px", "py"]
    assert data["dt"] == truth.scenario.game.dt
    expected = truth.states[..., :2].swapaxes(0, 1)
    np.testing.assert_allclose(data["truth"], expected, atol=5e-4 + 1e-9)
    assert data["bundle"] == 0.1
    samples = {(sample["sigma"], sample["seed"]): sample for sample in data["samples"]}
    assert list(samples) == [(0.1, 0), (0.1, 1), (0.01, 0)]
    for (sigma, _), sample in samples.items():
        assert np.abs(np.array(sample["observed"]) - expected).mean() == pytest.approx(
            0.8 * sigma, rel=0.3
        )
        exact, off = sample["predictions"]
        assert [exact["estimator"], off["estimator"]] == ["exact", "off"]
        assert off["errors"]["cosine_error"] == 0.5
        difference = np.abs(np.array(off["paths"]) - expected).mean()
        assert difference == pytest.approx(off["errors"]["position_error"], abs=1e-3)
    crashed, played = (samples[place]["predictions"][0] for place in ((0.01, 0), (0.1, 1)))
    assert (crashed["status"], crashed["paths"]) == ("crash", None)
    np.testing.assert_allclose(played["paths"], expected, atol=1e-3)


def test_pages_of_many_scenarios_have_fewer_sequences_of_each(usual, trials) -> None:
    many = pd.concat([trials.assign(seed=trials["seed"] + 2 * k) for k in range(8)])
    counts = [
        sum(sample["sigma"] == 0.1 for sample in scene_data(many, number=n, study=usual)["samples"])
        for n in (1, 10, 1000)
    ]
    assert counts[0] == 12
    assert counts[0] > counts[1] >= counts[2] == 4
