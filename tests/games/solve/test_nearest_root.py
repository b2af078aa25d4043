import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.game import Game
from olne_bench.games.solve import nearest_root as module
from olne_bench.games.solve.kkt import kkt_residual_norm
from olne_bench.games.solve.nearest_root import Prediction, predict
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import Equilibrium, solve_olne

Crossing = tuple[Game, np.ndarray, np.ndarray]


def _root(found: Equilibrium) -> Root:
    return Root(found.states, found.controls, found.costates, found.residual)


@pytest.fixture
def other(crossing: Crossing) -> np.ndarray:
    """Weights near the true ones."""
    return crossing[0].check_weights(crossing[1] + 0.05 * np.eye(3, 4))


def test_true_weights_give_the_truth(crossing: Crossing, olne: Equilibrium) -> None:
    game, weights, _ = crossing
    prediction = predict(game, weights, _root(olne), weights)
    assert prediction.published
    root = prediction.root
    assert root is not None
    np.testing.assert_allclose(root.states, olne.states, atol=1e-7)


def test_other_weights_give_their_own_root(
    crossing: Crossing, olne: Equilibrium, other: np.ndarray
) -> None:
    game, weights, initial_state = crossing
    root = predict(game, other, _root(olne), weights).root
    assert root is not None
    assert kkt_residual_norm(game, root.states, root.controls, root.costates, other) < 1e-6
    np.testing.assert_array_equal(root.states[0], initial_state)
    expected = solve_olne(game, other, initial_state)
    np.testing.assert_allclose(root.states, expected.states, atol=1e-5)
    assert np.abs(root.states - olne.states).max() > 1e-4


def test_an_equilibrium_far_away_predicts_nothing() -> None:
    """An estimate of the kind that the paper calls ill-conditioned: acceleration costs nothing.

    The game has an equilibrium, but metres from anything that was seen.
    """
    scenario = get_scenario("two_player")
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    weights = np.array([[0.6853, 0.0463, 1e-5, 0.2683], [0.6267, 1e-5, 1e-5, 0.3733]])
    weights = scenario.game.check_weights(weights)
    far = solve_olne(scenario.game, weights, scenario.initial_state)
    assert far.certificate.passed
    assert np.abs(far.states - truth.states)[..., :2].max() > 2
    assert predict(scenario.game, weights, _root(truth), scenario.weights) == Prediction(
        None, False
    )


def test_without_any_root_there_is_no_prediction(
    crossing: Crossing, olne: Equilibrium, monkeypatch: pytest.MonkeyPatch
) -> None:
    game, weights, _ = crossing
    for name in ("nearest_root", "follow_root"):
        monkeypatch.setattr(module, name, lambda *_, **__: None)
    truth = _root(olne)
    assert predict(game, weights, truth, weights) == Prediction(None, False)


def test_where_the_published_step_fails_a_path_of_roots_is_followed(
    crossing: Crossing, olne: Equilibrium, other: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    game, weights, _ = crossing
    truth = _root(olne)
    expected = predict(game, other, truth, weights)
    assert expected.published and expected.root is not None

    def assert_same_root(published: bool, **options: int) -> None:
        prediction = predict(game, other, truth, weights, **options)
        assert prediction.published == published and prediction.root is not None
        np.testing.assert_allclose(prediction.root.states, expected.root.states, atol=1e-6)

    monkeypatch.setattr(module, "nearest_root", lambda *_, **__: None)
    assert_same_root(published=False)
    # Without iterations IPOPT has no say: the path from the true weights is the verdict.
    monkeypatch.delattr(module, "nearest_root")
    assert_same_root(published=True, max_iterations=0)
    monkeypatch.setattr(module, "follow_weights", lambda *_: None)
    assert not predict(game, other, truth, weights, max_iterations=0).published
