"""What becomes of one trial."""

import pytest

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


SEVERAL = """
name = "tiny"
scenarios = ["two_player"]
views = ["full"]
sigmas = [0.0, 0.01]
seeds = 1
trajectories = 2
estimators = {estimators}
"""

SINGLE_PLUGIN = """
import numpy as np
from types import SimpleNamespace

class Single:
    def estimate(self, problem, observation, *, rng, budget):
        assert observation.y.ndim == 3
        return SimpleNamespace(weights=np.ones((2, 4)), covariance={covariance})
"""


def outcomes(tmp_path, estimators, **changes):
    path = tmp_path / "suite.toml"
    text = SEVERAL.format(estimators=estimators)
    path.write_text(
        text.replace("trajectories = 2", changes.get("trajectories", "trajectories = 2"))
    )
    return [evaluate(trial) for trial in expand(load_suite(str(path)))]


def plugin(tmp_path, covariance="None"):
    path = tmp_path / "single.py"
    path.write_text(SINGLE_PLUGIN.format(covariance=covariance))
    return f'["{path}"]'


def test_an_estimator_of_several_trajectories_is_given_all_of_them(tmp_path):
    noise_free, noisy = outcomes(tmp_path, '["kkt_constrained"]')
    assert noise_free.status == noisy.status == "ok"
    assert noise_free.cosine_error < 1e-9
    assert noise_free.covered is None  # an ellipsoid without extent
    assert noisy.covered in (0, 1)
    assert 0 <= noisy.held_out_error < 0.1
    assert noisy.objective < noisy.truth_objective


def test_a_plugin_of_one_trajectory_is_skipped_where_there_are_more(tmp_path):
    for outcome in outcomes(tmp_path, plugin(tmp_path)):
        assert outcome.status == "skipped"
        assert outcome.message == "takes one trajectory at a time, not 2"


def test_a_plugin_of_one_trajectory_is_given_one(tmp_path):
    for outcome in outcomes(tmp_path, plugin(tmp_path), trajectories=""):
        assert outcome.status == "ok"
        assert outcome.covered is None


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ("np.eye(7)", r"covariance has the shape (7, 7), expected (8, 8)"),
        ("np.full((8, 8), np.nan)", "covariance is not finite"),
        ("'narrow'", "covariance are not an array of numbers"),
    ],
)
def test_a_covariance_that_is_none_is_invalid(tmp_path, covariance, message):
    for outcome in outcomes(tmp_path, plugin(tmp_path, covariance), trajectories=""):
        assert outcome.status == "invalid"
        assert message in outcome.message
