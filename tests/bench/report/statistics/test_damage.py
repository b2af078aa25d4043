"""What a wrong model costs: ratios to the true world, and its figure."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.figures import damage, style
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.statistics.damage import damage_table
from olne_bench.bench.report.study import Study
from tests.bench.report.conftest import trial_row

#: Errors, and p values of the fit test, of four trials in each world.
WORLDS: dict[str, tuple[dict[str, Any], list[float], list[float]]] = {
    "true": ({"change": "alone", "dial": 0.0}, [1.0, 2.0, 3.0], [0.5, 0.001, 0.9]),
    "little": ({"change": "alone", "dial": 0.5}, [2.0, 4.0, 6.0], [0.5, 0.001, 0.9]),
    "much": ({"change": "alone", "dial": 1.0}, [8.0, 8.0, 8.0], [0.5, 0.5, 0.5]),
    "noise": ({"change": "outliers", "dial": 0.1}, [2.0, 2.0, 9.0], [0.001, 0.001, 0.001]),
}


@pytest.fixture
def study() -> Study:
    return Study(
        scenarios={
            label: ScenarioEntry(name="changed", label=label, options={"of": "merge", **options})
            for label, (options, _, _) in WORLDS.items()
        }
    )


@pytest.fixture
def board(study: Study) -> pd.DataFrame:
    rows = [
        trial_row(
            scenario=label,
            seed=k,
            estimator="map",
            position_error=error,
            fit_p=p,
            covers_truth=float(k > 0),
        )
        for label, (_, errors, levels) in WORLDS.items()
        for k, (error, p) in enumerate(zip(errors, levels, strict=True))
    ]
    return leaderboard(pd.DataFrame(rows), study=study)


def test_errors_are_over_those_of_the_true_world(board: pd.DataFrame, study: Study) -> None:
    found = damage_table(board, study).set_index(["change", "dial"])
    assert list(found.index) == [("alone", 0.5), ("alone", 1.0), ("outliers", 0.1)]
    np.testing.assert_allclose(found["position_error_ratio"], [2.0, 4.0, 1.0])
    np.testing.assert_allclose(found["noticed"], [1 / 3, 0, 1])
    np.testing.assert_allclose(found["false_alarms"], 1 / 3)
    np.testing.assert_allclose(found["covers_truth_share"], 2 / 3)
    assert found["kind"].tolist() == ["behaviours", "behaviours", "wrong noise"]
    assert set(found["of"]) == {"merge"}


def test_the_scenario_itself_is_the_true_world_as_well(board: pd.DataFrame, study: Study) -> None:
    plain = ScenarioEntry(name="merge", label="true")
    own = Study(scenarios={**study.scenarios, "true": plain})
    pd.testing.assert_frame_equal(damage_table(board, own), damage_table(board, study))


def test_without_a_true_world_there_is_no_row(board: pd.DataFrame, study: Study) -> None:
    only = board[board["scenario"] != "true"]
    assert damage_table(only, study).empty
    elsewhere = {"true": ScenarioEntry(name="highway", label="true")}
    assert damage_table(board, Study(scenarios={**study.scenarios, **elsewhere})).empty
    assert damage_table(board, Study()).empty


def test_the_figure_has_a_line_for_each_change(board: pd.DataFrame, study: Study) -> None:
    table = damage_table(board, study)
    with style.applied():
        (axes,) = damage.draw(table).axes
    assert {text.get_text() for text in axes.texts} == {"alone", "outliers"}
    line = next(one for one in axes.get_lines() if len(one.get_xdata()) == 2 and one.get_alpha())
    np.testing.assert_allclose(line.get_xydata(), [[1 / 3, 2.0], [0.0, 4.0]])
    with pytest.raises(NotDrawnError, match="no estimator tests its fit"):
        damage.draw(table.assign(noticed=np.nan))
