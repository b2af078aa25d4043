"""One page for two runs: estimators of the second are shown beside those of the first."""

from io import StringIO

import pandas as pd
import pytest

from olne_bench.bench.report.page.two_runs import after_name, two_runs_page
from olne_bench.bench.report.statistics.run_comparison import compare_runs
from olne_bench.bench.report.study import Study


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
