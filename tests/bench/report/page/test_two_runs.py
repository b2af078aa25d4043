"""One page for two runs: estimators of the second are shown beside those of the first."""

import numpy as np
import pandas as pd

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
    points = {(s["estimator"], s["sensor"]): s["points"] for s in data["scenarios"][0]["series"]}
    first = points["kkt_constrained", "full"]
    second = points["kkt_constrained (second)", "full"]
    assert len(first["x"]) == len(second["x"]) == 2 * 4
    np.testing.assert_allclose(
        np.array(second["position_error"]) * 2, first["position_error"], rtol=2e-3
    )
    assert "<h1>runs/a and runs/b</h1>" in html
    assert html.count('<span class="yes">better</span>') == (changes["verdict"] == "better").sum()
    assert "only the trials that both runs/a and runs/b have" in html


def test_a_name_changes_only_where_it_stands_twice() -> None:
    names = {"a": "a", "b": "faster"}
    assert after_name("a", names) == "a (second)"
    assert after_name("faster", names) == "faster"
    assert after_name("uniform", {"uniform": "uniform"}) == "uniform"
