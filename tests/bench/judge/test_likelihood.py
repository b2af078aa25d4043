"""The likelihood ratio of an estimate against the truth."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.bench.judge import likelihood
from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.likelihood import likelihood_ratio
from olne_bench.bench.judge.raw_estimate import read_estimate
from olne_bench.bench.judge.trials import Case, case_of, predict_from_start
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import expand
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate
from olne_bench.games.solve.newton import Root


def judged(seed: int) -> tuple[Case, Estimate, Root]:
    """A draw of two players at 0.03 m, its estimate, and the game from the true start."""
    trial = next(
        one
        for one in expand(load_suite("calibration"))
        if one.labels["scenario"] == "two_player, wide"
        and (one.sensor.label, one.sigma, one.seed) == ("full", 0.03, seed)
    )
    case = case_of(trial)
    rng = np.random.default_rng(0)
    found = KktConstrained().estimate(case.problem, case.observations[0], rng=rng, budget=60.0)
    estimate = check_estimate(read_estimate(found), case.problem)
    root = predict_from_start(case.draw, estimate.theta(case.problem.game), 100).root
    assert root is not None
    return case, estimate, root


def ratio(case: Case, estimate: Estimate, root: Root) -> float | None:
    return likelihood_ratio(case.problem, case.observations, case.recordings, estimate, root)


def test_a_game_far_from_what_was_seen_does_not_hide_the_optimum() -> None:
    case, estimate, far = judged(16)  # its weights have an equilibrium elsewhere, too
    seen = case.observations[0].y
    assert np.abs(far.states[:, :, :2] - seen[:, :, :2]).max() > 10 * case.problem.sigma
    found = ratio(case, estimate, far)
    assert found is not None
    assert 0 < found < 30


def test_whoever_claims_more_than_can_be_found_gets_a_smaller_region() -> None:
    case, estimate, root = judged(0)
    least = estimate.extras["objective"]
    honest = ratio(case, estimate, root)
    greedy = ratio(case, replace(estimate, extras={"objective": 0.5 * least}), root)
    modest = ratio(case, replace(estimate, extras={"objective": 10 * least}), root)
    assert honest is not None
    assert greedy is not None
    assert greedy > honest + 10
    assert modest == pytest.approx(honest, abs=1e-3)


def test_nothing_is_said_where_no_fit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    case, estimate, root = judged(0)
    monkeypatch.setattr(likelihood, "least_error", lambda *_args, **_more: None)
    assert ratio(case, estimate, root) is None
