"""The verdict: one sentence, and it is right."""

import numpy as np
import pytest

from olne_bench.bench.report.page.verdict import verdict
from olne_bench.bench.report.statistics.score import log_errors, pair_table, score_table
from tests.bench.report.statistics.test_score import FACTORS, STUDY, trials


def said(factors: dict[str, float], spread: float = 0.05, seeds: int = 10) -> str:
    told = trials(factors)
    told = told[told["seed"] < seeds]
    noise = np.random.default_rng(0).normal(size=len(told))
    told["position_error"] *= np.exp(spread * noise)
    logs = log_errors(told, STUDY)
    return verdict(score_table(logs, STUDY), pair_table(logs, STUDY), STUDY)


def test_the_best_by_how_much_and_its_interval() -> None:
    text = said(FACTORS)
    start = "On 40 trials with noise of 2 scenarios, map has the smallest position errors: "
    assert text.startswith(start)
    assert "% smaller than those of kkt_constrained (95 % interval" in text
    assert text.endswith(" %).")


@pytest.mark.parametrize(
    ("factors", "expected"),
    [
        (
            {"map": 2.0, "bilevel": 1.5},
            "kkt_constrained has the smallest position errors; those of",
        ),
        ({"map": 1.0, "bilevel": 1.0}, "cannot be told apart from it."),
        ({"uniform": 0.1}, "; uniform, which ignores the data, has smaller ones."),
    ],
)
def test_ties_worse_ones_and_guesses_are_told(factors, expected) -> None:
    assert expected in said(FACTORS | factors)


def test_few_draws_tell_nothing_and_one_estimator_is_alone() -> None:
    assert "are too few to tell estimators apart" in said(FACTORS, seeds=1)
    alone = said({"map": 1.0, "uniform": 3.0})
    assert alone == "map is the only estimator that ranks, on 40 trials with noise of 2 scenarios."
