from itertools import combinations

import pandas as pd
import pytest

from olne_bench.bench.report.page.verdicts import verdicts
from olne_bench.bench.report.statistics.estimator_comparison import ranks

INF = float("inf")


def line(
    rows: list[tuple[str, float]],
    told: list[tuple[str, str]] = (),
    error: str = "position_error",
    trials: dict[str, int] | None = None,
    units: int = 30,
):
    """``told``: winner and loser of significant comparisons; ``trials``: numbers other than 30."""
    names, errors = zip(*rows, strict=True)
    table = pd.DataFrame({"scenario": "s", "sensor": "full", "estimator": names})
    table = table.assign(position_error_median=errors)
    table["trials"] = [(trials or {}).get(name, 30) for name in names]
    comparisons = pd.DataFrame(
        [
            {"error": error, "scenario": "s", "sensor": "full", "estimator": a, "other": b}
            | {"p_holm": 0.01 if {(a, b), (b, a)} & set(told) else 0.2}
            | {"wins": 0.9 if (b, a) not in told else 0.1, "units": units}
            for a, b in combinations(sorted(names), 2)
        ],
        columns=["error", "scenario", "sensor", "estimator", "other", "p_holm", "wins", "units"],
    )
    table["position_error_rank"] = ranks(comparisons, table, "position_error")
    (verdict,) = verdicts(table, comparisons)
    (found,) = verdict.lines
    return found


@pytest.mark.parametrize(
    ("rows", "told", "first", "remark"),
    [
        ([("a", 2.0), ("b", 0.5)], [("b", "a")], "b", "a: 2 m, 4 times as much"),
        ([("a", 0.5), ("b", 2.0)], [("a", "b")], "a", "b: 2 m, 4 times as much"),
        ([("a", 1.0), ("b", 1.02)], [("a", "b")], "a", "b: 1 m, 1.02 times as much"),
        ([("a", 0.6), ("b", 0.5)], [], "b", "a: 0.6 m, no significant difference"),
        ([("a", 0.6), ("b", 0.5)], [("a", "b")], "a", "b: 0.5 m, but worse in most trials"),
        ([("a", INF), ("b", 0.5)], [("b", "a")], "b", "a: half of its attempts fail"),
        ([("uniform", 0.0), ("b", 0.5)], [], "b", "uniform: 0 m"),
        (
            [("uniform", 0.0), ("b", 0.5), ("c", 0.9)],
            [("b", "c")],
            "b",
            "c: 0.9 m, 1.8 times as much",
        ),
        ([("a", 1.0), ("b", 1.0)], [("a", "b")], "a", "b: 1 m, 1.00 times as much"),
        ([("a", 0.0), ("b", 1.0)], [("a", "b")], "a", "b: 1 m"),
        ([("uniform", 0.5), ("b", 0.5)], [], "b", "uniform: 0.5 m, no significant difference"),
        ([("a", INF), ("b", INF)], [], "", ""),
        ([("uniform", 0.1)], [], "uniform", ""),
    ],
)
def test_the_first_is_a_contender_and_the_next_is_named(rows, told, first, remark):
    found = line(rows, told)
    assert (found.first, found.remark) == (first, remark)


def test_only_the_pair_itself_says_how_it_compares():
    """A third estimator that beats the next one says nothing about the first one."""
    rows = [("a", 0.5), ("b", 0.6), ("c", 0.7)]
    assert line(rows, [("c", "b")]).remark == "c: 0.7 m, no significant difference"
    assert line(rows, [("b", "c")]).remark == "b: 0.6 m, no significant difference"
    other = line(rows[:2], [("a", "b")], error="cosine_error")
    assert (other.ranked, other.remark) == (False, "b: 0.6 m")


def test_nobody_is_first_without_a_rank():
    assert not line([("a", 0.1)]).ranked
    few = line([("a", 0.5), ("b", 0.6)], units=2)
    assert (few.ranked, few.first, few.remark) == (False, "a", "b: 0.6 m")


def test_who_was_run_on_a_part_of_the_trials_is_not_first():
    rows = [("a", 0.5), ("part", 0.1), ("b", 0.9)]
    found = line(rows, [("a", "b"), ("part", "a"), ("part", "b")], trials={"part": 6})
    assert (found.ranked, found.first) == (True, "a")
    assert found.remark == "b: 0.9 m, 1.8 times as much"
    other = line(rows[:2], [("part", "a")], trials={"part": 6})
    assert other.remark == "part: 0.1 m, on a small part of the trials"
