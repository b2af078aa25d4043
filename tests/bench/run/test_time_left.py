"""How long a run still takes."""

import math

import pytest

from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.time_left import Cost, TimeLeft, in_words, processes, time_left


def test_trials_cost_what_they_cost_so_far() -> None:
    costs = {("a", "slow"): Cost(4, 40.0), ("b", "slow"): Cost(1, 1.0), ("a", "fast"): Cost(2, 1.0)}
    pending = {("a", "slow"): 3, ("b", "slow"): 5, ("c", "slow"): 10, ("a", "fast"): 0}
    assert time_left(pending, costs) == [TimeLeft("slow", 18, 3 * 10 + 5 * 1 + 10 * 41 / 5)]
    (new,) = time_left({("a", "new"): 2}, costs)
    assert new.trials == 2 and math.isnan(new.seconds)
    assert time_left({}, costs) == []


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.4, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min"),
        (3569.0, "59 min"),
        (3590.0, "1 h 0 min"),
        (12000.0, "3 h 20 min"),
        (200000.0, "2 d 7 h"),
        (math.nan, "unknown"),
    ],
)
def test_durations_are_told_in_two_units_at_most(seconds, text) -> None:
    assert in_words(seconds) == text


def test_the_executor_says_how_many_processes_there_were() -> None:
    assert processes("3 local processes") == 3
    assert processes("dask tcp://host:8786") == 1


def test_status_tells_the_time_left_by_estimator(study) -> None:
    study.run("a", "Slow", options=("--sigma", "0.01"))
    with read_store(study.folder / "a") as store:
        costs = store.costs()
    assert {key: cost.trials for key, cost in costs.items()} == {
        ("two_player", "uniform"): 4,
        ("two_player", "Slow"): 4,
    }
    # Each of its estimates sleeps for 0.4 s.
    each = costs["two_player", "Slow"].seconds / 4
    assert each > 0.4
    said = study.call("status", study.folder / "a")
    assert f"  Slow     {in_words(4 * each):>12} for 4 trials\n" in said
    assert "time left in one process:\n  uniform" in said and "\nin all " in said
