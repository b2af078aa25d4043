from itertools import combinations

import pandas as pd
import pytest

from olne_bench.bench.report.page.verdicts import verdicts

INF = float("inf")


def line(
    rows: list[tuple[str, float]], told: list[tuple[str, str]] = (), error: str = "position_error"
):
    """``told``: winner and loser of the significant comparisons."""
    names, errors = zip(*rows, strict=True)
    table = pd.DataFrame({"scenario": "s", "sensor": "full", "estimator": names})
    table = table.assign(position_error_median=errors)
    comparisons = pd.DataFrame(
        [
            {"error": error, "scenario": "s", "sensor": "full", "estimator": a, "other": b}
            | {"p_holm": 0.01 if {(a, b), (b, a)} & set(told) else 0.2}
            | {"wins": 0.9 if (b, a) not in told else 0.1}
            for a, b in combinations(sorted(names), 2)
        ],
        columns=["error", "scenario", "sensor", "estimator", "other", "p_holm", "wins"],
    )
    (verdict,) = verdicts(table, comparisons)
    (found,) = verdict.lines
    return found


@pytest.mark.parametrize(
    ("rows", "told", "first", "remark"),
    [
        ([("a", 2.0), ("b", 0.5)], [("b", "a")], "b", "a: 2 m, 4 times as much"),
        ([("a", 0.5), ("b", 2.0)], [("a", "b")], "a", "b: 2 m, 4 times as much"),
        ([("a", 0.6), ("b", 0.5)], [], "b", "a: 0.6 m, no significant difference"),
        ([("a", 0.6), ("b", 0.5)], [("a", "b")], "b", "a: 0.6 m, but better in most trials"),
        ([("a", INF), ("b", 0.5)], [("b", "a")], "b", "a: half of its attempts fail"),
        ([("uniform", 0.0), ("b", 0.5)], [], "b", "uniform: 0 m"),
        (
            [("uniform", 0.0), ("b", 0.5), ("c", 0.9)],
            [("b", "c")],
            "b",
            "c: 0.9 m, 1.8 times as much",
        ),
        ([("a", INF), ("b", INF)], [], "", ""),
        ([("a", 0.1)], [], "a", ""),
        ([("uniform", 0.1)], [], "uniform", ""),
    ],
)
def test_the_first_is_a_contender_and_the_next_is_named(rows, told, first, remark):
    found = line(rows, told)
    assert (found.first, found.remark) == (first, remark)


def test_only_the_pair_itself_says_how_it_compares():
    """That a third one beats the next says nothing of the first against it."""
    rows = [("a", 0.5), ("b", 0.6), ("c", 0.7)]
    assert line(rows, [("c", "b")]).remark == "b: 0.6 m, no significant difference"
    other = line(rows[:2], [("a", "b")], error="cosine_error")
    assert other.remark == "b: 0.6 m, no significant difference"
