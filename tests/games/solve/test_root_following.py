"""Roots at other weights, followed from a known one."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.game import Game
from olne_bench.games.solve import root_following
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import solve_olne

WEIGHTS = np.array([[0.2, 0.3, 0.3, 0.2], [0.3, 0.3, 0.2, 0.2]])
HOPELESS = np.array([[1.0, 0, 0, 0]] * 2)  # players only avoid each other, at any speed

Known = tuple[Game, Root, np.ndarray]


@pytest.fixture(scope="module")
def known() -> Known:
    scenario = get_scenario("two_player")
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    root = Root(found.states, found.controls, found.costates, found.residual)
    return scenario.game, root, scenario.weights


def test_the_path_leads_to_the_equilibrium_at_other_weights(known: Known) -> None:
    game, root, weights = known
    followed = root_following.follow_weights(game, root, weights, WEIGHTS)
    assert followed is not None
    alone = solve_olne(game, WEIGHTS, root.states[0])
    np.testing.assert_allclose(followed.states, alone.states, atol=1e-7)


@pytest.mark.parametrize(
    "switched_off", [(), ("follow_weights",)], ids=["path", "independent players"]
)
def test_where_one_way_is_lost_the_next_is_tried(
    known: Known, switched_off: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    game, root, weights = known
    for name in switched_off:
        monkeypatch.setattr(root_following, name, lambda *_: None)
    followed = root_following.follow_root(game, root, weights, WEIGHTS)
    assert followed is not None
    assert followed.residual < 1e-8
    np.testing.assert_array_equal(followed.states[0], root.states[0])


def test_no_root_is_none(known: Known) -> None:
    game, root, weights = known
    assert root_following.follow_root(game, root, weights, HOPELESS) is None


def test_coasting_leads_where_the_known_controls_do_not(known: Known) -> None:
    """An estimate of the paper's study, beyond a fold of the roots that lead from the truth."""
    game, root, weights = known
    other = game.check_weights(np.array([[0.09, 0.10, 0.60, 0.21], [0.35, 0.37, 0.07, 0.21]]))
    first = root.states[0]
    assert root_following.follow_weights(game, root, weights, other) is None
    assert root_following.from_independent_players(game, first, root.controls, other) is None
    followed = root_following.follow_root(game, root, weights, other)
    assert followed is not None
    expected = solve_olne(game, other, first)
    assert expected.certificate.passed
    np.testing.assert_allclose(followed.states, expected.states, atol=1e-7)
