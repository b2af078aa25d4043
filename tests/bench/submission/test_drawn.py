"""Estimators of fixed truths on drawn ones: whoever knows the constants is found."""

import numpy as np
import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.plan.truths import has_drawn_truths
from olne_bench.bench.submission.drawn import (
    MOST_SHIFT,
    PAIRS,
    DrawnErrors,
    Plan,
    drawn_errors,
    drawn_plans,
    fixed_scenarios,
)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> list[Trial]:
    """Trials of ``paper`` with two plugins."""
    folder = tmp_path_factory.mktemp("plugins")
    text = "class {}:\n    name = '{}'\n    def estimate(self, *a, **k): ...\n"
    for name in ("one", "two"):
        (folder / f"{name}.py").write_text(text.format(name.title(), name))
    plugins = tuple(str(folder / f"{name}.py") for name in ("one", "two"))
    return list(expand(load_suite("paper", plugins), 5))


def plans(trials: list[Trial], seed: int = 0) -> list[Plan]:
    return drawn_plans(trials, np.random.default_rng(seed))


def test_each_plugin_is_run_on_drawn_truths_of_each_fixed_scenario(trials: list[Trial]) -> None:
    found = plans(trials)
    assert [(p.estimator, p.scenario) for p in found] == [
        (name, scenario)
        for scenario in ("two_player", "highway_overtaking")
        for name in ("one", "two")
    ]
    assert len({p.drawn[0].own.salt for p in found}) == len(found)
    known = {trial.key for trial in trials}
    for plan in found:
        assert len(plan.fixed) == len(plan.drawn) == PAIRS
        assert len(plan.trials) == 3 * PAIRS
        for pair in plan.drawn:
            assert has_drawn_truths(pair.own.scenario)
            assert pair.own.salt not in {"paper"}
            assert pair.own.sigma > 0
        for pair in plan.fixed:
            assert pair.own.key in known  # its row is there
        for pair in (*plan.fixed, *plan.drawn):
            assert pair.reference.estimator.name == "kkt_constrained"
            same = ("scenario", "sensor", "sigma", "seed", "salt")
            assert all(getattr(pair.own, n) == getattr(pair.reference, n) for n in same)
            assert pair.reference.code_difference() is None


def test_truths_that_are_drawn_need_no_others(trials: list[Trial]) -> None:
    drawn = list(expand(load_suite("calibration"), 1))
    assert fixed_scenarios(drawn) == []
    assert plans(drawn) == []
    assert [entry.label for entry in fixed_scenarios([*drawn, *trials])] == [
        "two_player",
        "highway_overtaking",
    ]
    built_in = [t for t in trials if not t.plugin]
    assert plans(built_in) == []
    silent = [t for t in trials if t.sigma == 0]
    assert plans(silent) == []


def judged(plan: Plan, own: float, reference: float, fixed: float) -> DrawnErrors:
    outcomes = {
        pair.own.key: Outcome("ok", scores={"position_error": own}) for pair in plan.drawn
    } | {
        pair.reference.key: Outcome("ok", scores={"position_error": reference})
        for pair in (*plan.fixed, *plan.drawn)
    }
    submitted = {pair.own.key: fixed for pair in plan.fixed}
    return drawn_errors(plan, outcomes, submitted, "position_error")


def test_whoever_is_only_good_on_fixed_truths_knows_them(trials: list[Trial]) -> None:
    plan = plans(trials)[0]
    constants = judged(plan, own=0.2, reference=0.01, fixed=1e-13)
    assert not constants.accepted
    assert constants.trials == PAIRS
    assert (constants.error, constants.reference) == (0.2, 0.01)
    assert constants.drawn == pytest.approx(20)
    # It looks for the constants, and else is as good as the reference.
    assert not judged(plan, own=0.01, reference=0.01, fixed=1e-13).accepted
    for honest in (0.2, 0.01, 0.002):
        assert judged(plan, own=0.2, reference=0.01, fixed=honest).accepted
    failing = judged(plan, own=float("inf"), reference=0.01, fixed=0.01)
    assert not failing.accepted


@pytest.mark.parametrize(("shift", "accepted"), [(0.99, True), (1.01, False)])
def test_the_limit_is_that_which_is_stated(shift: float, accepted: bool) -> None:
    found = DrawnErrors("e", "s", 3, 1.0, MOST_SHIFT * shift, 1.0, 1.0)
    assert found.accepted == accepted


def test_draws_without_an_equilibrium_say_nothing(trials: list[Trial]) -> None:
    plan = plans(trials)[0]
    outcomes = {trial.key: Outcome("skipped") for trial in plan.trials}
    submitted = {pair.own.key: 1.0 for pair in plan.fixed}
    found = drawn_errors(plan, outcomes, submitted, "position_error")
    assert found.trials == 0
    assert np.isnan(found.drawn)
    assert found.accepted
