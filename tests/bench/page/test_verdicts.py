import pandas as pd
import pytest

from bench.page.verdicts import verdicts

INF = float("inf")


def line(*rows: tuple[str, float, int]):
    names, errors, ranks = zip(*rows, strict=True)
    table = pd.DataFrame({"scenario": "s", "view": "full", "estimator": names})
    table = table.assign(position_error_median=errors, position_error_rank=ranks)
    (verdict,) = verdicts(table)
    (found,) = verdict.lines
    return found


@pytest.mark.parametrize(
    ("rows", "first", "remark"),
    [
        ([("a", 2.0, 2), ("b", 0.5, 1)], "b", "a: 2 m, 4 times as much"),
        ([("a", 0.6, 1), ("b", 0.5, 1)], "b", "a: 0.6 m, no significant difference"),
        ([("a", INF, 2), ("b", 0.5, 1)], "b", "a: half of its attempts fail"),
        ([("uniform", 0.0, 1), ("b", 0.5, 1)], "b", "uniform: 0 m"),
        ([("uniform", 0.0, 1), ("b", 0.5, 1), ("c", 0.9, 2)], "b", "c: 0.9 m, 1.8 times as much"),
        ([("a", INF, 1), ("b", INF, 1)], "", ""),
        ([("a", 0.1, 1)], "a", ""),
        ([("uniform", 0.1, 1)], "uniform", ""),
    ],
)
def test_the_first_is_a_contender_and_the_next_is_named(rows, first, remark):
    found = line(*rows)
    assert (found.first, found.remark) == (first, remark)
