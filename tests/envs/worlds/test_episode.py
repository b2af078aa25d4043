"""An episode goes through a game on its own dynamics."""

from collections.abc import Callable

import numpy as np

from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.worlds.episode import Episode
from olne_bench.games.model.stage_costs import stage_costs


def test_the_equilibrium_is_replayed(recorded: Callable[..., Recording]) -> None:
    recording = recorded("two_player")
    scenario = recording.scenario
    episode, game = Episode(scenario, None), scenario.game
    assert (episode.steps, episode.time, episode.over) == (0, 0.0, False)
    paid = np.zeros(game.num_players)
    for step, controls in enumerate(recording.controls, 1):
        assert not episode.over
        paid += episode.advance(controls)
        assert episode.steps == step
        np.testing.assert_allclose(episode.time, step * game.dt)
        np.testing.assert_allclose(
            episode.vector(), [*episode.states.ravel(), step * game.dt], atol=0
        )
    assert episode.over
    assert len(episode.history) == game.horizon
    np.testing.assert_allclose(np.array(episode.history), recording.states, atol=1e-9)
    np.testing.assert_allclose(paid, _costs(recording), rtol=1e-9)


def _costs(recording: Recording) -> np.ndarray:
    """Cost of a recording for each player, summed here."""
    scenario = recording.scenario
    costs = stage_costs(scenario.game)
    total = np.array(costs.final(recording.states[-1].T, scenario.weights.T)).ravel()
    for states, controls in zip(recording.states, recording.controls, strict=False):
        total += np.array(costs.running(states.T, controls.T, scenario.weights.T)).ravel()
    return total
