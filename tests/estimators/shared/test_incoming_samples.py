"""Streams: past samples only, windows, and solves that begin at the last solution."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.incoming_samples import (
    Samples,
    StreamEndedError,
    Windows,
    WindowStream,
    as_stream_estimator,
    warm_up_stream,
)
from olne_bench.estimators.shared.joint_stream import JointStream
from olne_bench.estimators.uniform import Uniform
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.olne import solve_olne
from olne_bench.plugins import ESTIMATOR, make, names

SIGMA = 0.01


@pytest.fixture(scope="module")
def passing(recorded) -> tuple[Problem, np.ndarray, np.ndarray, np.ndarray]:
    """A problem, its samples (T, N, d), the true states and weights."""
    recording = recorded("two_player")
    scenario = recording.scenario
    noise = SIGMA * np.random.default_rng(0).standard_normal(recording.states.shape)
    problem = Problem(scenario.game, VIEWS["full"], SIGMA)
    return problem, recording.states + noise, recording.states, scenario.weights


def follow(estimator: Any, problem: Problem, y: np.ndarray, lag: int | None = None) -> list:
    """The estimates after each sample."""
    stream = estimator.start(problem, rng=np.random.default_rng(0), lag=lag)
    return [stream.update(sample, budget=60) for sample in y]


def test_windows_are_estimates_of_what_was_seen(passing) -> None:
    problem, y, _, _ = passing
    estimates = follow(Windows(Map()), problem, y[:6])
    for count in (1, 4, 6):
        seen = np.where(np.arange(len(y))[:, None, None] < count, y, np.nan)
        rng = np.random.default_rng(0)
        expected = Map().estimate(problem, Observation(seen), rng=rng, budget=60)
        np.testing.assert_array_equal(estimates[count - 1].weights, expected.weights)
        np.testing.assert_array_equal(estimates[count - 1].states, expected.states)


@pytest.mark.parametrize("estimator", [Map(), KktConstrained()], ids=["map", "kkt_constrained"])
@pytest.mark.parametrize("lag", [None, 8])
def test_solves_from_the_last_solution_end_where_others_do(passing, estimator, lag) -> None:
    problem, y, _, _ = passing
    warm, cold = (follow(one, problem, y, lag) for one in (estimator, Windows(estimator)))
    assert all(one.converged for one in warm)
    assert sum(one.extras["starts"] == 0 for one in warm) >= len(y) - 5
    for ours, theirs in list(zip(warm, cold, strict=True))[6:]:
        assert ours.extras["objective"] == pytest.approx(theirs.extras["objective"], rel=1e-3)
        np.testing.assert_allclose(ours.weights, theirs.weights, atol=2e-3)


def test_what_explains_nothing_is_no_start(passing) -> None:
    problem, y, states, _ = passing
    stream = KktConstrained().start(problem, rng=np.random.default_rng(0))
    assert isinstance(stream, JointStream)
    for sample in y[:10]:
        stream.update(sample, budget=60)
    optimum = stream._optimum
    optimum._last = replace(optimum._last, states=optimum._last.states + 5.0)  # somewhere else
    found = stream.update(y[10], budget=60)
    assert found.converged
    assert np.abs(found.states - states)[..., :2].max() < 0.1


def test_what_no_equilibrium_explains_is_not_searched_for_each_time(passing) -> None:
    problem, y, _, _ = passing
    swaying = y.copy()
    swaying[:, :, 0] += 10 * SIGMA * np.sin(2.0 * np.arange(len(y)))[:, None]
    estimates = follow(KktConstrained(), problem, swaying)
    lost = estimates[8:]
    largest = max(one.extras["objective"] for one in lost)
    assert largest > 5 * SIGMA**2 * swaying.size  # far from noise
    searches = sum(one.extras["starts"] > 0 for one in lost)
    assert searches < len(lost) / 2


def test_the_rest_of_a_motion_is_a_game_of_the_same_weights(passing) -> None:
    problem, _, states, weights = passing
    exact = replace(problem, sigma=0.0)
    last = follow(KktConstrained(), exact, states, lag=12)[-1]
    np.testing.assert_allclose(last.weights, weights, atol=1e-5)
    np.testing.assert_allclose(last.states, states, atol=1e-5)


def test_states_go_back_to_the_beginning(passing) -> None:
    problem, y, states, _ = passing
    for estimate in follow(Map(), problem, y, lag=5):
        assert estimate.states.shape == states.shape
    assert np.abs(estimate.states - states)[..., :2].max() < 0.2


class Reads:
    """Keeps the observations that it gets; its estimates have no states at first."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, np.ndarray]] = []

    def estimate(self, problem: Problem, observation: Observation, **_: Any) -> Estimate:
        self.seen.append((problem.game.horizon, observation.y))
        states = np.zeros(problem.game.state_shape) if len(self.seen) > 3 else None
        return Estimate(weights=np.ones((2, 4)), states=states)

    def warm_up(self, problem: Problem) -> None:
        self.seen.append((problem.game.horizon, np.zeros(0)))


def test_the_latest_samples_count(passing) -> None:
    problem, y, _, _ = passing
    reader, horizon = Reads(), len(y)
    found = follow(Windows(reader), problem, y[:5], lag=3)
    assert [length for length, _ in reader.seen] == [
        horizon,
        horizon,
        horizon,
        horizon - 1,
        horizon - 2,
    ]
    _, last = reader.seen[-1]
    np.testing.assert_array_equal(last[:3], y[2:5])
    assert np.isnan(last[3:]).all()
    assert found[-1].states is None  # nothing is known of the first two steps


def test_solvers_of_all_windows_are_built(passing) -> None:
    problem, y, _, _ = passing
    reader = Reads()
    warm_up_stream(reader, problem, 20)
    assert [length for length, _ in reader.seen] == list(range(len(y), 19, -1))
    warm_up_stream(Uniform(), problem, None)  # it has nothing to build


def test_every_estimator_can_follow(passing) -> None:
    problem, y, _, _ = passing
    assert isinstance(as_stream_estimator(Map()), Map)
    (first,) = follow(as_stream_estimator(Uniform()), problem, y[:1])
    assert first.states is None
    ipopt = KktConstrained(solver="ipopt").start(problem, rng=np.random.default_rng(0))
    assert isinstance(ipopt, WindowStream)


def test_bad_samples_are_refused(passing) -> None:
    problem, y, _, _ = passing
    samples = Samples(problem)
    with pytest.raises(ValueError, match=r"has the shape \(2, 3\), expected \(2, 4\)"):
        samples.add(y[0, :, :3])
    with pytest.raises(ValueError, match="infinite"):
        samples.add(np.full_like(y[0], np.inf))
    for sample in y:
        samples.add(sample)
    with pytest.raises(StreamEndedError, match=f"ends after {len(y)} samples"):
        samples.add(y[0])
    for lag in (1, 0, -3, 2.5, True):
        with pytest.raises(ValueError, match="a lag is a number of samples of at least 2"):
            Samples(problem, lag)


#: Parameters that make an estimator fast, and estimators that are slow all the same.
FAST: dict[str, dict[str, Any]] = {"particle": {"count": 40, "most_draws": 2}}
SLOW = ("bilevel", "maxent_residual", "particle", "posterior", "ukf")
#: Those that know a few games only; they have a test of their own.
TRAINED = ("neural_posterior",)
ALL = [
    pytest.param(n, marks=[pytest.mark.long] if n in SLOW else [])
    for n in names(ESTIMATOR)
    if n not in TRAINED
]


@pytest.mark.parametrize("name", ALL)
def test_no_estimate_of_a_stream_depends_on_later_samples(name, seen) -> None:
    problem, (observation,), _ = seen(1, sigma=0.02)
    y, count = observation.y, 7
    altered = y.copy()
    altered[count:] = 5.0 - 2.0 * y[count:]
    estimator = as_stream_estimator(make(ESTIMATOR, name, FAST.get(name, {})))
    before, after = (follow(estimator, problem, one[: count + 2]) for one in (y, altered))
    for one, other in list(zip(before, after, strict=True))[:count]:
        np.testing.assert_array_equal(one.weights, other.weights)  # to the last bit
        np.testing.assert_array_equal(one.states, other.states)
        assert one.converged == other.converged
    assert any(one.converged for one in before[:count])


@pytest.mark.parametrize("lag", [None, 8])
@pytest.mark.parametrize("name", ["kkt_constrained", "map", "uniform"])
def test_a_player_may_disappear_and_come_back(passing, name, lag) -> None:
    problem, y, states, _ = passing
    gaps = y.copy()
    gaps[9:13, 1] = np.nan
    estimates = follow(as_stream_estimator(make(ESTIMATOR, name, {})), problem, gaps, lag)
    for count, estimate in enumerate(estimates, start=1):
        assert estimate.converged, f"after {count} samples"
        assert name == "uniform" or np.isfinite(estimate.states).all()
    if name != "uniform":
        hidden = estimates[12].states[9:13, 1, :2] - states[9:13, 1, :2]
        assert np.linalg.norm(hidden, axis=-1).max() < 0.1


@pytest.mark.parametrize("name", ["kkt_constrained", "map"])
def test_samples_out_of_order_explain_nothing_and_do_no_harm(passing, name) -> None:
    problem, y, states, _ = passing
    swapped = y.copy()
    swapped[[4, 6]] = y[[6, 4]]
    estimates = follow(make(ESTIMATOR, name, {}), problem, swapped, lag=8)
    assert np.isfinite([one.weights for one in estimates]).all()
    last = estimates[-1]  # the window has none of them any more
    assert last.converged
    assert np.linalg.norm((last.states - states)[-8:, :, :2], axis=-1).max() < 0.05


def test_a_window_is_no_longer_than_the_game(passing) -> None:
    problem, y, _, _ = passing
    with pytest.raises(ValueError, match="a lag of 26 samples is longer than the motion, of 25"):
        Samples(problem, len(y) + 1)
    assert Samples(problem, len(y)).dropped == 0


@pytest.fixture(scope="module")
def replanned(passing) -> tuple[Problem, np.ndarray]:
    """A problem that goes on, and samples of players who plan again after five steps."""
    problem, _, states, weights = passing
    game = replace(problem.game, horizon=15)
    motion, start = [], states[0]
    for _ in range(4):
        found = solve_olne(game, weights, start)
        assert found.certificate.passed
        motion, start = [*motion, *found.states[:5]], found.states[5]
    noise = SIGMA * np.random.default_rng(1).standard_normal((20, *states.shape[1:]))
    return replace(problem, game=game, goes_on=True), np.stack(motion) + noise


@pytest.mark.parametrize("estimator", [Map(), Windows(Map()), Uniform()], ids=str)
def test_a_motion_that_goes_on_has_games_of_one_length(replanned, estimator) -> None:
    problem, y = replanned
    estimates = follow(as_stream_estimator(estimator), problem, y, lag=6)
    assert len(estimates) > problem.game.horizon
    for estimate in estimates[1:]:
        assert estimate.converged
        if estimate.states is not None:
            assert estimate.states.shape == problem.game.state_shape
    if estimates[-1].states is not None:  # of the window, from its first sample on
        away = estimates[-1].states[:6, :, :2] - y[-6:, :, :2]
        assert np.linalg.norm(away, axis=-1).max() < 5 * SIGMA


def test_solves_go_on_from_the_last_one_where_the_motion_does(replanned) -> None:
    problem, y = replanned
    warm, cold = (follow(one, problem, y, lag=6) for one in (Map(), Windows(Map())))
    assert sum(one.extras["starts"] == 0 for one in warm) >= len(y) - 5
    for ours, theirs in list(zip(warm, cold, strict=True))[6:]:
        assert ours.extras["objective"] <= 1.01 * theirs.extras["objective"]
    ahead = [np.linalg.norm(warm[k].states[8, :, :2] - y[k + 3, :, :2]) for k in range(6, 17)]
    straight = [
        np.linalg.norm((y[k] + 3 * (y[k] - y[k - 1]) - y[k + 3])[:, :2]) for k in range(6, 17)
    ]
    assert np.median(ahead) < 0.5 * np.median(straight)


def test_a_motion_that_goes_on_needs_a_lag(replanned) -> None:
    problem, _ = replanned
    with pytest.raises(ValueError, match="a motion that goes on needs a lag"):
        Samples(problem)
    assert len(Samples(problem, 6).lags()) == 1
