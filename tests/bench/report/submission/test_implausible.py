"""Rows that noise cannot explain: found, and refused unless fresh trials confirm them."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.report.submission.implausible import (
    TRIALS,
    Implausible,
    confirmed,
    implausible_rows,
)
from olne_bench.bench.report.submission.rows import Rows

METRIC = declare(PositionError)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    suite = load_suite("quick")
    return [t for t in expand(suite) if t.estimator.label == "kkt_residual"]


def found(trials: list[Trial], errors: np.ndarray, status: str = "ok") -> Implausible | None:
    table = pd.DataFrame({"status": status, "position_error": errors})
    places = {trial.key: k for k, trial in enumerate(trials)}
    return implausible_rows(trials, Rows(table, None, places), METRIC)  # type: ignore[arg-type]


def test_honest_rows_are_plausible(trials: list[Trial]) -> None:
    rng = np.random.default_rng(0)
    sigma = np.array([trial.sigma for trial in trials])
    honest = (sigma + 1e-13) * 10 ** rng.uniform(-1, 1, len(trials))
    assert found(trials, honest) is None
    assert found(trials, np.zeros(len(trials))) is None  # as of a constant: judged elsewhere


@pytest.mark.parametrize("number", [1, 5, 30])
def test_rows_known_by_heart_are_found(trials: list[Trial], number: int) -> None:
    errors = np.ones(len(trials))
    noisy = [k for k, trial in enumerate(trials) if trial.sigma > 0]
    known = noisy[:: len(noisy) // number][:number]
    errors[known] = 1e-4
    about = found(trials, errors)
    assert about is not None
    assert {t.key for t in about.trials} == {trials[k].key for k in known}
    assert about.estimator == "kkt_residual"
    assert set(about.usual) == {1.0}
    fresh = about.fresh()
    assert len(fresh) == TRIALS
    assert {t.salt for t, _ in fresh}.isdisjoint({"quick"})
    assert len({t.key for t, _ in fresh}) == TRIALS
    assert found(trials, errors, status="crash") is None


def test_one_of_two_rows_is_found(trials: list[Trial]) -> None:
    two = [t for t in trials if t.seed < 2 and t.sigma == 0.1][:2]
    assert found(two, np.array([1e-6, 0.1])) is not None
    assert found(two[:1], np.array([1e-6])) is None  # nothing is beside it


def test_fresh_trials_that_are_as_good_confirm_rows(trials: list[Trial]) -> None:
    fresh = [(trial, 1.0) for trial in trials[:3]]
    usual = {t.key: Outcome("ok", scores={"position_error": 0.5}) for t, _ in fresh}
    assert not confirmed(fresh, usual, "position_error")
    good = Outcome("ok", scores={"position_error": 1e-5})
    assert confirmed(fresh, usual | {trials[1].key: good}, "position_error")
    failed = Outcome("timeout", scores={"position_error": 1e-5})
    nothing = Outcome("ok", scores={"position_error": None})
    for other in (failed, nothing):
        assert not confirmed(fresh, usual | {trials[1].key: other}, "position_error")
