"""Judging of one trial."""

import json
from dataclasses import replace

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.scene import unpack_motion, unpack_truth
from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.kinds import Rules
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.store import open_store
from olne_bench.games.model.weight_prior import WeightPrior


def test_draws_without_an_equilibrium_are_rows_of_their_own(monkeypatch, judged):
    monkeypatch.setattr("olne_bench.envs.roads.road_scenario.MAX_DRAWS", 0)
    merge = Selection(
        scenarios=("merge",), estimators=("uniform",), sigmas=(1,), sensors=("full", "partial")
    )
    trials = list(expand(select(load_suite("roads"), merge), seeds=1))
    assert [trial.sensor.label for trial in trials] == ["full", "partial"]
    for trial in trials:
        outcome = judged(trial)
        assert outcome.status == "skipped"
        assert outcome.message.startswith("no playable draw of 'merge'")


def test_a_draw_of_the_roads_suite_is_scored_and_its_truth_is_sent_once(judged, monkeypatch):
    monkeypatch.setattr("olne_bench.bench.judge.trials._sent", set())
    two_way = Selection(scenarios=("two_way",), sensors=("full",), sigmas=(0.05,))
    part = select(load_suite("roads"), two_way)
    trials = {trial.estimator.label: trial for trial in expand(part, seeds=1)}
    joint, floor = (judged(trials[name]) for name in ("kkt_constrained", "uniform"))
    trial = trials["uniform"]
    draw = Draw.of(trial.scenario, trial.seed, trial.salt)
    assert true_recording(draw).certificate.passed
    assert joint.status == floor.status == "ok"
    assert joint.objective is not None and joint.truth_objective is not None
    assert joint.objective <= joint.truth_objective * (1 + 1e-6)
    assert joint.scores["position_error"] < 0.3 * floor.scores["position_error"]
    assert floor.scene is None
    truth = unpack_truth(joint.scene)
    np.testing.assert_array_equal(truth.states, true_recording(draw).states)
    assert truth.road == "two_way" and len(truth.temperaments) == len(truth.weights)
    for outcome in (joint, floor):
        error = position_error(truth.states, unpack_motion(outcome.motion, truth.states.shape))
        assert error == pytest.approx(outcome.scores["position_error"], abs=1e-5)


def test_estimated_parameters_are_kept_and_covered(judged, tmp_path, monkeypatch):
    monkeypatch.setattr("olne_bench.bench.judge.trials._sent", set())
    goals = Selection(scenarios=("unknown_goals",), sensors=("full",), sigmas=(0.01,))
    part = select(load_suite("parameters"), goals)
    (trial,) = (
        trial for trial in expand(part, seeds=1) if trial.estimator.label == "kkt_constrained"
    )
    outcome = judged(trial)
    assert np.shape(outcome.unknowns) == (2, 2)
    assert outcome.scores["covers_parameters"] in (0, 0.25, 0.5, 0.75, 1)
    assert outcome.scores["parameter_error"] < 0.2
    truth = unpack_truth(outcome.scene)
    assert [[one.name for one in own] for own in truth.unknowns] == [["goal x", "goal y"]] * 2
    errors = (np.array(outcome.unknowns) - truth.parameters) / truth.deviations
    assert np.sqrt((errors**2).mean()) < 1 and truth.used.all()
    assert truth.identified_at(0.01).parameters_identified.all()
    with open_store(tmp_path) as store:
        store.add(trial, outcome)
        (row,) = store.table().to_pylist()
    assert json.loads(row["unknowns"]) == outcome.unknowns
    assert row["parameters"] == "{}"  # those of the estimator


def test_a_prior_that_excludes_a_draw_is_invalid_before_anything_is_estimated(judged, tmp_path):
    path = tmp_path / "narrow.toml"
    narrow = ', parameters = {alpha = 1000}, label = "narrow"}'
    path.write_text(
        'name = "narrow"\nsensors = ["full"]\nsigmas = [0.01]\nseeds = 1\n'
        'scenarios = [{name = "two_player", options = {weights = "dirichlet"}}]\n'
        'estimators = ["map", {name = "map"' + narrow + "]\n"
    )
    wide, narrow = (judged(trial) for trial in expand(load_suite(str(path))))
    assert wide.status == "ok"
    assert narrow.status == "invalid"
    assert narrow.message.startswith(
        "its prior WeightPrior((1000.0,)) gives the truth no mass: weight '"
    )
    assert narrow.weights is None and narrow.solve_seconds is None
    assert narrow.truth_objective == wide.truth_objective


SEVERAL = """
name = "tiny"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.0, 0.01]
seeds = 1
trajectories = 2
estimators = {estimators}
"""

SINGLE_PLUGIN = """
import numpy as np
from types import SimpleNamespace

class Single:
    name = "Single"
    def estimate(self, problem, observation, *, rng, budget):
        assert observation.y.ndim == 3
        return SimpleNamespace(weights=np.ones((2, 4)), covariance={covariance})
"""


@pytest.fixture
def outcomes(tmp_path, judged):
    def found(estimators, **changes):
        path = tmp_path / "suite.toml"
        text = SEVERAL.format(estimators=estimators)
        path.write_text(
            text.replace("trajectories = 2", changes.get("trajectories", "trajectories = 2"))
        )
        return [judged(trial) for trial in expand(load_suite(str(path)))]

    return found


def plugin(tmp_path, covariance="None"):
    path = tmp_path / "single.py"
    path.write_text(SINGLE_PLUGIN.format(covariance=covariance))
    return f'["{path}"]'


def test_an_estimator_of_several_trajectories_is_given_all_of_them(outcomes):
    noise_free, noisy = outcomes('["kkt_constrained"]')
    assert noise_free.status == noisy.status == "ok"
    assert noise_free.scores["cosine_error"] < 1e-9
    assert noise_free.scores.get("covers_truth") is None  # an ellipsoid without extent
    assert noisy.scores.get("covers_truth") in (0, 1)
    assert 0 <= noisy.scores["held_out_error"] < 0.1
    assert noisy.objective < noisy.truth_objective


def test_a_plugin_of_one_trajectory_is_skipped_where_there_are_more(tmp_path, outcomes):
    for outcome in outcomes(plugin(tmp_path)):
        assert outcome.status == "skipped"
        assert outcome.message == "takes one trajectory at a time, not 2"


def test_samples_foretell_held_out_positions(outcomes):
    noise_free, noisy, joint_free, joint = outcomes(
        '["posterior", "kkt_constrained"]', trajectories=""
    )
    assert noise_free.scores.get("held_out_log_score") is None
    assert joint_free.scores.get("held_out_log_score") is None
    assert -0.1 < noisy.scores["held_out_log_score"] < joint.scores["held_out_log_score"] + 0.05


def test_a_plugin_of_one_trajectory_is_given_one(tmp_path, outcomes):
    for outcome in outcomes(plugin(tmp_path), trajectories=""):
        assert outcome.status == "ok"
        assert outcome.scores.get("covers_truth") is None


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ("np.eye(7)", r"covariance has the shape (7, 7), expected (8, 8)"),
        ("np.full((8, 8), np.nan)", "covariance is not finite"),
        ("'narrow'", "covariance is not an array of numbers"),
    ],
)
def test_a_covariance_that_is_none_is_invalid(tmp_path, outcomes, covariance, message):
    for outcome in outcomes(plugin(tmp_path, covariance), trajectories=""):
        assert outcome.status == "invalid"
        assert message in outcome.message


HARMFUL = """
import numpy as np
from types import SimpleNamespace

class Changes:
    name = "Changes"
    def estimate(self, problem, observation, *, rng, budget):
        object.__setattr__(problem.game, "dt", 5.0)
        return SimpleNamespace(weights=np.ones((2, 4)))

class ChangesAFeature:
    name = "ChangesAFeature"
    def supports(self, problem):
        object.__setattr__(problem.game.players[1], "preferences", ())
    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=np.ones((2, 4)))

class Interrupts:
    name = "Interrupts"
    def estimate(self, *args, **kwargs):
        raise KeyboardInterrupt

class Leaves:
    name = "Leaves"
    def estimate(self, *args, **kwargs):
        raise GeneratorExit("early")

class HasNoText:
    name = "HasNoText"
    def estimate(self, *args, **kwargs):
        class Mute(Exception):
            def __str__(self):
                raise ValueError
        raise Mute

class Surrogates:
    name = "Surrogates"
    def estimate(self, *args, **kwargs):
        return SimpleNamespace(weights=np.ones((2, 4)), message="\\udc80")
"""


@pytest.mark.parametrize(
    ("name", "status", "message"),
    [
        ("Changes", "invalid", "changes the problem"),
        ("ChangesAFeature", "invalid", "changes the problem"),
        ("Interrupts", "crash", "KeyboardInterrupt: ("),
        ("Leaves", "crash", "GeneratorExit: early ("),
        ("HasNoText", "crash", "Mute: no text ("),
        ("Surrogates", "ok", r"\udc80"),
    ],
)
def test_what_harms_others_is_a_row_of_its_own(tmp_path, outcomes, name, status, message):
    path = tmp_path / "harmful.py"
    path.write_text(HARMFUL)
    found = outcomes(f'["{path}:{name}", "uniform"]', trajectories="")
    for outcome in found[:2]:
        assert outcome.status == status
        assert message in outcome.message
    for other in found[2:]:  # run after it
        assert other.status == "ok"
        assert other.scores["position_error"] < 1e-6  # its weights happen to be the true ones


SEEN = """
name = "tiny"
scenarios = ["two_player"]
sensors = [
    "full",
    "partial",
    {name = "range_bearing", parameters = {position = [-3.0, -3.0], facing = 0.8}},
    {name = "correlated", parameters = {correlation = 0.6}},
    {name = "drop", parameters = {p = 0.3}},
]
sigmas = [0.0, 0.05]
seeds = 1
trajectories = 2
estimators = ["uniform"]
"""


def test_the_truth_has_the_squared_error_of_its_own_noise(tmp_path):
    """Relative to the variance it is chi-squared: about the number of samples."""
    path = tmp_path / "suite.toml"
    path.write_text(SEEN)
    for trial in expand(load_suite(str(path))):
        case = case_of(trial)
        assert len(case.observations) == len(case.recordings) == 2
        found = case.outcome.truth_objective
        if trial.sigma == 0:
            assert found == pytest.approx(0, abs=1e-20)
            continue
        count = sum(np.isfinite(one.y).sum() for one in case.observations)
        assert abs(found / trial.sigma**2 - count) < 5 * np.sqrt(2 * count), trial.sensor.label
        if trial.sensor.label == "full":
            states = [one.states for one in case.recordings]
            errors = [o.y - s for o, s in zip(case.observations, states, strict=True)]
            assert found == pytest.approx(np.sum(np.square(errors)))
            positions = np.abs(errors[0][..., :2]).mean()
            assert case.outcome.observation_error == pytest.approx(positions)


def test_estimators_are_told_what_the_rules_say() -> None:
    trial = next(t for t in expand(load_suite("quick")) if t.sigma)
    usual = case_of(trial)
    told = case_of(replace(trial, rules=Rules(prior=3.0, noise=2.0, noise_spread=0.5)))
    assert told.problem.prior == WeightPrior((3.0,))
    assert told.problem.sigma == 2 * usual.problem.sigma == 2 * trial.sigma
    assert (usual.problem.sigma_spread, told.problem.sigma_spread) == (0.0, 0.5)
    np.testing.assert_array_equal(told.observations[0].y, usual.observations[0].y)
    silent = next(t for t in expand(load_suite("paper")) if not t.sigma)
    assert case_of(replace(silent, rules=Rules(noise_spread=0.5))).problem.sigma_spread == 0
