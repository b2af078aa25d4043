"""Variational equilibria: the definitions hold, and IPOPT on the potential agrees."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from olne_bench.envs.scenarios.merging import Merging, scenario, touching
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.games.compiled.elimination import interior_elimination
from olne_bench.games.model.constraints import (
    Constraint,
    ControlBound,
    Distance,
    RoadEdge,
    StateBound,
)
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.constrained import check_start
from olne_bench.games.solve.newton import newton_root, rows
from olne_bench.games.solve.olne import certify, solve_olne

ROOT = Path(__file__).parents[3]
NOMINAL_COSTS = (2.890e-4, 1.285e-4, 6.677e-3)


def _crossing(*constraints: Constraint, proximity: bool = True) -> Game:
    """Two vehicles cross; with proximity, costs look at the other and there is no potential."""
    players = []
    for direction in (0.0, np.pi / 2):
        goal = FinalGoal((float(np.cos(direction)), float(np.sin(direction))), scale=10.0)
        likes = (StateDeviation("speed"), ControlEffort("acceleration", 10.0))
        likes += (ControlEffort("yaw_rate"),)
        players.append(Player((*((Proximity(),) if proximity else ()), *likes), (goal,)))
    return Game(tuple(players), UNICYCLE, 25, 0.25, constraints)


def _start() -> np.ndarray:
    angles = np.array([0.0, np.pi / 2])
    offset = angles + np.deg2rad([10, 12])
    return np.column_stack([-np.cos(angles), -np.sin(angles), offset, np.full(2, 0.1)])


def _stationarity(game: Game, weights: np.ndarray, found: Equilibrium) -> float:
    """Largest error of G - J' v."""
    solver = interior_elimination(game)
    pushed = solver.push(
        rows(game, found.states, found.controls, found.costates), found.multipliers
    )
    costates = found.costates + pushed[1:, : found.states[0].size].reshape(found.costates.shape)
    z = rows(game, found.states, found.controls, costates)
    error = solver.evaluate(z, weights.ravel()) - solver.push(z, found.multipliers)
    error[0, : solver.stages.num_states] = 0
    return float(np.abs(error).max())


def test_nominal_merging_has_the_published_costs() -> None:
    drawn = Merging().draw()
    found = solve_olne(drawn.game, drawn.weights, drawn.initial_state)
    assert found.certificate.passed
    assert found.certificate.costs == pytest.approx(NOMINAL_COSTS, rel=3e-4)
    assert found.active.any()
    assert found.certificate.violation <= 1e-8


@pytest.mark.parametrize("players", [3, 4])
def test_merging_agrees_with_the_oracle(players: int) -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "constrained_games.py"))
    rows, _ = script["rows"](6, players)
    for row in rows:
        assert row.certified, row
        assert row.violation <= 1e-8, row
        assert row.as_good, row


@pytest.mark.parametrize("proximity", [True, False])
def test_definitions_hold_under_shared_and_private_constraints(proximity: bool) -> None:
    game = _crossing(
        Distance((0, 1), 0.5),
        ControlBound((0,), "acceleration", -0.05, 0.05),
        StateBound((1,), "speed", upper=0.4),
        RoadEdge((1,), (0.02, 0.0), (-1.0, 0.0)),
        proximity=proximity,
    )
    weights = game.check_weights(np.ones((2, game.num_weights)))
    found = solve_olne(game, weights, _start())
    assert found.certificate.passed, found.certificate
    assert found.margins.min() >= -1e-8
    assert found.multipliers.min() >= 0
    assert (found.multipliers * np.where(np.isfinite(found.margins), found.margins, 0)).max() < 1e-8
    assert _stationarity(game, weights, found) < 1e-8
    assert found.active[:, 0].any()  # the distance is
    assert found.active[:, 1:].any()


def test_where_nothing_touches_it_is_an_equilibrium_of_the_free_game() -> None:
    free, wide = _crossing(), _crossing(Distance((0, 1), 0.05), StateBound((0,), "speed", -9.0))
    weights = np.full((2, 4), 0.25)
    found = solve_olne(wide, weights, _start())
    assert found.certificate.passed
    assert not found.active.any()
    root = newton_root(free, found.states, found.controls, found.costates, weights)
    assert certify(free, root, weights).passed
    assert np.abs(root.states - found.states).max() < 1e-5


def test_a_start_in_collision_is_refused_in_one_line() -> None:
    start = np.array([[0.0, 0, 0, 0.6], [0.1, 0, 0, 0.6], [0, -0.5, 0, 0.6]])
    message = "'distance' of players 0 and 1 is broken after the first step"
    with pytest.raises(ValueError, match=message):
        check_start(scenario(start).game, start)
    assert touching(start) == "players 0 and 1 touch at the start: 0.100 m apart"
    game = _crossing(StateBound((1,), "speed", 0.2))
    with pytest.raises(ValueError, match="'speed' of player 1 is broken at the start"):
        solve_olne(game, np.ones((2, 4)), _start())


def test_infeasible_draws_say_so() -> None:
    feasible = 0
    for seed in range(1, 101):
        try:
            Merging().draw(seed)
            feasible += 1
        except NoEquilibriumError as error:
            assert f"draw {seed} of merging is infeasible: players" in str(error)
    assert 70 <= feasible <= 90


def test_condensed_constraints_are_derivatives_of_what_they_push() -> None:
    game = _crossing(
        Distance((1, 0), 0.5),
        ControlBound((0,), "yaw_rate", -1.0, 1.0),
        StateBound((1,), "py", upper=2.0),
    )
    native = interior_elimination(game)
    rng = np.random.default_rng(0)
    z = rng.standard_normal((25, native.stages.size))
    v, sigma = rng.uniform(size=(2, 25, native.stages.num_margins))
    right = rng.standard_normal(z.shape)
    right[0, : native.stages.num_states] = 0
    right[-1, native.stages.num_states :] = 0
    theta = np.full(8, 0.25)
    assert not native.linearise_condensed(z, theta, v, -1e4 * sigma, 0.0)
    assert native.linearise_condensed(z, theta, v, sigma, 300.0)
    step, h = native.solve(right), 1e-6
    slope = (native.margins(z + h * step) - native.margins(z - h * step)) / (2 * h)
    assert np.allclose(native.change(z, step), slope, atol=1e-6)
    assert np.isclose((native.push(z, v) * step).sum(), (v * slope).sum())

    def pushed(sign: int) -> np.ndarray:
        """G - J' v to one side along the step."""
        point = z + sign * h * step
        return native.evaluate(point, theta) - native.push(point, v)

    found = (pushed(1) - pushed(-1)) / (2 * h) + native.push(z, sigma * slope)
    inner = native.stages.num_states + native.stages.num_controls
    found[:, :inner] += 300 * step[:, :inner]
    found[0, : native.stages.num_states] = 0
    assert np.allclose(found, right, atol=1e-4)
