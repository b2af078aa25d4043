"""The examples run unchanged."""

import itertools
import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import olne_bench as ob

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_play_olne_saves_an_episode_in_which_cars_overtake(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    played = runpy.run_path(str(EXAMPLES / "play_olne.py"))
    with Image.open(tmp_path / "olne.gif") as gif:
        frames = [np.array(frame.convert("RGB")) for frame in ImageSequence.Iterator(gif)]
    assert len(frames) == 20
    assert all(frame.std() > 5 for frame in frames)
    assert all((a != b).any() for a, b in itertools.pairwise(frames))
    world = played["world"]
    start = world.scenario.initial_state[:, 1]
    end = world.state()[:-1].reshape(5, 4)[:, 1]
    overtaken = (start[:, None] < start) & (end[:, None] > end)
    assert overtaken.any()


@pytest.mark.long
def test_a_network_is_learnt_and_predicts_like_the_true_cost():
    """From six drives and for six held-out ones; the example has eight and twenty."""
    example = runpy.run_path(str(EXAMPLES / "lane_network.py"))
    happened = example["drives"](0, trajectories=6, held_out=6)
    game, found = example["learnt"](happened.seen)
    assert found.converged, found.message
    assert np.isfinite(found.parameters).sum() == 30
    true, learnt = (
        example["prediction_error"](one, weights, happened.held_out, happened.noisy_starts)
        for one, weights in (
            (example["road"](example["Habit"]()), example["WEIGHTS"]),
            (game, found.weights),
        )
    )
    assert learnt < 1.5 * true
    assert 0.01 < true < 0.1


def test_a_comparison_in_ten_lines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = (EXAMPLES / "compare.py").read_text()
    lines = [line for line in source.splitlines()[1:] if line.strip()]
    assert sum(line.startswith(("import ", "from ")) for line in lines) == 1
    result = runpy.run_path(str(EXAMPLES / "compare.py"))["result"]
    assert set(result.frame["estimator"]) == {"map", "kkt_residual", "Guess"}
    with Image.open(tmp_path / "compare.png") as picture:
        assert np.array(picture.convert("L")).std() > 5


@pytest.mark.learners
def test_nashopt_gets_the_costs_and_motions_of_the_game():
    """Its whole estimate takes half a minute, and needs what only ``make perf`` installs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one of its own dependencies is deprecated
        example = runpy.run_path(str(EXAMPLES / "nashopt_inverse.py"))
    for name in ("two_player", "merge"):
        scenario = ob.scenario(name)
        truth = ob.solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        decisions = truth.controls.transpose(1, 0, 2).ravel()
        states, costs = example["JaxGame"](scenario.game).played(
            decisions, scenario.initial_state.ravel(), scenario.weights.ravel()
        )
        np.testing.assert_allclose(states.reshape(truth.states.shape), truth.states, atol=1e-6)
        np.testing.assert_allclose(costs, truth.certificate.costs, rtol=1e-6)


def test_lucidgames_learns_from_single_steps_where_noise_is_small():
    example = runpy.run_path(str(EXAMPLES / "lucidgames.py"))
    scenario = ob.scenario("two_player", weights="dirichlet", seed=1)
    errors = []
    for sigma in (1e-4, 0.01):
        problem, seen = ob.observe(scenario, "full", sigma, seed=1)
        found = example["LucidGames"]().estimate(problem, seen, rng=None, budget=60.0)
        errors.append(np.mean(ob.metrics.cosine_error(scenario.weights, found.weights)))
    assert errors[0] < 0.002 < errors[1] < 0.2
    problem, seen = ob.observe(scenario, "partial", 0.01)
    hidden = example["LucidGames"]().estimate(problem, seen, rng=None, budget=60.0)
    assert not hidden.converged and hidden.message.startswith("needs a sensor that shows")
