"""Better responses far from an equilibrium: known ones are found, and nothing where nothing is."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario, intersection, roundabout
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve import olne
from olne_bench.games.solve.far_search import control_units, far_responses
from olne_bench.games.solve.newton import Root, newton_root, rows
from olne_bench.games.solve.olne import Equilibrium, certify, iterated_best_response, solve_olne
from tests.games.conftest import GoalGame

LONG = pytest.mark.long
ROADS = {"intersection": intersection.propose, "roundabout": roundabout.propose}


def solved(name: str, seed: int, **options: int) -> tuple[Game, np.ndarray, Equilibrium]:
    """Game, weights and first equilibrium; on roads of a proposal, without the simulator."""
    if name in ROADS:
        players, attempt = options["num_players"], options["attempt"]
        scenario = ROADS[name](np.random.default_rng([seed, players, attempt]), players)
    else:
        scenario = get_scenario(name, seed, **options)
    found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    return scenario.game, scenario.weights, found


@pytest.mark.parametrize(
    ("name", "seed", "options", "player", "gain"),
    [
        ("random", 5, {}, 1, 0.32),
        ("random", 22, {}, 2, 0.025),
        ("random", 43, {}, 1, 0.066),
        ("random", 0, {"num_players": 3}, 0, 0.0028),
        ("random", 5, {"num_players": 3}, 0, 0.0217),
        *[
            pytest.param(name, seed, {"num_players": 3, "attempt": k}, i, gain, marks=[LONG])
            for name, seed, k, i, gain in (
                ("roundabout", 3, 1, 1, 0.074),
                ("roundabout", 17, 0, 1, 0.079),
                ("roundabout", 18, 1, 1, 0.0255),
                ("intersection", 7, 1, 1, 0.404),
            )
        ],
    ],
)
def test_known_better_responses_are_found(
    name: str, seed: int, options: dict[str, int], player: int, gain: float
) -> None:
    """Games whose first equilibrium leaves a player much to gain, relative to 1 + |J|."""
    game, weights, found = solved(name, seed, **options)
    certificate = certify(game, found, weights, search_far=True)
    assert certificate.local.passed
    assert certificate.global_so_far is not None
    assert not certificate.global_so_far.passed and not certificate.passed
    relative = certificate.gains / (1 + np.abs(certificate.costs))
    assert relative.argmax() == player
    assert relative[player] > 0.99 * gain

    better = solve_olne(game, weights, found.states[0], search_far=True)
    assert better.certificate.passed and better.residual < 1e-9
    assert np.abs(better.states - found.states).max() > 0.01


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_published_truths_have_no_better_response(name: str) -> None:
    scenario = get_scenario(name)
    arguments = scenario.game, scenario.weights, scenario.initial_state
    near, far = solve_olne(*arguments), solve_olne(*arguments, search_far=True)
    assert near.certificate.passed and near.certificate.global_so_far is None
    assert far.certificate.passed and far.certificate.global_so_far is not None
    for array in ("states", "controls", "costates"):
        assert getattr(near, array).tobytes() == getattr(far, array).tobytes()


@pytest.fixture(scope="module")
def detour(goal_game: GoalGame) -> tuple[Game, np.ndarray, dict[str, Root]]:
    """Player 0 passes player 1, which stays a little to the right of its way, on either side.

    Both are local equilibria; on the left the way is shorter.
    """
    game = goal_game(np.array([[1.0, 0.0], [0.0, -0.1]]), horizon=12)
    weights = game.check_weights(np.array([[4, 1, 1, 1], [0.01, 1, 4, 4]]))
    initial_state = np.array([[-1, 0, 0, 0.3], [0, -0.1, np.pi / 2, 0]])
    roots = {}
    for side, sign in (("left", 1), ("right", -1)):
        plan = np.zeros(game.control_shape)
        plan[:, 0, 0] = sign * np.where(np.arange(11) < 5, 0.5, -0.5)
        start = iterated_best_response(game, weights, initial_state, plan)
        roots[side] = newton_root(game, start.states, start.controls, start.costates, weights)
    return game, weights, roots


def test_a_second_basin_is_found_from_the_worse_side_only(
    detour: tuple[Game, np.ndarray, dict[str, Root]],
) -> None:
    game, weights, roots = detour
    left, right = (certify(game, roots[side], weights, search_far=True) for side in roots)
    assert roots["left"].states[6, 0, 1] > 0.4 and roots["right"].states[6, 0, 1] < -0.4
    assert left.passed
    assert right.local.passed and right.global_so_far is not None
    assert not right.global_so_far.passed
    # Player 1 hardly moves, so the gain is the difference of both equilibria.
    difference = right.costs[0] - left.costs[0]
    assert right.global_so_far.values[0] == pytest.approx(difference, rel=0.02)
    assert right.global_so_far.values[1] <= 1e-7
    assert (right.gains == right.global_so_far.values).any()


def test_the_better_response_is_a_motion_with_that_cost(
    detour: tuple[Game, np.ndarray, dict[str, Root]],
) -> None:
    game, weights, roots = detour
    root = roots["right"]
    found = far_responses(game, root.states, root.controls, weights)
    for player in range(game.num_players):
        controls = root.controls.copy()
        controls[:, player] = found.controls[:, player]
        states = rollout(game.dynamics, root.states[0], controls, game.dt)
        z = rows(game, states, controls, root.costates)
        cost = elimination(game).costs(z, weights.ravel())[player]
        assert cost == pytest.approx(found.costs[player], abs=1e-12)


@pytest.mark.parametrize("count", [1, 2])
def test_players_that_ignore_each_other_have_nothing_to_gain(
    detour: tuple[Game, np.ndarray, dict[str, Root]], count: int
) -> None:
    game, weights, roots = detour
    game = replace(game, players=game.players[:count])
    weights = weights[:count] * [0, 1, 1, 1]  # no proximity
    found = solve_olne(game, weights, roots["left"].states[0, :count], search_far=True)
    far = found.certificate.global_so_far
    assert found.certificate.passed and far is not None
    assert np.abs(far.values).max() < 1e-9
    # The plan without coupling, 16 held ones, and four passes of each other player.
    np.testing.assert_array_equal(far.starts, 17 + 4 * (count - 1))


def test_the_search_is_deterministic(detour: tuple[Game, np.ndarray, dict[str, Root]]) -> None:
    game, weights, roots = detour
    root = roots["right"]
    found = []
    for seed in (0, 1):
        np.random.seed(seed)  # noqa: NPY002 (nothing may depend on it)
        found.append(far_responses(game, root.states, root.controls, weights))
    assert found[0].costs.tobytes() == found[1].costs.tobytes()
    assert found[0].controls.tobytes() == found[1].controls.tobytes()


def test_renaming_players_renames_the_gains() -> None:
    game, weights, found = solved("random", 43)
    gains = certify(game, found, weights, search_far=True).gains
    assert gains.max() > 0.05
    for order in ([1, 2, 0], [0, 2, 1]):
        renamed = replace(game, players=tuple(game.players[i] for i in order))
        root = Root(found.states[:, order], found.controls[:, order], found.costates[:, order], 0.0)
        other = certify(renamed, root, weights[order], search_far=True)
        np.testing.assert_allclose(other.gains, gains[order], atol=1e-6)


def test_units_move_a_player_by_its_path() -> None:
    game, _, found = solved("two_player", 0)
    units = control_units(game, found.states, found.controls, 0)
    path = found.states[:, 0, :2]
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    for k, unit in enumerate(units):
        controls = found.controls.copy()
        controls[:, 0, k] += 1e-3 * unit
        moved = rollout(game.dynamics, found.states[0], controls, game.dt)[:, 0, :2] - path
        assert np.linalg.norm(moved, axis=1).max() == pytest.approx(1e-3 * length, rel=0.01)


def test_a_player_that_stands_still_has_no_units() -> None:
    game = get_scenario("two_player").game
    states = np.zeros(game.state_shape)
    assert (control_units(game, states, np.zeros(game.control_shape), 0) == 0).all()


def test_better_responses_are_not_followed_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """Then the first equilibrium is returned, with what was found there."""
    game, weights, found = solved("random", 43)
    monkeypatch.setattr(olne, "_MOST_EQUILIBRIA", 1)
    given_up = solve_olne(game, weights, found.states[0], search_far=True)
    np.testing.assert_array_equal(given_up.states, found.states)
    certificate = given_up.certificate
    assert certificate.local.passed and not certificate.passed
    assert certificate.gains.argmax() == 1
    told = str(certificate)
    assert told.startswith("local: passed, 6 first plans, largest gain ")
    assert "; global so far: failed, 75 first plans, largest gain 1.0e-01 of player 1" in told


def test_what_is_no_root_is_not_searched() -> None:
    game, weights, found = solved("two_player", 0)
    root = Root(found.states, found.controls, found.costates, residual=1.0)
    certificate = certify(game, root, weights, search_far=True)
    assert certificate.global_so_far is None and not certificate.passed
    assert "local: failed, no root" in str(certificate)
    assert "global so far: not searched" in str(certificate)
