"""What becomes of one trial."""

from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.bench.judge.estimate_check import MOST_EXTRAS, InvalidEstimateError, check_estimate
from olne_bench.bench.judge.referee import evaluate
from olne_bench.bench.judge.truth import true_recording
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.trial import expand
from olne_bench.estimators.protocol import Problem
from olne_bench.games.observation import VIEWS


def test_draws_without_an_equilibrium_are_rows_of_their_own(monkeypatch):
    monkeypatch.setattr("olne_bench.envs.driving.MAX_DRAWS", 0)
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
    name = "Single"
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
    assert noise_free.covers_truth is None  # an ellipsoid without extent
    assert noisy.covers_truth in (0, 1)
    assert 0 <= noisy.held_out_error < 0.1
    assert noisy.objective < noisy.truth_objective


def test_a_plugin_of_one_trajectory_is_skipped_where_there_are_more(tmp_path):
    for outcome in outcomes(tmp_path, plugin(tmp_path)):
        assert outcome.status == "skipped"
        assert outcome.message == "takes one trajectory at a time, not 2"


def test_a_plugin_of_one_trajectory_is_given_one(tmp_path):
    for outcome in outcomes(tmp_path, plugin(tmp_path), trajectories=""):
        assert outcome.status == "ok"
        assert outcome.covers_truth is None


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ("np.eye(7)", r"covariance has the shape (7, 7), expected (8, 8)"),
        ("np.full((8, 8), np.nan)", "covariance is not finite"),
        ("'narrow'", "covariance is not an array of numbers"),
    ],
)
def test_a_covariance_that_is_none_is_invalid(tmp_path, covariance, message):
    for outcome in outcomes(tmp_path, plugin(tmp_path, covariance), trajectories=""):
        assert outcome.status == "invalid"
        assert message in outcome.message


@pytest.fixture(scope="module")
def problem():
    game = true_recording(ScenarioEntry(name="two_player"), 0).scenario.game
    return Problem(game, VIEWS["full"])


def checked(problem, **given):
    return check_estimate(SimpleNamespace(**{"weights": np.ones((2, 4))} | given), problem)


@pytest.mark.parametrize("scale", [1e308, 5e-324, 1.0])
def test_weights_of_any_size_are_scaled_to_sum_one(problem, scale):
    weights = checked(problem, weights=np.full((2, 4), scale)).weights
    assert weights.tolist() == [[0.25] * 4] * 2


def test_weights_of_usual_size_are_divided_by_their_sum_to_the_last_bit(problem):
    weights = np.random.default_rng(0).uniform(0, 3, (2, 4))
    expected = weights / weights.sum(axis=1, keepdims=True)
    assert (checked(problem, weights=weights).weights == expected).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"weights": np.ones((2, 4), dtype=complex)}, "weights are not an array of numbers"),
        ({"weights": np.full((2, 4), "1")}, "weights are not an array of numbers"),
        ({"states": np.ones((25, 2, 4), dtype=complex)}, "states are not an array of numbers"),
        ({"covariance": np.triu(np.ones((8, 8)))}, "covariance is not symmetric"),
        ({"covariance": -np.eye(8)}, "covariance is not positive semi-definite"),
        ({"extras": [1]}, r"extras are \[1\], expected a mapping"),
        ({"extras": {"objective": "low"}}, r"extras\['objective'\] is 'low', expected a number"),
        ({"extras": {"objective": 10**400}}, r"extras\['objective'\] is a int, expected a number"),
        ({"converged": np.array([True, False])}, r"converged is array\(\[ True, False\]\), expec"),
        ({"converged": "no"}, "converged is 'no', expected True or False"),
        ({"message": 3}, "message is 3, expected a text"),
    ],
)
def test_a_malformed_field_is_named(problem, given, message):
    with pytest.raises(InvalidEstimateError, match=message):
        checked(problem, **given)


def test_a_property_that_raises_is_invalid(problem):
    class Lazy:
        @property
        def weights(self):
            raise ZeroDivisionError

    with pytest.raises(InvalidEstimateError, match="weights cannot be read: ZeroDivisionError"):
        check_estimate(Lazy(), problem)


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_a_covariance_that_is_one_up_to_rounding_is_kept(problem, size):
    factor = np.random.default_rng(0).standard_normal((8, 3))
    covariance = size * (factor @ factor.T) * (1 + 1e-12 * np.triu(np.ones((8, 8))))
    assert (checked(problem, covariance=covariance).covariance == covariance).all()
    assert checked(problem, covariance=np.zeros((8, 8))).covariance is not None


def test_scalar_extras_are_kept(problem):
    numbers = {"starts": np.int64(3), "least": 0.5, "bad": np.nan, "yes": np.True_, "objective": 1}
    others = {"path": np.ones(3), "how": "a\nb", "long": "x" * 1000, 7: 8}
    found = checked(problem, extras=numbers | others)
    assert found.objective == 1.0
    assert found.extras == '{"how": "a b", "least": 0.5, "starts": 3, "yes": true}'
    many = checked(problem, extras={f"n{k:02}": k for k in range(30)}).extras
    assert many.count(":") == MOST_EXTRAS
    assert checked(problem).extras is None


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
        ("Changes", "invalid", "it changed the problem: problem.game.dt was 0.25 and is 5.0"),
        ("ChangesAFeature", "invalid", "changed the problem: problem.game.players[1].preferences"),
        ("Interrupts", "crash", "KeyboardInterrupt: ("),
        ("Leaves", "crash", "GeneratorExit: early ("),
        ("HasNoText", "crash", "Mute: no text ("),
        ("Surrogates", "ok", "?"),
    ],
)
def test_what_harms_others_is_a_row_of_its_own(tmp_path, name, status, message):
    path = tmp_path / "harmful.py"
    path.write_text(HARMFUL)
    found = outcomes(tmp_path, f'["{path}:{name}", "uniform"]', trajectories="")
    for outcome in found[:2]:
        assert outcome.status == status
        assert message in outcome.message
    for other in found[2:]:  # run after it, in the same process
        assert other.status == "ok"
        assert other.position_error < 1e-6  # its weights happen to be the true ones
