"""Trajectories of the page: which trials can be played, and what they show."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.report.page import scenes
from olne_bench.bench.report.page.scenes import _chosen, scene_data

LEVELS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)


def chosen(levels, bundle, *, most, seeds=3, family=False, wanted=()):
    attempts = pd.DataFrame([(sigma, seed) for sigma in levels for seed in range(seeds)])
    attempts = attempts.set_axis(["sigma", "seed"], axis=1)
    scene = SimpleNamespace(
        trials=attempts[attempts["seed"] == 0] if family else attempts,
        study=SimpleNamespace(is_family=lambda _: family),
        name="any",
    )
    return _chosen(attempts, scene, bundle, most, wanted)


def test_the_bundle_comes_first_and_then_a_seed_of_each_level_from_the_largest_on() -> None:
    found = chosen(LEVELS, 0.2, most=8)
    assert found[:3] == [(0.2, 0), (0.2, 1), (0.2, 2)]
    assert found[3:] == [(0.5, 0), (0.1, 0), (0.05, 0), (0.02, 0), (0.01, 0)]


def test_a_bundle_takes_at_most_half_of_the_room() -> None:
    assert [sigma for sigma, _ in chosen(LEVELS, 0.2, most=10, seeds=9)].count(0.2) == 5


def test_there_are_at_least_six_if_there_are_so_many() -> None:
    assert len(chosen(LEVELS, 0.2, most=1)) == 6
    assert len(chosen(LEVELS[:1], 0.0, most=1)) == 3


def test_what_is_asked_for_is_among_them_if_it_exists() -> None:
    found = chosen(LEVELS, 0.2, most=6, wanted=[(0.0, 2), (0.0, 99)])
    assert (0.0, 2) in found
    assert (0.0, 99) not in found


def test_a_family_shows_at_most_four_draws_unless_asked_for_more() -> None:
    found = chosen(LEVELS, 0.2, most=60, seeds=9, family=True)
    assert {seed for _, seed in found} == {0, 1, 2, 3}
    asked = chosen(LEVELS, 0.2, most=60, seeds=9, family=True, wanted=[(0.0, 8)])
    assert (0.0, 8) in asked


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
    (draw,) = data["draws"].values()
    assert draw["axes"] == ["px", "py"]
    assert data["dt"] == truth.scenario.game.dt
    expected = truth.states[..., :2].swapaxes(0, 1)
    np.testing.assert_allclose(draw["truth"], expected, atol=5e-4 + 1e-9)
    assert data["bundle"] == 0.1
    samples = {(sample["sigma"], sample["seed"]): sample for sample in data["samples"]}
    assert list(samples) == [(0.1, 0), (0.1, 1), (0.01, 0), (0.01, 1)]
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
    counts = [len(scene_data(many, number=n, study=usual)["samples"]) for n in (1, 10, 1000)]
    assert counts[0] == 32  # all of them
    assert counts[0] > counts[1] >= counts[2] == 6


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize(("coordinates", "predictions"), [(20_000, 10**6), (10**9, 100)])
def test_a_page_holds_so_many_numbers_and_predictions(
    usual, trials, monkeypatch, number, coordinates, predictions
) -> None:
    room = []

    def choose(attempts, scene, bundle, most, wanted):
        room.append(most)
        return _chosen(attempts, scene, bundle, most, wanted)

    monkeypatch.setattr(scenes, "_MOST_COORDINATES", coordinates)
    monkeypatch.setattr(scenes, "_MOST_PREDICTIONS", predictions)
    monkeypatch.setattr(scenes, "_chosen", choose)
    data = scene_data(trials, number=number, study=usual)
    (draw,) = data["draws"].values()
    path = np.array(draw["truth"]).size  # players, steps, two coordinates
    each = 1 + len(data["samples"][0]["predictions"])  # of a sequence: what was observed as well
    (most,) = room
    for size, limit in ((path, coordinates), (1, predictions)):
        assert number * most * each * size <= limit
    full = [
        number * (most + 1) * each * size > limit
        for size, limit in ((path, coordinates), (1, predictions))
    ]
    assert any(full)
