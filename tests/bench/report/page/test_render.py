"""The page of a run, and of two runs, as HTML."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.page.render import after_name, render_page, two_runs_page
from olne_bench.bench.report.statistics.pairs import compare_runs
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from tests.bench.report.conftest import LOST, trial_row


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
    assert [one for one in tags.fetched if not one.startswith("data:image/png")] == ["data:,"]
    assert "img" not in tags.names
    assert tags.names.count("script") == 2
    written = re.sub(r'(xmlns(:xlink)?="[^"]*")|(<a href="https://[^"]*">)', "", html)
    assert not re.findall(r"url\((?!#)|@import|https?://(?!www\.w3)", written)
    assert len(html.encode()) < 2_000_000


def test_scenes_have_every_level_and_what_failed(page: Path, embedded) -> None:
    data = embedded(page.read_text(encoding="utf-8"))
    assert [s["name"] for s in data["scenarios"]] == ["highway_overtaking", "two_player"]
    for scenario in data["scenarios"]:
        assert {s["sigma"] for s in scenario["scene"]["samples"]} == {0.01, 0.05}
        assert len(scenario["scene"]["shown"]) == 2
        assert set(scenario["pictures"]) == {"trial", "errors", "failures", "identifiability"}


def test_predictions_at_the_true_weights_are_the_truth(page: Path, embedded) -> None:
    data = embedded(page.read_text(encoding="utf-8"))
    scene = data["scenarios"][1]["scene"]
    for prediction in scene["samples"][0]["predictions"]:
        if prediction["estimator"] == "uniform":
            np.testing.assert_allclose(prediction["paths"], scene["draws"]["0"]["truth"], atol=2e-3)


def test_nothing_but_failures_of_a_scenario_that_is_not_known(embedded) -> None:
    row = trial_row(scenario="gone", status="timeout", cosine_limit=np.nan, solve_seconds=np.nan)
    trials = pd.DataFrame([row | LOST])
    html = render_page(trials, tabulate(trials), []).html
    assert embedded(html)["scenarios"][0]["scene"] is None
    assert "kept no provenance" in html


def test_temperaments_have_a_section_where_drivers_have_some(
    page: Path, small_study: pd.DataFrame, usual: Study
) -> None:
    assert "Who drives" not in page.read_text(encoding="utf-8")
    place = {"scenario": "two_player", "sensor": "full", "estimator": "uniform"}
    errors = {**place, "sigma": np.nan, "temperament": "normal", "cosine_error_median": 0.1234}
    errors |= {"drivers": 7, "recognised": 0.5, "recognised_low": 0.2, "recognised_high": 0.8}
    tables = replace(tabulate(small_study, usual), temperaments=pd.DataFrame([errors]))
    html = render_page(small_study, tables, [], usual).html
    (row,) = re.findall(r"Who drives</summary>.*?<tbody>(.*?)</tbody>", html, re.DOTALL)
    cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
    assert cells[2:] == ["normal", "7", "0.12", "50 % <small>[20 %, 80 %]</small>"]


def test_both_runs_are_on_the_page_and_only_what_they_share(
    small_study: pd.DataFrame, usual: Study, embedded
) -> None:
    one = small_study[small_study["scenario"] == "two_player"]
    better = one.assign(position_error=one["position_error"] / 2)
    names = {"kkt_constrained": "kkt_constrained", "uniform": "uniform"}
    other = better[better["seed"] < 4]
    changes = compare_runs(one, other, names, usual)
    html = two_runs_page(("runs/a", one, []), ("runs/b", other, []), names, changes, usual)
    data = embedded(html)
    labels = [e["name"] for e in data["estimators"]]
    assert labels == ["kkt_constrained", "kkt_constrained (second)", "uniform"]
    scores = pd.read_csv(StringIO(data["tables"]["leaderboard"]))
    assert set(scores["trials"]) == {2 * 4}
    own = scores.set_index(["estimator", "sensor"])["position_error_score"]
    assert own["kkt_constrained (second)", "full"] == pytest.approx(0.5)
    assert "<h1>runs/a and runs/b</h1>" in html
    assert html.count('<span class="yes">better</span>') == (changes["verdict"] == "better").sum()
    assert "only the trials that both runs/a and runs/b have" in html


def test_a_name_changes_only_where_it_stands_twice() -> None:
    names = {"a": "a", "b": "faster"}
    assert after_name("a", names) == "a (second)"
    assert after_name("faster", names) == "faster"
    assert after_name("uniform", {"uniform": "uniform"}) == "uniform"
