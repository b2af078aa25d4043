import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.page import render
from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate


class Tags(HTMLParser):
    """Names of elements, and the values that would make a browser fetch something."""

    def __init__(self) -> None:
        super().__init__()
        self.names: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        for name, value in attrs:
            if name in ("src", "srcset", "action") or (name == "href" and tag != "a"):
                self.fetched.append(value or "")


def test_page_needs_no_network_and_escapes_names(page: Path) -> None:
    html = page.read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(html)
    assert tags.fetched == ["data:,"]
    assert "img" not in tags.names
    assert tags.names.count("script") == 2
    # Names in SVG that is written are no addresses.
    written = html.replace("http://www.w3.org/2000/svg", "").replace("url(#clip", "")
    written = re.sub(r'<a href="https://[^"]*">', "", written)
    assert not re.findall(r"url\(|@import|https?://", written)
    assert len(html.encode()) < 2_000_000


def test_charts_hold_every_trial(page: Path, embedded) -> None:
    data = embedded(page.read_text(encoding="utf-8"))
    assert [s["name"] for s in data["scenarios"]] == ["highway_overtaking", "two_player"]
    for scenario in data["scenarios"]:
        drawn = [s for s in scenario["series"] if s["points"]]
        assert len(drawn) == 4
        assert all(len(s["points"]["x"]) == 12 for s in drawn)
        lost = [p for s in drawn for p in s["points"]["position_error"] if p is None]
        assert len(lost) == 4  # the crashes
        samples = scenario["scene"]["samples"]
        assert {s["sigma"] for s in samples} == {0.01, 0.05}
        crashed = [p for s in samples for p in s["predictions"] if p["status"] == "crash"]
        assert crashed and all(p["paths"] is None for p in crashed)


def test_predictions_at_the_true_weights_are_the_truth(page: Path, embedded) -> None:
    data = embedded(page.read_text(encoding="utf-8"))
    scene = data["scenarios"][1]["scene"]
    for prediction in scene["samples"][0]["predictions"]:
        if prediction["estimator"] == "uniform":
            np.testing.assert_allclose(prediction["paths"], scene["draws"]["0"]["truth"], atol=2e-3)


def test_a_large_study_leaves_points_out(small_study: pd.DataFrame, monkeypatch) -> None:
    from olne_bench.bench.report.page import data

    monkeypatch.setattr(data, "_MOST_POINTS", 10)
    monkeypatch.setattr(data, "_FEWEST_POINTS", 5)
    monkeypatch.setattr(data, "scene_data", lambda *_, **__: None)
    chart = data.chart_data(small_study).content
    assert {s["every"] for s in chart["scenarios"][0]["series"] if s["points"]} == {3}


def test_nothing_but_failures_of_a_scenario_that_is_not_known(embedded) -> None:
    row = {"suite": "s", "scenario": "gone", "sensor": "full", "estimator": "e", "parameters": "{}"}
    row |= {
        "sigma": 0.1,
        "seed": 0,
        "count": 1,
        "status": "timeout",
        "message": "",
        "weights": None,
    }
    numbers = ("cosine_error", "position_error", "cosine_limit", "observation_error")
    trials = pd.DataFrame([row]).assign(**dict.fromkeys((*numbers, "solve_seconds"), np.nan))
    trials["published_forward"] = np.nan
    html = render_page(trials, tabulate(trials), []).html
    assert embedded(html)["scenarios"][0]["scene"] is None
    assert "kept no provenance" in html


def test_only_leaders_are_bold(small_study: pd.DataFrame, usual: Study) -> None:
    """Not the floor, nor an infinite median, nor any row without significant differences."""

    def bold(trials: pd.DataFrame) -> list[str]:
        tables = tabulate(trials, usual)
        html = render_page(trials, tables, [], usual).html
        cells = re.findall(r'<td class="n half"[^>]*>\s*(<b>)?', html)
        assert len(cells) == 2 * len(tables.leaderboard)
        leads = html.count('class="rank first"')
        assert leads == sum(cell != "" for cell in cells[::2])
        return [cell for cell in cells if cell]

    one = small_study[small_study["scenario"] == "highway_overtaking"]
    known = one["estimator"].isin(["kkt_constrained", "uniform"])
    worse = one["position_error"].where(known, 50.0)
    told = one.assign(position_error=worse.where(one["status"] == "ok"))
    assert len(bold(told)) == 2  # by position error, in each sensor
    few = told[told["seed"] < 2]
    assert bold(few) == []
    assert tabulate(few, usual).leaderboard["position_error_rank"].isna().all()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (2e-15, "≈ 0"),
        (0.00025, "0.00025"),
        (0.000025, "2.5·10⁻⁵"),
        (0.0123, "0.012"),
        (99.7, "100"),
        (502.3, "502"),
        (1.5e7, "1.5·10⁷"),
        (np.inf, "∞"),
        (np.nan, "–"),
    ],
)
def test_numbers_for_people(value: float, text: str) -> None:
    assert human(value) == text


def test_bars_tell_small_errors_apart_and_have_an_end() -> None:
    logs = [render._log(error) for error in (0.0, 1e-9, 1e-4, 1e-3, 1.0, 10.0)]
    assert logs[0] == logs[1] < logs[2]
    np.testing.assert_allclose(logs[2:], [-4, -3, 0, 1])
    assert render._log(float("inf")) == float("inf")


def test_each_estimator_has_a_paragraph(page: Path, small_study: pd.DataFrame, usual) -> None:
    html = page.read_text(encoding="utf-8")
    assert html.count('<p class="said">') == small_study["estimator"].nunique()
    told = tabulate(small_study, usual).paragraphs
    assert all(
        sentence in html for one in told for sentence in one.sentences if "<" not in sentence
    )


def test_temperaments_have_a_section_where_drivers_have_some(
    page: Path, small_study: pd.DataFrame, usual: Study
) -> None:
    assert 'id="drivers"' not in page.read_text(encoding="utf-8")
    place = {"scenario": "two_player", "sensor": "full", "estimator": "uniform"}
    errors = {**place, "sigma": np.nan, "temperament": "normal", "cosine_error_median": 0.1234}
    counts = {**place, "sigma": 0.1, "temperament": "normal", "recognised": "cautious"}
    tables = replace(
        tabulate(small_study, usual),
        temperaments=pd.DataFrame([errors]),
        confusions=pd.DataFrame([counts | {"drivers": 7, "share": 1.0}]),
    )
    html = render_page(small_study, tables, [], usual).html
    (row,) = re.findall(r'<section id="drivers">.*?<tbody>(.*?)</tbody>', html, re.DOTALL)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells == ["full", *["–"] * 5, "0.12", "0", "<b>0</b>", "100", "0", *["–"] * 5]
