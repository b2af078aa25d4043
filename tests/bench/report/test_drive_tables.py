"""Tables of drives, from made-up rows."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.drive_tables import COLUMNS, comparison_table, drive_table
from olne_bench.bench.report.figures.online import drive_figures

DRIVES = 10


def made_up() -> pd.DataFrame:
    rows = []
    rng = np.random.default_rng(0)
    for road in ("highway", "merge"):
        for seed in range(DRIVES):
            hard = rng.uniform(1, 9)  # what all planners pay in this drive
            for planner, more, hits in (
                ("oracle", 0.0, 0),
                ("map", 0.1 + 0.01 * seed, 1),
                ("uniform", 0.5 + 0.02 * seed, 3),
                ("constant_velocity", 1.0, 5),
            ):
                rows.append(
                    dict.fromkeys(COLUMNS, np.nan)
                    | {"road": road, "traffic": "nash", "weights": "dirichlet", "sigma": 0.1}
                    | {"seed": seed, "salt_id": "s", "planner": planner, "status": "ok"}
                    | {"collision": seed < hits, "cost": hard + more, "fallback": 0.5}
                    | {"fde_3s": np.nan if planner == "oracle" else hard * (1 + more)}
                )
    return pd.DataFrame(rows)


def line_of(table: pd.DataFrame, **labels: str) -> pd.Series:
    for name, value in labels.items():
        table = table[table[name] == value]
    (line,) = (line for _, line in table.iterrows())
    return line


def test_collisions_have_exact_intervals_and_regret_is_paired() -> None:
    table = drive_table(made_up())
    assert len(table) == 3 * 4
    own = line_of(table, road="highway", planner="map")
    assert (own["drives"], own["collisions"], own["collision"]) == (10, 1, 0.1)
    assert own["collision_low"] == pytest.approx(0.00253, abs=1e-5)
    assert own["collision_high"] == pytest.approx(0.44502, abs=1e-5)
    assert own["regret"] == pytest.approx(0.145)  # whatever the drive costs
    assert 0.1 < own["regret_low"] < 0.145 < own["regret_high"] < 0.2
    assert own["fallback"] == 0.5
    every = line_of(table, road="all", planner="map")
    assert (every["drives"], every["collisions"]) == (20, 2)
    assert line_of(table, road="all", planner="oracle")["regret"] == 0


def test_lines_are_in_the_order_of_roads_and_planners_whoever_ended_first() -> None:
    table = drive_table(made_up().sample(frac=1, random_state=0))
    pd.testing.assert_frame_equal(table, drive_table(made_up()))
    assert list(table["planner"][:4]) == ["oracle", "map", "uniform", "constant_velocity"]
    assert list(table["road"].unique()) == ["highway", "merge", "all"]


def test_paired_tests_are_adjusted() -> None:
    table = comparison_table(made_up())
    own = line_of(table, column="cost", road="all", planner="map", other="uniform")
    assert own["pairs"] == 20
    assert own["difference"] == pytest.approx(-0.4 - 0.045)
    assert own["p"] < 0.001
    assert own["p"] < own["p_holm"] < 0.05
    assert 200 * own["p"] < 0.05  # so a study of all roads and planners can tell something
    assert not (table["planner"] == table["other"]).any()


def test_collisions_have_an_exact_p_value() -> None:
    table = comparison_table(made_up())
    own = line_of(table, column="collision", road="all", planner="map", other="constant_velocity")
    assert own["difference"] == pytest.approx(-8 / 20)
    assert own["p"] == pytest.approx(2 * 0.5**8)  # of eight drives that differ, all one way


def test_predictions_are_compared_where_both_have_one() -> None:
    table = comparison_table(made_up())
    own = line_of(table, column="fde_3s", road="all", planner="map", other="constant_velocity")
    assert own["pairs"] == 20 and own["difference"] < -2 and own["p_holm"] < 0.05
    assert "oracle" not in set(table.loc[table["column"] == "fde_3s", "planner"])


def test_drives_that_are_missing_are_not_paired() -> None:
    rows = made_up()
    gone = (rows["planner"] == "map") & (rows["road"] == "highway") & (rows["seed"] < 7)
    rows.loc[gone, "status"] = "harness_error"
    table = drive_table(rows)
    own = line_of(table, road="highway", planner="map")
    assert own["drives"] == 3
    assert own["regret"] == pytest.approx(0.18)
    assert np.isnan(own["regret_low"])
    every = line_of(
        comparison_table(rows), column="cost", road="all", planner="map", other="uniform"
    )
    assert every["pairs"] == 13


def test_a_figure_has_a_panel_for_each_road() -> None:
    ((name, figure),) = drive_figures(drive_table(made_up()))
    assert name == "driving_nash"
    titles = [axes.get_title() for axes in figure.axes if axes.axison]
    assert titles == ["highway, 10 drives", "merge, 10 drives", "all roads, 20 drives"]
