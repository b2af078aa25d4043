"""Constraints that hold unknown numbers: whose they are, and that solvers see the known game."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from olne_bench.games.compiled.elimination import elimination, interior_elimination
from olne_bench.games.model.constraints import Constraint, ControlBound, Distance
from olne_bench.games.model.costs import ControlEffort, FinalGoal, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.unknowns import Unknown
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.information import trajectory_sensitivity
from olne_bench.games.solve.newton import pack
from olne_bench.games.solve.olne import solve_olne

APART: Any = Unknown("distance", "m", 0.3, 0.7, 0.45, 0.1)
GENTLE: Any = Unknown("strongest", "m/s^2", 0.1, 0.5, 0.3, 0.1)
GOAL: Any = Unknown("goal", "m", 0.5, 1.5, 0.9, 0.3)
START = np.array([[-1.0, 0.0, 0.1, 0.3], [0.1, -1.0, 1.5, 0.25]])
WEIGHTS = np.array([[0.2, 0.3, 0.5], [0.3, 0.4, 0.3]])
TRUE = np.array([[1.0, 0.15], [0.5, np.nan]])  # goal and strongest; distance


def _game(*constraints: Constraint) -> Game:
    likes = (StateDeviation("speed", scale=0.1), ControlEffort("acceleration", 0.5))
    likes += (ControlEffort("yaw_rate", 0.1),)
    goals = ((cast(Any, GOAL), 0.0), (0.0, 1.0))
    players = tuple(
        Player(likes, (FinalGoal(goal, scale=1.0), ControlEffort("yaw_rate", 0.1)))
        for goal in goals
    )
    return Game(players, UNICYCLE, 12, 0.4, constraints)


ASKED = _game(Distance((1, 0), APART), ControlBound((0,), "acceleration", -0.2, GENTLE))


@pytest.fixture(scope="module")
def found() -> Equilibrium:
    solution = solve_olne(ASKED.known(TRUE), WEIGHTS, START)
    assert solution.certificate.passed
    assert solution.active[:, 0].any()
    assert solution.active[:, 2].any()
    return solution


def _theta(values: np.ndarray = TRUE) -> np.ndarray:
    return np.hstack([WEIGHTS, ASKED.parameters.standardised(values)])


def test_a_number_is_listed_once_with_the_first_player_of_its_first_constraint() -> None:
    names = [[one.name for one in own] for own in ASKED.parameters.unknowns]
    assert names == [["goal", "strongest"], ["distance"]]
    known = ASKED.known(TRUE)
    assert known.constraints[0] == Distance((1, 0), 0.5)
    assert known.constraints[1] == ControlBound((0,), "acceleration", -0.2, 0.15)
    assert not known.parameters.count
    both = _game(Distance((1, 0), APART), Distance((0, 1), APART, first_step=3))
    assert [len(own) for own in both.parameters.unknowns] == [1, 1]
    known = both.known(np.array([[1.0], [0.6]]))
    assert {cast(Distance, one).distance for one in known.constraints} == {0.6}
    assert ASKED.describe_unknown(1, 0) == (
        "the distance of constraint 'distance' of players 1 and 0"
    )
    assert ASKED.describe_unknown(0, 0) == "the goal of player 0"


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        (
            (Distance((0, 1), APART), Distance((1, 0), replace(APART, mean=0.5))),
            "'distance' of players 1 and 0: another constraint declares the unknown 'distance' "
            "differently",
        ),
        (
            (Distance((0, 1), replace(APART, name="goal")),),
            "a feature of player 0 and a constraint hold unknowns of the name 'goal'",
        ),
    ],
)
def test_what_could_be_two_numbers_is_refused(
    constraints: tuple[Constraint, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        _game(*constraints)


def test_ranges_are_checked_at_their_worst() -> None:
    with pytest.raises(ValueError, match=r"distance must be positive, got -0\.1"):
        Distance((0, 1), replace(APART, low=-0.1))
    with pytest.raises(ValueError, match=r"the range 0\.2 to 0\.1 has no width"):
        ControlBound((0,), "acceleration", 0.2, GENTLE)
    with pytest.raises(ValueError, match=r"distance must be from 0\.3 to 0\.7 m, got 0\.9"):
        ASKED.known(np.where(TRUE == 0.5, 0.9, TRUE))


def test_conditions_and_roots_are_those_of_the_known_game(found: Equilibrium) -> None:
    solver, known = elimination(ASKED), elimination(ASKED.known(TRUE))
    z = pack(ASKED, found.states, found.controls, found.costates, _theta())
    assert np.abs(solver.evaluate(z, _theta().ravel())).max() < 1e-6
    assert np.allclose(solver.evaluate(z, _theta().ravel()), known.evaluate(z, WEIGHTS.ravel()))
    other = np.array([[1.05, 0.17], [0.6, np.nan]])
    batch = solve_batch(ASKED, _theta(other)[None], found, _theta())
    assert batch.converged[0]
    alone = solve_olne(ASKED.known(other), WEIGHTS, START)
    assert alone.certificate.passed
    np.testing.assert_allclose(batch.states[0], alone.states, atol=1e-6)


def test_derivatives_in_theta_are_true() -> None:
    solver, h = elimination(ASKED), 1e-6
    theta, rng = _theta().ravel(), np.random.default_rng(0)
    z, d = 0.5 * rng.standard_normal((2, 12, solver.stages.size))
    end = solver.stages.num_states
    z[-1, end:] = d[-1, end:] = d[0, :end] = 0
    d_theta = rng.standard_normal(theta.size)
    multipliers = rng.standard_normal(z.shape)
    multipliers[0, :end] = multipliers[-1, end:] = 0
    solver.set_observations(np.full((12, solver.num_samples), np.nan))
    assert solver.linearise(z, theta)
    along = solver.sensitivities()[..., end:] @ d_theta  # keeps G = 0 as theta changes
    ahead, behind = (solver.evaluate(z + s * h * along, theta + s * h * d_theta) for s in (1, -1))
    solver.reduced_hessian(z, theta, multipliers)
    size = np.abs(along).max()
    assert np.abs((ahead - behind) / (2 * h)).max() < 1e-5 * max(1.0, size**2)

    def slope(sign: int) -> float:
        """The derivative of multipliers' G along (d, d_theta)."""
        point, at = z + sign * 1e-3 * d, theta + sign * 1e-3 * d_theta
        values = [solver.evaluate(point + k * 1e-4 * d, at + k * 1e-4 * d_theta) for k in (1, -1)]
        return float((multipliers * (values[0] - values[1])).sum() / 2e-4)

    product, product_theta = solver.hessian_product(d, d_theta)
    second = (slope(1) - slope(-1)) / 2e-3
    assert float((d * product).sum() + d_theta @ product_theta) == pytest.approx(second, rel=1e-3)


def test_sensitivities_are_those_of_differences(found: Equilibrium) -> None:
    columns = trajectory_sensitivity(ASKED, found.states, found.controls, found.costates, _theta())
    step, theta = 3e-6, _theta()  # far below the width of a kink, sqrt(RELAXATION)
    for place in (4, 8):  # strongest of player 0, distance
        both = []
        for sign in (1, -1):
            moved = theta.ravel().copy()
            moved[place] += sign * step
            batch = solve_batch(ASKED, moved.reshape(1, 2, -1), found, theta, tolerance=1e-13)
            both.append(batch.states[0])
        slope = (both[0] - both[1]).ravel() / (2 * step)
        assert np.abs(slope).max() > 1e-3
        np.testing.assert_allclose(columns[:, place], slope, atol=2e-3 * np.abs(slope).max())


def test_the_interior_point_method_needs_numbers() -> None:
    with pytest.raises(ValueError, match="'distance' of players 1 and 0 has unknowns: distance"):
        interior_elimination(ASKED)
    known, theta = ASKED.with_known_constraints(_theta())
    assert [[one.name for one in own] for own in known.parameters.unknowns] == [["goal"], []]
    assert theta.shape == (2, 4)
    assert interior_elimination(ASKED, known).margins(np.zeros((12, 20))).shape == (12, 3)
