"""A foreign metric appears in all parts of a report, by its declaration alone."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.suite import GateLimits
from olne_bench.bench.report.figures import over_noise, style
from olne_bench.bench.report.gate import check_limits
from olne_bench.bench.report.leaderboard_text import format_board, latex, markdown
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.statistics.pairs import compare_runs
from olne_bench.bench.report.study import Study, primary, study_of
from olne_bench.bench.report.tables import tabulate
from olne_bench.errors import UserError
from tests.bench.report.conftest import LOST, trial_row

JERK = MetricDeclaration(
    "jerk_error",
    label="jerk error",
    unit="m/s^3",
    worst=9.0,
    gated=True,
    compared=True,
    description="How far predicted jerks are off.",
)
ON_ROAD = MetricDeclaration("on_road", label="on the road", summary="share")
STUDY = Study(metrics=(*BUILT_IN, JERK, ON_ROAD))


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    rows = [
        trial_row(
            scenario="of_another_version",
            sensor=sensor,
            estimator=name,
            seed=seed,
            jerk_error=scale * rng.uniform(1, 1.1),
            on_road=float(seed % 4 > 0),
        )
        for name, scale in (("a", 0.25), ("b", 2.0))
        for sensor in ("full", "partial", "gappy")
        for seed in range(20)
    ]
    table = pd.DataFrame(rows)
    lost = (table["estimator"] == "b") & (table["seed"] < 5)
    table.loc[lost, [*LOST, "jerk_error", "on_road"]] = np.nan
    table.loc[lost, "status"] = "crash"
    return table


def test_the_leaderboard_has_its_quartiles_mean_and_score(trials):
    table = tabulate(trials, STUDY).leaderboard.set_index(["sensor", "estimator"])
    a, b = table.loc[("gappy", "a")], table.loc[("gappy", "b")]
    assert 0.25 <= a["jerk_error_q25"] <= a["jerk_error_median"] <= a["jerk_error_q75"] <= 0.275
    assert a["jerk_error_mean_low"] < a["jerk_error_mean"] < a["jerk_error_mean_high"]
    # Five of twenty crash, and count as the worst value.
    assert b["jerk_error_mean"] == pytest.approx((5 * 9 + 15 * 2.1) / 20, abs=0.1)
    assert a["jerk_error_score"] == 1 and 4 < b["jerk_error_score"] < 6
    assert (a["on_road_share"], a["on_road_trials"], b["on_road_trials"]) == (0.75, 20, 15)


def test_all_texts_name_it_with_its_unit(trials):
    table = tabulate(trials, STUDY).leaderboard
    head, _, *rows = markdown(table, STUDY).splitlines()
    assert r"| Jerk error \[m/s^3\] |" in head and "| On the road |" in head
    assert sum("| **1** |" in row for row in rows) == 6  # position errors are the same
    tex = latex(table, STUDY)
    assert r"Jerk error [m/s\textasciicircum{}3]" in tex and r"75\% of 20" in tex


def test_the_page_has_its_columns_and_scores(trials, embedded):
    html = render_page(trials, tabulate(trials, STUDY), [], STUDY).html
    assert html.count(">Jerk error [m/s^3]</button>") == 1
    assert html.count("<td>jerk error</td>") == 2 + 1  # scores, and the pair
    assert html.count(">On the road</button>") == 1
    data = embedded(html)
    assert [m["name"] for m in data["metrics"]][-1] == "jerk_error"
    assert data["sensors"] == ["full", "partial", "gappy"]


def test_the_figure_of_errors_has_its_panels(trials):
    two = trials[trials["sensor"] != "gappy"]
    with style.applied():
        figure = over_noise.draw_errors(two, STUDY)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["Position error [m]", "Cosine error", "Jerk error [m/s^3]"] * 2
    assert [axes.get_title() for axes in figure.axes] == ["full"] * 3 + ["partial"] * 3


def test_a_gate_may_limit_it_where_it_says_so(trials):
    table = tabulate(trials, STUDY).leaderboard
    outcomes = check_limits(table, {"a": GateLimits(jerk_error=1.0)}, STUDY)
    assert [o.passed for o in outcomes] == [True] * 3
    strict = check_limits(table, {"b": GateLimits(jerk_error=1.0)}, STUDY)
    assert not any(o.passed for o in strict)
    with pytest.raises(UserError, match="limits 'on_road', which is not a metric") as caught:
        check_limits(table, {"a": GateLimits(on_road=1.0)}, STUDY)
    assert "jerk_error" in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(UserError, match="limits 'jerk_error'"):
        check_limits(table, {"a": GateLimits(jerk_error=1.0)})


def test_two_runs_are_compared_by_it(trials):
    worse = trials.assign(jerk_error=trials["jerk_error"] * 1.5)
    table = compare_runs(trials, worse, {"a": "a"}, STUDY)
    about = table["error"] == "jerk_error"
    assert table.loc[about, "verdict"].tolist() == ["worse"] * 3
    assert set(table.loc[~about, "verdict"]) == {"same"}


def test_the_suite_of_a_run_says_what_its_metrics_are():
    """Built-in metrics keep their order, and missing fields are those of the built-in ones."""
    told = (
        ("jerk_error", "mine.py:Jerk", {"label": "jerk", "worst": None}),
        ("covers_truth", "covers_truth", {"label": "covered", "unit": ""}),
        ("farthest_1s", "farthest_ahead", {"label": "far"}),
        ("position_error", "position_error", {"compared": True}),
    )
    entries = [SimpleNamespace(column=c, name=name, declaration=d) for c, name, d in told]
    listed = dict.fromkeys(("scenarios", "sensors", "estimators", "figures"), ())
    suite = SimpleNamespace(kind="trials", metrics=entries, salt="s", **listed)
    found = study_of([suite]).metrics
    names = ["position_error", "covers_truth", "jerk_error", "farthest_1s"]
    assert [one.name for one in found] == names
    assert found[3].radius and found[3].label == "far"
    assert found[0].unit == "m" and found[0].needs_prediction
    assert found[1].is_share
    assert found[2] == MetricDeclaration("jerk_error", label="jerk")
    assert study_of([]).metrics == BUILT_IN


def test_estimators_are_ranked_by_what_there_is():
    position, *_ = BUILT_IN
    assert primary([JERK, position]) == position
    assert primary([ON_ROAD, JERK]) == JERK
    assert primary([ON_ROAD]) is None


def test_a_run_without_errors_to_compare_is_shown_all_the_same(trials):
    study = Study(metrics=(ON_ROAD,))
    tables = tabulate(trials, study)
    assert "On the road" in markdown(tables.leaderboard, study)
    assert "Nobody has a score" in format_board(tables, study)
    assert "On the road" in render_page(trials, tables, [], study).html
