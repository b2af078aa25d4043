import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd

from olne_bench.bench.report.page.render import board, render_page
from olne_bench.bench.report.page.verdict import verdict
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


def test_the_board_has_five_columns_the_best_first_and_the_floor_last(
    small_study: pd.DataFrame, usual: Study
) -> None:
    tables = tabulate(small_study, usual)
    table = board(tables, usual)
    assert table.heads == ["Estimator", "Score", "Position error [m]", "Failures", "Time [ms]"]
    scores = [float(cells[1].key or "nan") for _, cells in table.rows]
    assert scores[:2] == sorted(scores[:2])
    assert table.rows[-1][0] == {"class": "floor"} and "uniform" in table.rows[-1][1][0].text
    held = small_study.assign(held_out_error=0.1)
    assert board(tabulate(held, usual), usual).heads[3] == "Held-out error [m]"


def test_without_noise_there_are_errors_and_no_scores(small_study: pd.DataFrame, usual) -> None:
    quiet = small_study.assign(sigma=0.0)
    tables = tabulate(quiet[quiet["seed"] == 0], usual)
    table = board(tables, usual)
    assert table.note == "Nobody has a score."
    assert [cells[1].text for _, cells in table.rows] == ["–"] * 3
    assert verdict(tables.scores, tables.comparisons, usual).startswith("No estimator has a score")


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
