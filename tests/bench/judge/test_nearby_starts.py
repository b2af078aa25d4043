"""Other starts of the same players."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.nearby_starts import follow_start, neighbours
from olne_bench.bench.judge.observe import observe, sensor_model
from olne_bench.bench.judge.truth import (
    Draw,
    held_out,
    true_recording,
    true_recordings,
    unit_cosine_limit,
)
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import FullView
from olne_bench.games.solve.nearest_root import Prediction
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import solve_olne
from olne_bench.games.solve.root_following import follow_root

TWO = Draw.of(ScenarioEntry(name="two_player"), 0, "")
THREE_TIMES = Draw.of(ScenarioEntry(name="two_player", trajectories=3), 0, "")
FULL = (FullView(),)


def followed(recording: Recording, weights: np.ndarray) -> Root:
    truth = recording.scenario
    root = follow_root(truth.game, recording.root, truth.weights, weights)
    assert root is not None
    return root


def test_neighbours_are_certified_equilibria_from_other_starts():
    recording = true_recording(TWO)
    found = neighbours(recording, 3, "test", 0)
    assert len(found) == 3
    for one in found:
        assert one.certificate.passed
        assert one.certificate.global_so_far is not None
        start = one.scenario.initial_state
        assert 0 < np.abs(start - recording.scenario.initial_state).max() < 0.5
        game, weights = one.scenario.game, one.scenario.weights
        root = newton_root(game, one.states, one.controls, one.costates, weights)
        assert root.residual < 1e-9
        np.testing.assert_allclose(one.states, root.states, atol=1e-9)
        # The observation beyond the horizon is one step without control later.
        coasted = rollout(game.dynamics, one.states[-1], np.zeros((1, 2, 2)), game.dt)[-1]
        np.testing.assert_array_equal(one.extra_state, coasted)
        # Players pass each other as in the scenario itself.
        assert position_error(one.states, recording.states) < 0.2


def test_starts_at_which_a_player_has_a_better_plan_far_away_are_left_out():
    recording = true_recording(Draw("random", '{"num_players": 3}', 1, 34))
    scenario = recording.scenario
    game, controls = scenario.game, np.zeros(scenario.game.control_shape)
    controls[:, 0, 0] = -1.0
    first = solve_olne(game, scenario.weights, scenario.initial_state, initial_controls=controls)
    assert first.certificate.passed  # but only locally
    trap = replace(recording, states=first.states, controls=first.controls, costates=first.costates)
    assert len(neighbours(recording, 1, "test", 0)) == 1
    with pytest.raises(NoEquilibriumError, match="only 0 of 1 starts"):
        neighbours(trap, 1, "test", 0)


def test_they_depend_on_seed_and_use_and_on_nothing_else():
    recording = true_recording(TWO)
    same, again = (neighbours(recording, 1, "a", 0)[0].states for _ in range(2))
    np.testing.assert_array_equal(same, again)
    for stream, seed in (("b", 0), ("a", 1)):
        assert np.abs(neighbours(recording, 1, stream, seed)[0].states - same).max() > 1e-3


def test_too_few_neighbours_are_an_error(monkeypatch):
    monkeypatch.setattr("olne_bench.bench.judge.nearby_starts.POSITION", 1e6)
    with pytest.raises(NoEquilibriumError, match=r"only \d of 2 starts near that of 'two_player'"):
        neighbours(true_recording(TWO), 2, "test", 0)


def test_several_trajectories_begin_with_the_scenario_and_have_noise_of_their_own():
    recordings = true_recordings(THREE_TIMES)
    assert len(recordings) == 3
    np.testing.assert_array_equal(recordings[0].states, true_recording(TWO).states)
    noises = [
        seen.y - r.states
        for seen, r in zip(observe(recordings, FULL, 0.01, 0), recordings, strict=True)
    ]
    np.testing.assert_array_equal(
        noises[0] + recordings[0].states, observe(recordings[:1], FULL, 0.01, 0)[0].y
    )
    assert abs(np.corrcoef(noises[0].ravel(), noises[1].ravel())[0, 1]) < 0.3


def test_several_trajectories_have_a_lower_limit():
    model = sensor_model(true_recording(TWO).scenario, FULL)
    one, three = (unit_cosine_limit(draw, model) for draw in (TWO, THREE_TIMES))
    assert 0.2 < three / one < 0.5


def held_out_error(weights: np.ndarray) -> float:
    found = held_out(TWO, weights, 100)
    assert found is not None and len(found) == 5
    return float(np.mean([position_error(one.states, one.prediction) for one in found]))


def test_held_out_predictions_are_exact_at_the_truth_and_err_elsewhere():
    weights = true_recording(TWO).scenario.weights
    assert held_out_error(weights) < 1e-9
    other = weights * np.array([1.0, 1.5, 0.7, 1.0])
    assert held_out_error(other / other.sum(axis=1, keepdims=True)) > 1e-3


HOPELESS = np.array([[1.0, 0, 0, 0]] * 2)  # players only avoid each other, at any speed


def test_held_out_predictions_are_the_same_equilibrium_from_other_starts():
    recording = true_recording(TWO)
    weights = np.array([[0.2, 0.3, 0.3, 0.2], [0.3, 0.3, 0.2, 0.2]])
    others = neighbours(recording, 3, "test", 0)
    roots = follow_start(others, weights, followed(recording, weights))
    assert len(roots) == 3
    for other, root in zip(others, roots, strict=True):
        np.testing.assert_array_equal(root.states[0], other.scenario.initial_state)
        # From the truth at that start to the other weights: another way to the same root.
        assert position_error(root.states, followed(other, weights).states) < 1e-9


def test_held_out_predictions_end_at_the_first_that_has_no_root():
    recording = true_recording(TWO)
    others = neighbours(recording, 3, "test", 0)
    known = newton_root(
        recording.scenario.game,
        recording.states,
        recording.controls,
        recording.costates,
        recording.scenario.weights,
    )
    # The truth is no root at these weights, nor is there one: all attempts are made, and bounded.
    assert follow_start(others, HOPELESS, known) == []


def test_without_a_prediction_there_are_no_held_out_ones(monkeypatch):
    nothing = Prediction(None, published=False)
    monkeypatch.setattr("olne_bench.bench.judge.truth._prediction", lambda *_: nothing)
    weights = np.array([[0.4, 0.2, 0.2, 0.2], [0.2, 0.2, 0.2, 0.4]])
    assert held_out(TWO, weights, 100) is None
