"""Tables of encounters, from made-up rows in which who knows less loses the value."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.report.drive_tables import COLUMNS
from olne_bench.bench.report.encounter_tables import by_quarter, contrast_table, quarter_table
from olne_bench.bench.report.figures.online import quarter_figures

DRAWS = 16
CONTRASTS = (("map", "uniform"), ("map", "oracle"))


def made_up() -> pd.DataFrame:
    rows = []
    for road in ("highway", "merge"):
        for seed in range(DRAWS):
            value = 0.01 * ((5 * seed) % DRAWS)
            for planner, share in (("oracle", 0.0), ("map", 0.25), ("uniform", 1.0)):
                rows.append(
                    dict.fromkeys(COLUMNS, np.nan)
                    | {"road": road, "traffic": "nash", "weights": "temperaments", "sigma": 0.1}
                    | {"scene": "encounter", "ego": "average", "seed": seed, "salt_id": "s"}
                    | {"planner": planner, "status": "ok", "value": value}
                    | {"collision": planner == "uniform" and value > 0.13}
                    | {"cost": 0.1 + share * value}
                )
    return pd.DataFrame(rows)


def test_each_road_has_as_many_draws_in_each_quarter() -> None:
    rows = by_quarter(made_up())
    counts = rows[rows["planner"] == "map"].groupby(["road", "quarter"]).size()
    assert (counts == DRAWS // 4).all()
    least = rows.groupby("quarter")["value"].min()
    assert list(least) == pytest.approx([0.0, 0.04, 0.08, 0.12])


def test_regret_and_collisions_are_told_by_quarter() -> None:
    table = quarter_table(made_up()).set_index(["quarter", "planner"])
    assert table.loc[("4", "uniform"), "regret"] == pytest.approx(0.135)
    assert table.loc[("4", "map"), "regret"] == pytest.approx(0.135 / 4)
    assert table.loc[("1", "uniform"), "regret"] == pytest.approx(0.015)
    assert table.loc[("all", "map"), "drives"] == 2 * DRAWS
    assert table.loc[("4", "uniform"), "collisions"] == 4
    assert (table["regret_low"].dropna() <= table["regret"][table["regret_low"].notna()]).all()


def test_contrasts_are_tested_and_nothing_else() -> None:
    table = contrast_table(made_up(), CONTRASTS)
    assert set(zip(table["planner"], table["other"], strict=True)) == set(CONTRASTS)
    whole = table[(table["quarter"] == "all") & (table["column"] == "cost")]
    own = whole[whole["other"] == "uniform"].iloc[0]
    assert own["pairs"] == 2 * DRAWS
    assert own["difference"] == pytest.approx(-0.75 * 0.075)
    assert own["p"] < 1e-5
    assert own["p"] <= own["p_holm"] <= 1
    assert contrast_table(made_up(), [("map", "nobody")]).empty


def test_drives_without_a_value_have_no_quarters() -> None:
    rows = made_up().assign(value=np.nan)
    assert quarter_table(rows).empty
    table, valued = (contrast_table(one, CONTRASTS) for one in (rows, made_up()))
    assert set(table["quarter"]) == {"all"}
    columns = ["column", "planner", "other", "pairs", "difference", "p"]
    pd.testing.assert_frame_equal(table[columns], valued[valued["quarter"] == "all"][columns])


def test_the_figure_shows_each_planner_in_each_quarter() -> None:
    ((name, figure),) = quarter_figures(quarter_table(made_up()))
    assert name == "regret_by_value"
    (axes,) = figure.axes
    assert [text.get_text().split("\n")[0] for text in axes.get_xticklabels()] == [
        f"quarter {k}" for k in range(1, 5)
    ]
    assert len(axes.containers) == 2


def test_the_figure_tells_who_drove_fewer_draws() -> None:
    rows = made_up()
    ((_, figure),) = quarter_figures(
        quarter_table(rows[(rows["planner"] != "map") | (rows["seed"] < DRAWS // 2)])
    )
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert names == {f"map, {DRAWS} drives", "uniform"}
    told = [text.get_text().split("\n")[1:] for text in figure.axes[0].get_xticklabels()]
    assert told == [[f"value {value:.2g} %", "8 draws"] for value in (1.5, 5.5, 9.5, 13.5)]
