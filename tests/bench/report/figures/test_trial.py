"""The figure of one trial on a road, and the rule that chooses it."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report import figures
from olne_bench.bench.report.figures import draw_figures, style, trial
from olne_bench.bench.report.figures.scene import scene_of
from olne_bench.bench.report.not_drawn import NotDrawnError

DRAWS = 9


def attempts(failed: tuple[int, ...] = (), **errors: float) -> pd.DataFrame:
    """Trials at two levels and two sensors; at the larger level ``bad`` fails in some draws."""
    rows = [
        {
            "scenario": "road",
            "sensor": sensor,
            "sigma": sigma,
            "seed": seed,
            "estimator": name,
            "count": 1,
            "position_error": error * (1 + seed),
            "status": "ok",
            "published_forward": 1,
        }
        for name, error in (
            {"good": 0.1, "fair": 0.11, "bad": 3.0, "uniform": 9.0} | errors
        ).items()
        for sensor in ("full", "partial")
        for sigma in (0.1, 0.5)
        for seed in range(DRAWS)
    ]
    table = pd.DataFrame(rows)
    lost = (table["estimator"] == "bad") & table["seed"].isin(failed) & (table["sigma"] == 0.5)
    lost |= (table["estimator"] == "bad") & (table["sensor"] == "partial")
    table.loc[lost, "status"] = "failed_forward"
    table.loc[lost, "position_error"] = np.nan
    return table


def test_the_best_meets_the_one_that_it_beats_most() -> None:
    choice = trial.choose(attempts())
    assert choice.estimators == ("good", "fair")  # both lose all draws; fair predicts more
    mixed = attempts()
    better = (mixed["estimator"] == "fair") & (mixed["seed"] < 3)
    mixed.loc[better, "position_error"] = 0.01
    assert trial.choose(mixed).estimators == ("good", "bad")


@pytest.mark.parametrize(
    ("failed", "sigma", "draws"), [((), 0.5, 9), ((0, 1, 2, 8), 0.5, 5), (range(7), 0.1, 9)]
)
def test_the_noise_is_the_largest_that_both_predict_in_half_of_the_draws(
    failed: tuple[int, ...], sigma: float, draws: int
) -> None:
    table = attempts(tuple(failed))
    choice = trial.choose(table[table["estimator"] != "fair"])
    assert (choice.estimators, choice.sensor, choice.sigma) == (("good", "bad"), "full", sigma)
    assert len(choice.seeds) == draws
    assert f"good and bad predict {draws} of 9 draws" in choice.rule


def test_the_median_difference_comes_first() -> None:
    table = attempts((0, 1))
    choice = trial.choose(table[table["estimator"] != "fair"])
    assert choice.seeds[0] == 5  # the differences of draws 2 to 8 grow with the draw
    assert set(choice.seeds[1:3]) == {4, 6}


def test_what_cannot_be_chosen_is_said() -> None:
    table = attempts()
    with pytest.raises(NotDrawnError, match="two estimators"):
        trial.choose(table[table["estimator"].isin(["good", "uniform"])])
    nothing = table[table["estimator"].isin(["good", "bad"])].assign(published_forward=0)
    with pytest.raises(NotDrawnError, match="no trial in common"):
        trial.choose(nothing)


def test_truth_observations_and_two_predictions(road_trials, road_study) -> None:
    with style.applied():
        figure = trial.draw(road_trials, road_study)
    first, *others = figure.axes
    assert len(others) == 2 and all(axes.yaxis_inverted() for axes in figure.axes)
    assert "roundabout, draw 0: σ = 0.1 m, sensor full" in figure.get_suptitle()
    scene = scene_of(road_trials, road_study)
    points = [line.get_xydata() for line in first.lines if line.get_marker() == "."]
    np.testing.assert_allclose(points, scene.observed(0.1, 0)[..., :2].swapaxes(0, 1))
    for axes in others:  # the estimates are true
        assert "predicts, 0 m off" in axes.get_title()
        motion = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 2]
        np.testing.assert_allclose(
            motion, scene.recording.states[..., :2].swapaxes(0, 1), atol=1e-5
        )


def test_it_is_drawn_on_roads_only(road_trials, road_study, usual, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(figures, "_KINDS", {})  # the others take their time
    drawn = draw_figures(road_trials, tmp_path, ("png",), road_study)
    assert [file.name for file in drawn.files] == ["trial_roundabout.png"]
    assert not trial.is_road("two_player", usual) and not trial.is_road("unknown", usual)


def test_a_scene_grows_with_what_it_shows_but_not_without_limit(road_trials, road_study) -> None:
    scene = scene_of(road_trials, road_study)
    same = scene.showing(scene.recording.states)
    np.testing.assert_allclose(same.limits, scene.limits)
    far = scene.recording.states + np.array([20.0, 0, 0, 0])
    wider = np.ptp(scene.showing(far).limits, axis=1) - np.ptp(scene.limits, axis=1)
    np.testing.assert_allclose(wider, [20, 0], atol=1e-9)
    lost = scene.showing(scene.recording.states + 1e4)
    np.testing.assert_allclose(
        np.ptp(lost.limits, axis=1), 1.5 * np.ptp(scene.limits, axis=1), rtol=1e-9
    )
