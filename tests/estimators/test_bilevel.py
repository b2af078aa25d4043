"""The bilevel method: exact gradients, and the joint method's optimum."""

import time
from dataclasses import replace

import numpy as np
import pytest

from olne_bench.estimators import bilevel
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared.certainty import Certainty
from olne_bench.estimators.shared.charts import RatioChart
from olne_bench.estimators.shared.forward_model import first_games, squared_error_of
from olne_bench.estimators.shared.outer_fit import OuterResiduals

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(("seed", "players"), [(1, 2), (2, 2), (3, 3), (5, 3)])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_gradients_are_those_of_finite_differences(seen, seed, players, view):
    problem, observations, _ = seen(seed, sigma=0.01, view=view, players=players)
    game = first_games(problem, observations[0])[0]
    chart = RatioChart(game.weights, problem.weight_floor)
    residuals = OuterResiduals(problem, tuple(observations), (game,), chart)
    point = residuals.unknowns((game,))
    jacobian = residuals.jacobian(point)
    step = 1e-5
    for k, direction in enumerate(np.eye(point.size)):
        ahead, behind = (residuals.values(point + s * step * direction) for s in (1, -1))
        numeric = (ahead - behind) / (2 * step)
        scale = max(1.0, np.abs(numeric).max())
        np.testing.assert_allclose(jacobian[:, k] / scale, numeric / scale, atol=1e-6)


def test_gradients_of_several_trajectories_are_blocks(seen):
    problem, observations, _ = seen(1, sigma=0.01, count=2)
    games = tuple(first_games(problem, one)[0] for one in observations)
    chart = RatioChart(games[0].weights, problem.weight_floor)
    residuals = OuterResiduals(problem, tuple(observations), games, chart)
    point = residuals.unknowns(games)
    jacobian, rows = residuals.jacobian(point), observations[0].y.size
    assert not jacobian[:rows, -8:].any()
    assert not jacobian[rows:, chart.size : chart.size + 8].any()
    direction = np.random.default_rng(0).standard_normal(point.size)
    ahead, behind = (residuals.values(point + s * 1e-6 * direction) for s in (1, -1))
    np.testing.assert_allclose(jacobian @ direction, (ahead - behind) / 2e-6, atol=1e-5)


@pytest.mark.parametrize("seed", [1, 2, 4])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_the_optimum_is_that_of_the_joint_method(seen, seed, view):
    problem, (observation,), _ = seen(seed, sigma=0.02, view=view)
    bilevel = Bilevel().estimate(problem, observation, rng=RNG, budget=60)
    joint = KktConstrained().estimate(problem, observation, rng=RNG, budget=60)
    assert bilevel.converged
    assert joint.converged
    assert bilevel.extras["objective"] == pytest.approx(joint.extras["objective"], abs=1e-6)
    np.testing.assert_allclose(bilevel.covariance, joint.covariance, rtol=1e-2, atol=1e-6)


def test_time_is_kept(seen):
    problem, (observation,), _ = seen(1, sigma=0.1)
    result = Bilevel().estimate(problem, observation, rng=RNG, budget=0.0)
    assert not result.converged
    assert result.message == "time limit reached"


def test_several_trajectories_tell_more(seen):
    problem, observations, _ = seen(1, sigma=0.01, count=3)
    one = Bilevel().estimate(problem, observations[0], rng=RNG, budget=60)
    all_of_them = Bilevel().estimate(problem, observations, rng=RNG, budget=60)
    assert np.trace(all_of_them.covariance) < 0.7 * np.trace(one.covariance)


def test_a_search_that_equilibria_end_is_no_optimum(seen, monkeypatch):
    problem, (observation,), _ = seen(1, sigma=0.02)
    play, calls = OuterResiduals._play, []

    def play_once(self, unknowns):
        calls.append(unknowns)
        first = np.array_equal(unknowns, calls[0])
        return play(self, unknowns) if first else None

    monkeypatch.setattr(OuterResiduals, "_play", play_once)
    result = Bilevel(starts=1).estimate(problem, observation, rng=RNG, budget=60)
    assert not result.converged
    assert result.message == "no equilibrium in the direction of descent"


def test_a_trajectory_with_fewer_starts_repeats_its_last():
    starts = [["a"], ["b", "c", "d"], ["e", "f"]]
    combinations = [("a", "b", "e"), ("a", "c", "f"), ("a", "d", "f")]
    assert bilevel._combinations(starts, 5) == combinations
    assert bilevel._combinations(starts, 2) == combinations[:2]


def ended(objective: float, message: str = "", evaluations: int = 1) -> bilevel._Result:
    return bilevel._Result((), objective, not message, message, evaluations)


def test_the_lowest_error_is_taken_and_of_equal_ones_what_converged():
    low, high, lost = ended(1.0), ended(2.0), ended(1.0, "lost")
    assert bilevel._best([high, low]) is low
    assert bilevel._best([lost, high, low]) is low
    assert bilevel._best([lost, ended(1.0 + 5e-6)]).converged
    assert bilevel._best([lost, ended(1.0 + 5e-5)]) is lost
    assert bilevel._best([ended(0.0, "lost"), ended(5e-13)]).converged  # both are nothing
    assert bilevel._best([ended(0.0, "lost"), ended(1e-9)]).message == "lost"
    assert bilevel._best([lost]) is lost


def test_two_starts_agree_where_the_last_found_the_lowest_again():
    one, again, worse, lost = ended(1.0), ended(1.0 + 5e-6), ended(2.0), ended(1.0, "lost")
    assert not bilevel._agree([one])
    assert bilevel._agree([one, again])
    assert bilevel._agree([worse, one, again])
    assert not bilevel._agree([one, worse])
    assert not bilevel._agree([one, lost])
    assert not bilevel._agree([one, again, lost])
    assert not bilevel._agree([lost, one])
    assert not bilevel._agree([worse, ended(2.0), one])  # a lower one was found once only
    assert not bilevel._agree([one, ended(1.0 + 5e-5)])


@pytest.fixture
def descents(monkeypatch):
    """Descents that end as they are told to; what they started from, and until when."""
    answers, begun = [], []

    def descend(_problem, _observations, games, most, deadline, _pull):
        begun.append((games, most, deadline))
        return replace(answers.pop(0), games=games)

    monkeypatch.setattr(bilevel, "_descend", descend)
    monkeypatch.setattr(bilevel, "likelihood_certainty", lambda *_, **__: Certainty(None))
    return answers, begun


def estimate_of(seen, monkeypatch, starts=4, games=6, budget=60.0):
    problem, (observation,), _ = seen(1)
    first = first_games(problem, observation)[0]
    monkeypatch.setattr(bilevel, "first_games", lambda *_: [first] * games)
    chosen = Bilevel(starts=starts, max_evaluations=7)
    return chosen.estimate(problem, observation, rng=RNG, budget=budget)


def test_starts_are_tried_until_two_agree_or_there_are_enough(seen, monkeypatch, descents):
    answers, begun = descents
    answers += [ended(3.0, evaluations=2), ended(1.0, evaluations=3), ended(1.0, evaluations=4)]
    before = time.monotonic()
    result = estimate_of(seen, monkeypatch)
    assert result.extras == {"objective": 1.0, "starts": 3, "evaluations": 9}
    assert result.converged and result.message == ""
    assert {most for _, most, _ in begun} == {7}
    assert all(50 < deadline - before < 75 for *_, deadline in begun)  # all of the budget
    answers += [ended(float(k)) for k in range(9, 0, -1)]
    assert estimate_of(seen, monkeypatch, starts=4).extras["starts"] == 4
    assert estimate_of(seen, monkeypatch, starts=4, games=2).extras["starts"] == 2


def test_a_flat_optimum_is_gone_on_with_a_number_of_times(seen, monkeypatch, descents):
    answers, begun = descents
    long = bilevel._TOO_LONG
    answers += [ended(3.0, long), ended(2.0, long), ended(1.5)]
    result = estimate_of(seen, monkeypatch, starts=1)
    assert len(begun) == 3
    assert result.converged and result.extras["objective"] == 1.5
    answers += [ended(3.0, "no equilibrium"), ended(2.0)]
    assert estimate_of(seen, monkeypatch, starts=1).message == "no equilibrium"
    answers[:] = [ended(3.0, long) for _ in range(20)]
    flat = estimate_of(seen, monkeypatch, starts=1)
    assert (flat.message, flat.converged) == (long, False)
    assert len(answers) == 20 - 1 - bilevel._MOST_CONTINUATIONS


def test_the_clock_decides_no_number_of_starts(seen, monkeypatch, descents):
    """Only a start that the time has ended is the last one, and the estimate says so."""
    answers, _ = descents
    answers += [ended(3.0), ended(2.0), ended(1.0)]
    late = estimate_of(seen, monkeypatch, starts=3, budget=0.0)
    assert (late.extras["starts"], late.message) == (3, "")
    answers[:] = [ended(3.0), ended(2.0, bilevel.NO_TIME), ended(1.0)]
    late = estimate_of(seen, monkeypatch, starts=3)
    assert (late.extras["objective"], late.extras["starts"], late.converged) == (2.0, 2, False)
    answers[:] = [ended(2.0), ended(3.0, bilevel.NO_TIME)]
    late = estimate_of(seen, monkeypatch, starts=3)
    assert late.converged and late.extras["objective"] == 2.0
    assert late.message.startswith("time limit reached in start 2")


def test_an_observation_near_which_no_game_is_found_is_named(seen, monkeypatch):
    problem, observations, _ = seen(1, count=3)
    found = [first_games(problem, observations[0])[:1], [], []]
    monkeypatch.setattr(bilevel, "first_games", lambda *_: found.pop(0))
    result = Bilevel().estimate(problem, observations, rng=RNG, budget=1.0)
    assert result.message == "no equilibrium found near observation 1"
    assert not result.converged
    np.testing.assert_allclose(result.weights, 0.25)


@pytest.mark.parametrize("parameter", ["starts", "max_evaluations"])
def test_counts_are_at_least_one(parameter):
    Bilevel(**{parameter: 1})
    with pytest.raises(ValueError, match=parameter):
        Bilevel(**{parameter: 0})


def test_a_few_evaluations_are_too_few(seen):
    problem, (observation,), _ = seen(2, sigma=0.02)
    games = (first_games(problem, observation)[0],)
    short, whole = (
        bilevel._descend(problem, (observation,), games, most, np.inf) for most in (1, 100)
    )
    assert (short.message, short.converged, short.evaluations) == (bilevel._TOO_LONG, False, 1)
    assert whole.converged and whole.message == "" and 1 < whole.evaluations < 100
    assert whole.objective < short.objective
    found = squared_error_of(problem, whole.games[0].root.states, observation.y)
    assert whole.objective == pytest.approx(found)


def test_samples_that_are_missing_are_no_errors(seen):
    problem, (observation,), _ = seen(1, sigma=0.01)
    y = observation.y.copy()
    y[3, 1] = np.nan
    gappy = Observation(y)
    game = first_games(problem, observation)[0]
    chart = RatioChart(game.weights, problem.weight_floor)
    whole, part = (OuterResiduals(problem, (one,), (game,), chart) for one in (observation, gappy))
    point = whole.unknowns((game,))
    there = np.isfinite(y).ravel()
    np.testing.assert_array_equal(part.values(point), whole.values(point)[there])
    np.testing.assert_array_equal(part.jacobian(point), whole.jacobian(point)[there])
    assert not part.blocked
    np.testing.assert_allclose(point[chart.size :], game.initial_state.ravel())


def test_trajectories_start_at_one_theta_that_all_of_their_games_reach(seen, monkeypatch):
    problem, observations, _ = seen(1, sigma=0.01, count=2)
    found = [first_games(problem, one)[:2] for one in observations]
    play = bilevel.play_batch

    def not_from_the_best(problem, game, *rest):
        batch = play(problem, game, *rest)
        lost = game is found[1][0]
        return replace(batch, residuals=np.full(1, np.inf)) if lost else batch

    monkeypatch.setattr(bilevel, "play_batch", not_from_the_best)
    games = bilevel._at_one_theta(problem, tuple(own[0] for own in found), found)
    np.testing.assert_array_equal(games[0].theta, found[0][0].theta)
    np.testing.assert_array_equal(games[1].theta, found[0][0].theta)
    np.testing.assert_allclose(games[1].initial_state, found[1][1].initial_state)


def test_without_a_common_theta_the_first_games_are_tried(seen, monkeypatch):
    problem, observations, _ = seen(1, sigma=0.01, count=2)
    found = [first_games(problem, one)[:1] for one in observations]
    monkeypatch.setattr(bilevel, "_first_at", lambda *_: None)
    firsts = tuple(own[0] for own in found)
    assert bilevel._at_one_theta(problem, firsts, found) is firsts
