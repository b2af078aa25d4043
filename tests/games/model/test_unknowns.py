"""Games with unknown numbers: what they declare, and that solvers see the game they stand for."""

from dataclasses import replace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.shared.interior_point import joint_elimination
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.costs import FinalGoal, StateDeviation
from olne_bench.games.model.game import Game, player_cost
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.model.simplex import theta_tangent
from olne_bench.games.model.unknowns import Unknown, unknowns_of
from olne_bench.games.solve.information import deviations_of, of_weights

SPEED = Unknown("target speed", "m/s", -1.0, 2.0, 0.5, 0.4)


def asked(*, ragged: bool = False) -> Game:
    """The two-player game with goals of both players, and a speed of the first, unknown."""
    game = get_scenario("unknown_goals", 1).told
    first, second = game.players
    preferences = tuple(
        replace(one, target=cast(Any, SPEED)) if isinstance(one, StateDeviation) else one
        for one in first.preferences
    )
    players = (replace(first, preferences=preferences), second) if ragged else (first, second)
    return replace(game, players=players)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"low": 2.0}, "the range from 2.0 to 2.0 m/s has no width"),
        ({"high": -3.0}, "the range from -1.0 to -3.0 m/s has no width"),
        ({"mean": 2.5}, "the mean 2.5 is not within the range from -1.0 to 2.0 m/s"),
        ({"deviation": 0.0}, "the deviation must be positive, got 0.0"),
        ({"mean": float("nan")}, "mean must be finite, got nan"),
        ({"high": float("inf")}, "high must be finite, got inf"),
    ],
)
def test_what_is_no_range_or_prior_is_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        replace(SPEED, **change)
    assert "'target speed'" in str(caught.value)


def test_unknowns_of_one_name_are_one_number() -> None:
    one, other = StateDeviation("px", cast(Any, SPEED)), StateDeviation("py", cast(Any, SPEED))
    assert unknowns_of((one, other)) == (SPEED,)
    with pytest.raises(ValueError, match="'target speed' of a player is declared twice"):
        unknowns_of((one, replace(other, target=cast(Any, replace(SPEED, mean=0.6)))))


def test_a_game_lists_its_unknowns_and_becomes_known() -> None:
    game = asked(ragged=True)
    assert [len(own) for own in game.parameters.unknowns] == [3, 2]
    assert game.parameters.count == 3
    assert game.parameters.used.tolist() == [[True] * 3, [True, True, False]]
    values = np.array([[0.4, 1.1, -0.1], [0.05, 0.95, np.nan]])
    known = game.known(values)
    assert known.parameters.count == 0
    assert known.players[0].preferences[1] == StateDeviation("speed", target=0.4)
    (goal,) = known.players[1].task
    assert isinstance(goal, FinalGoal)
    assert goal.goal == (0.05, 0.95)
    round_trip = game.parameters.values(game.parameters.standardised(values))
    np.testing.assert_allclose(round_trip, values)
    for bad, message in ((3.0, r"player 0: target speed must be from -1.0 to 2.0 m/s, got 3.0"),):
        with pytest.raises(ValueError, match=message):
            game.known(np.where(values == 0.4, bad, values))
    with pytest.raises(ValueError, match=r"shape \(2, 2\), expected \(2, 3\)"):
        game.known(values[:, :2])


def test_costs_of_unknowns_are_refused() -> None:
    states = [[ca.SX.sym("x", 4) for _ in range(2)] for _ in range(3)]
    with pytest.raises(ValueError, match=r"player 0 has unknowns \(goal x, goal y\)"):
        player_cost(asked(), 0, states, [ca.SX.sym("u", 2)] * 2, ca.SX.sym("w", 4))


def point_of(game: Game) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A random trajectory (T, size), theta and the parameters in their units."""
    rng = np.random.default_rng(3)
    solver = elimination(game)
    z = rng.standard_normal((game.horizon, solver.stages.size))
    z[-1, solver.stages.num_states :] = 0.0
    standardised = np.where(game.parameters.used, rng.uniform(-1, 1, (2, game.parameters.count)), 0)
    theta = np.hstack([rng.dirichlet(np.ones(4), 2), standardised])
    return z, theta, game.parameters.values(standardised)


@pytest.mark.parametrize("ragged", [False, True])
def test_conditions_are_those_of_the_known_game(ragged: bool) -> None:
    game = asked(ragged=ragged)
    z, theta, values = point_of(game)
    solver, known = elimination(game), elimination(game.known(values))
    expected = known.evaluate(z, theta[:, :4].ravel())
    np.testing.assert_allclose(solver.evaluate(z, theta.ravel()), expected, atol=1e-10)


@pytest.mark.parametrize("ragged", [False, True])
def test_second_derivatives_are_those_of_differences(ragged: bool) -> None:
    game, view = asked(ragged=ragged), VIEWS["partial"]
    z, theta, _ = point_of(game)
    rng = np.random.default_rng(4)
    multipliers = rng.standard_normal(z.shape)
    multipliers[0, : 2 * 4] = 0.0  # x_1 is given and has no condition
    solver = joint_elimination(game, view)
    solver.set_observations(np.zeros((game.horizon, 6)), np.ones(6))
    assert solver.linearise(z, theta.ravel())
    solver.sensitivities()
    solver.reduced_hessian(z, theta.ravel(), multipliers)
    _, product = solver.hessian_product(np.zeros_like(z), rng_like(theta))

    def slope(shift: float) -> np.ndarray:
        moved = theta.ravel() + shift * rng_like(theta)
        return np.sum(multipliers * solver.evaluate(z, moved))

    step = 1e-3
    second = (slope(step) - 2 * slope(0) + slope(-step)) / step**2
    assert rng_like(theta) @ product == pytest.approx(second, rel=1e-3, abs=1e-3)


def rng_like(theta: np.ndarray) -> np.ndarray:
    """A direction of theta, the same in every call."""
    return np.random.default_rng(5).standard_normal(theta.size)


def test_the_tangent_leaves_out_what_stands_for_nothing() -> None:
    game = asked(ragged=True)
    tangent = theta_tangent(game.num_weights, game.parameters.used)
    assert tangent.shape == (2 * 7, 2 * 3 + 5)
    weights = tangent.reshape(2, 7, -1)[:, :4]
    np.testing.assert_allclose(weights.sum(axis=1), 0, atol=1e-12)
    assert not tangent.reshape(2, 7, -1)[1, 6].any()


def test_a_covariance_is_split_into_weights_and_parameters() -> None:
    game = asked(ragged=True)
    covariance = np.diag(np.arange(14.0))
    weights = of_weights(game, covariance)
    assert weights is not None
    assert np.diag(weights).tolist() == [0, 1, 2, 3, 7, 8, 9, 10]
    deviations = deviations_of(game, covariance)
    assert deviations is not None
    expected = np.sqrt([[4, 5, 6], [11, 12, 13]]) * [[0.4, 0.2, 0.2], [0.2, 0.2, np.nan]]
    np.testing.assert_allclose(deviations, expected)
    assert of_weights(game, None) is None
    assert deviations_of(game.at_means, covariance) is None
