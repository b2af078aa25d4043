"""What becomes of one trial."""

from bench.evaluate import evaluate
from bench.suite import load_suite, select
from bench.trial import expand
from bench.truth import true_recording


def test_draws_without_an_equilibrium_are_rows_of_their_own(monkeypatch):
    monkeypatch.setattr("envs.driving.MAX_DRAWS", 0)
    part = select(load_suite("highway"), scenarios=("merge",), estimators=("uniform",), sigmas=(2,))
    trials = list(expand(part, seeds=1))
    assert [trial.view for trial in trials] == ["full", "partial"]
    for trial in trials:
        outcome = evaluate(trial)
        assert outcome.status == "skipped"
        assert outcome.message.startswith("no playable draw of 'merge'")


def test_a_draw_of_the_highway_suite_is_scored():
    part = select(load_suite("highway"), scenarios=("two_way",), views=("full",), sigmas=(0.1,))
    trials = {trial.estimator.label: trial for trial in expand(part, seeds=1)}
    joint, floor = (evaluate(trials[name]) for name in ("kkt_constrained", "uniform"))
    assert true_recording(trials["uniform"].scenario, 0).certificate.passed
    assert joint.status == floor.status == "ok"
    assert joint.objective is not None and joint.truth_objective is not None
    assert joint.objective <= joint.truth_objective * (1 + 1e-6)
    assert joint.position_error is not None and floor.position_error is not None
    assert joint.position_error < 0.3 * floor.position_error
