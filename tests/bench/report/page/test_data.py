"""What the page's charts show."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.page import data
from olne_bench.bench.report.study import USUAL


def table(counts: dict[str, int], levels: int = 1) -> pd.DataFrame:
    """Trials of two players, with given numbers per estimator at each noise level."""
    rows = [
        {
            "scenario": "two_player",
            "sensor": "full",
            "estimator": name,
            "sigma": 0.1 * (k + 1),
            "seed": seed,
            "status": "ok",
            "published_forward": 1,
            "position_error": 1.0 + seed + k,
            "cosine_error": 0.25,
            "covers_truth": 1.0,
            "observation_error": 0.08 * (k + 1) + 1e-4 * seed,
            "count": 1,
            "weights": None,
        }
        for name, count in counts.items()
        for k in range(levels)
        for seed in range(count)
    ]
    return pd.DataFrame(rows)


@pytest.fixture(autouse=True)
def without_scenes(monkeypatch) -> None:
    monkeypatch.setattr(data, "scene_data", lambda *_, **__: {"truth": []})


def series_of(trials: pd.DataFrame) -> dict[str, dict]:
    (scenario,) = data.chart_data(trials).content["scenarios"]
    return {one["estimator"]: one for one in scenario["series"]}


@pytest.mark.parametrize(
    ("most", "counts", "every"),
    [
        (20, {"a": 10, "b": 10}, 1),
        (20, {"a": 11, "b": 11}, 2),
        (20, {"a": 20}, 1),  # one series may have all the points
        (20, {"a": 21}, 2),
        (20, {"a": 10, "b": 10, "uniform": 10}, 1),  # the floor has none
        (20, {"a": 30, "b": 30}, 3),
        (2, {"a": 5, "b": 5}, 1),  # a few are always drawn
        (2, {"a": 6, "b": 6}, 2),
    ],
)
def test_points_are_shared_by_the_series(monkeypatch, most, counts, every) -> None:
    monkeypatch.setattr(data, "_MOST_POINTS", most)
    monkeypatch.setattr(data, "_FEWEST_POINTS", 5)
    drawn = {name: one for name, one in series_of(table(counts)).items() if one["points"]}
    assert set(drawn) == set(counts) - {"uniform"}
    for name, one in drawn.items():
        assert one["every"] == every
        assert one["points"]["seed"] == list(range(0, counts[name], every))


def test_points_come_in_the_order_of_their_noise_with_all_that_is_told() -> None:
    trials = table({"a": 3}, levels=2).sample(frac=1, random_state=0).reset_index(drop=True)
    trials.loc[trials["seed"] == 1, ["status", "position_error"]] = ["failed_forward", np.nan]
    trials.loc[trials["seed"] == 2, "published_forward"] = 0
    points = series_of(trials)["a"]["points"]
    assert points["x"] == sorted(points["x"])
    assert points["sigma"] == [0.1] * 3 + [0.2] * 3
    assert points["seed"] == [0, 1, 2] * 2
    assert points["status"] == ["ok", "failed_forward", "ok"] * 2
    assert points["published"] == [0, 1, 1] * 2
    assert points["position_error"] == [1.0, None, 3.0, 2.0, None, 4.0]
    assert points["cosine_error"] == [0.25] * 6
    assert "covers_truth" not in points  # a share has no chart


def test_what_a_metric_says_nothing_of_is_a_dash() -> None:
    trials = table({"a": 2, "b": 2})
    trials.loc[trials["estimator"] == "b", "cosine_error"] = np.nan
    assert series_of(trials)["b"]["points"]["cosine_error"] == ["–", "–"]
    assert series_of(trials)["a"]["points"]["cosine_error"] == [0.25, 0.25]


def test_few_levels_have_medians_and_many_have_rolling_ones() -> None:
    few = series_of(table({"a": 5, "uniform": 5}, levels=2))
    middle = few["a"]["rolling"]["position_error"]
    assert middle["sigma"] == [0.1, 0.2]
    assert (middle["low"], middle["mid"], middle["high"]) == ([2, 3], [3, 4], [4, 5])
    floor = few["uniform"]["rolling"]["position_error"]
    assert set(floor) == {"x", "low", "mid", "high"}
    assert floor["x"][0] == 0 and floor["x"][1] == pytest.approx(0.1604)
    assert floor["low"] == floor["mid"] == floor["high"] == [3.5, 3.5]
    many = series_of(table({"a": 30}, levels=10))["a"]["rolling"]["position_error"]
    assert "sigma" not in many
    assert len(many["x"]) == data._MOST_NODES
    assert many["x"] == sorted(many["x"])


def test_colours_and_dashes_are_those_of_the_figures() -> None:
    trials = table({"a": 2, "kkt_residual": 2, "uniform": 2})
    trials = pd.concat([trials, trials.assign(sensor="partial")], ignore_index=True)
    content = data.chart_data(trials).content
    assert [one["name"] for one in content["estimators"]] == ["kkt_residual", "a", "uniform"]
    assert [one["floor"] for one in content["estimators"]] == [False, False, True]
    assert content["sensors"] == ["full", "partial"]
    assert content["primary"] == "position_error"
    assert [one["name"] for one in content["metrics"]] == ["position_error", "cosine_error"]
    assert [one["prediction"] for one in content["metrics"]] == [True, False]
    (scenario,) = content["scenarios"]
    assert not scenario["curves"]
    drawn = split(trials)
    for one, series in zip(scenario["series"], drawn, strict=True):
        assert one["colour"] == series.colour
        assert style.LINE_STYLES[one["dash"]] == series.line_style
        assert one["light"] == style.is_light(series.colour)


def test_what_cannot_be_drawn_is_told(monkeypatch) -> None:
    def refuse(*_, **__):
        raise NotDrawnError("it is gone")

    monkeypatch.setattr(data, "scene_data", refuse)
    told = data.chart_data(table({"a": 2}))
    assert told.notes == ["trajectories of two_player on the page: it is gone"]
    assert told.content["scenarios"][0]["scene"] is None
    assert len(told.content["scenarios"][0]["series"]) == 1
    none = data.chart_data(table({"a": 2}), replace(USUAL, metrics=()))
    assert none.content["primary"] is None and none.content["metrics"] == []
