"""A report that reads one scenario at a time says what one that holds all of them would."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.report.parts import Parts, joined, of_each, parts_of, write_trials
from olne_bench.bench.report.study import in_table
from olne_bench.bench.report.tables import tabulate
from tests.bench.report.conftest import trial_row

KEY = ["scenario", "sensor", "sigma", "seed", "estimator"]


def trials(number: int = 8) -> pd.DataFrame:
    rng, rows = np.random.default_rng(0), []
    for scenario, never in (("b", "position_error"), ("a", "held_out_error")):
        for estimator in ("one", "two", "uniform"):
            for seed in range(number):
                failed = estimator == "two" and seed % 3 == 0
                errors = {name: rng.uniform() for name in ("cosine_error", "position_error")}
                errors["held_out_error"] = rng.uniform()
                if scenario == "a":
                    errors[never] = np.nan
                row = trial_row(
                    scenario=scenario,
                    sigma=0.1,
                    seed=seed,
                    salt_id="",
                    estimator=estimator,
                    status="crash" if failed else "ok",
                    weights=None if failed else "[[0.25, 0.75], [0.5, 0.5]]",
                    unknowns=None,
                    weight_levels=None,
                )
                rows.append(row | (dict.fromkeys(errors, np.nan) if failed else errors))
    return pd.DataFrame(rows).sort_values(KEY, ignore_index=True)


def batches(table: pd.DataFrame, size: int) -> list[pa.RecordBatch]:
    texts = [(name, pa.string()) for name in ("weights", "unknowns", "weight_levels")]
    schema = pa.Schema.from_pandas(table.drop(columns=[name for name, _ in texts]))
    fields = {field.name: field.type for field in schema} | dict(texts)
    whole = pa.table({n: pa.array(table[n], fields[n], from_pandas=True) for n in table})
    return whole.to_batches(max_chunksize=size)


def parts(source: Parts) -> list[tuple[str, pd.DataFrame]]:
    return of_each(source, lambda name, own: (name, own))


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_a_file_and_a_frame_hold_the_same_parts(tmp_path, size: int) -> None:
    table = trials()
    kept, read = parts_of(table), write_trials(batches(table, size), tmp_path)
    assert read.outline.scenarios == ["a", "b"]
    pd.testing.assert_frame_equal(kept.outline.cells, read.outline.cells, check_dtype=False)
    assert (kept.outline.suite, kept.outline.some_ok) == (read.outline.suite, read.outline.some_ok)
    assert kept.outline.valued == read.outline.valued
    for (name, one), (_, other) in zip(parts(kept), parts(read), strict=True):
        same = ["sensor", "sigma", "seed", "estimator", "status", "cosine_error", "position_error"]
        left, right = (part[same].reset_index(drop=True) for part in (one, other))
        pd.testing.assert_frame_equal(left, right, check_dtype=False)
        assert set(other["scenario"]) == {name}
        assert not {"suite", "parameters", "salt_id", "extras"} & set(other)
    stored = pd.read_parquet(tmp_path / "trials.parquet")
    assert len(stored) == len(pd.read_csv(tmp_path / "trials.csv")) == len(table)
    assert {"parameters", "salt_id"} <= set(stored)


def test_the_tables_do_not_depend_on_where_the_trials_are(tmp_path) -> None:
    table = trials(12)
    read = write_trials(batches(table, 5), tmp_path)
    expected = tabulate(table.assign(weights=None)).by_name()
    for name, told in tabulate(read).by_name().items():
        if name not in ("identifiability", "bound_ratios"):
            pd.testing.assert_frame_equal(told, expected[name], check_dtype=False)


def test_an_outline_knows_the_metrics_of_the_whole_run() -> None:
    table = trials()
    own = [metric.name for metric in parts_of(table).outline.metrics(BUILT_IN)]
    assert own == [metric.name for metric in in_table(BUILT_IN, table)]
    assert "held_out_error" in own  # which one of the scenarios has only
    lost = table.assign(status="crash", cosine_error=np.nan, position_error=np.nan)
    lost = lost.assign(held_out_error=np.nan)
    own = [metric.name for metric in parts_of(lost).outline.metrics(BUILT_IN)]
    assert own == [metric.name for metric in in_table(BUILT_IN, lost)] != []


def test_a_metric_that_one_scenario_lacks_is_empty_there() -> None:
    table = trials(12)
    board = tabulate(table).leaderboard.set_index(["scenario", "estimator"])
    assert (
        board.loc[("a", "one"), "held_out_error_median"]
        != board.loc[("a", "one"), "held_out_error_median"]
    )
    assert board.loc[("b", "one"), "held_out_error_median"] > 0
    order = [name for name in board if name.endswith("_error_median")]
    assert (
        order[:3]
        == [f"{metric.name}_median" for metric in BUILT_IN if f"{metric.name}_median" in order][:3]
    )


def test_empty_tables_are_joined() -> None:
    empty, full = pd.DataFrame(columns=["a"]), pd.DataFrame({"a": [1, 2]})
    assert joined([empty, full])["a"].tolist() == [1, 2]
    assert list(joined([empty, empty])) == ["a"]


def test_a_scenario_without_results_adds_no_metrics() -> None:
    table = trials().assign(parameter_error=np.nan)
    lost = table["scenario"] == "b"
    numbers = ["cosine_error", "position_error", "held_out_error", "solve_seconds"]
    table.loc[lost, numbers] = np.nan
    table.loc[lost, ["status", "weights"]] = ["harness_error", None]
    for known in (table, table.assign(scenario="a")):
        tables = tabulate(known)
        assert not [name for name in tables.leaderboard if name.startswith("parameter_error")]
        assert "parameter_error" not in {*tables.comparisons["error"], *tables.scores["error"]}
        assert "position_error_score" in tables.leaderboard
