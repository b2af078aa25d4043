"""Observation models: geometry, bounds, derivatives, and the way back to states."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.estimators.trajectory_fit import guess_states
from olne_bench.games.dynamics import DOUBLE_INTEGRATOR, UNICYCLE
from olne_bench.games.features import ControlEffort
from olne_bench.games.game import Game, Player
from olne_bench.games.observation import (
    VIEWS,
    ComponentView,
    FullView,
    RangeBearingView,
    View,
    observation_function,
    observation_size,
    observe,
)

coordinate = st.floats(-50, 50)
angle = st.floats(-3.1, 3.1)
LIDAR = RangeBearingView((1.0, -2.0), facing=0.5)


def test_range_and_bearing_by_hand():
    view = RangeBearingView((1.0, 2.0), facing=np.pi / 2)
    states = np.array([[1.0, 5.0, 0, 0], [-1.0, 2.0, 0, 0], [4.0, 2.0, 0, 0]])
    expected = [[3, 0], [2, np.pi / 2], [3, -np.pi / 2]]  # ahead, to the left, to the right
    assert np.allclose(observe(view, UNICYCLE, states), expected)


@given(coordinate, coordinate, coordinate, coordinate, angle)
def test_range_and_bearing_lead_back_to_the_position(px, py, x, y, facing):
    view = RangeBearingView((x, y), facing)
    seen = observe(view, UNICYCLE, np.array([px, py, 0.3, 1.0]))
    assert abs(seen[1]) <= np.pi
    back = view.read_off(seen, UNICYCLE)
    assert back["px"] == pytest.approx(px, abs=1e-9)
    assert back["py"] == pytest.approx(py, abs=1e-9)


@pytest.mark.parametrize("view", [*VIEWS.values(), ComponentView("x", ("speed", "px")), LIDAR])
@pytest.mark.parametrize("seed", range(3))
def test_bounds_hold_for_every_state_within_bounds(view, seed):
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.normal(scale=10, size=(2, 4)), axis=0)
    states = rng.uniform(low, high, size=(500, 4))
    states[:4, :2] = [(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])]
    seen = observe(view, UNICYCLE, states)
    lower, upper = view.bounds(low, high, UNICYCLE)
    assert seen.shape[-1] == len(lower) == len(view.component_names(UNICYCLE))
    assert (seen >= lower - 1e-12).all()
    assert (seen <= upper + 1e-12).all()


def test_derivative_of_range_and_bearing():
    function = observation_function(LIDAR, UNICYCLE)
    state = ca.SX.sym("x", 4)
    jacobian = ca.Function("J", [state], [ca.jacobian(function(state), state)])
    at = np.array([3.0, 4.0, 0.1, 2.0])
    step = 1e-6
    numeric = np.column_stack(
        [
            (observe(LIDAR, UNICYCLE, at + h) - observe(LIDAR, UNICYCLE, at - h)) / (2 * step)
            for h in step * np.eye(4)
        ]
    )
    assert np.allclose(np.array(jacobian(at)), numeric, atol=1e-8)


def test_a_component_that_is_not_there():
    with pytest.raises(ValueError, match=r"'partial'.*'heading'.*px, py, vx, vy"):
        observe(VIEWS["partial"], DOUBLE_INTEGRATOR, np.zeros(4))


def test_a_view_of_ones_own_needs_one_method():
    class Product(View):
        name = "product"

        def expected(self, state, dynamics):
            return ca.vertcat(state[0] * state[1])

    view = Product()
    assert observation_size(view, UNICYCLE) == 1
    assert view.component_names(UNICYCLE) == ("product_0",)
    assert observe(view, UNICYCLE, np.full((2, 3, 4), 2.0)).tolist() == [[[4.0]] * 3] * 2
    low, high = view.bounds(np.zeros(4), np.ones(4), UNICYCLE)
    assert (low.item(), high.item()) == (-np.inf, np.inf)
    assert view.read_off(np.zeros((5, 2, 1)), UNICYCLE) == {}


@pytest.mark.parametrize("view", [FullView(), VIEWS["partial"], LIDAR])
def test_solvers_start_near_the_truth(view):
    """A car on a circle, seen through each view: guessed states equal the true ones."""
    game = Game((Player((ControlEffort("yaw_rate"),)),), UNICYCLE, horizon=40, dt=0.1)
    heading = 2.9 + 0.05 * np.arange(40)  # across the branch cut of atan2
    position = np.cumsum(0.1 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    position = np.vstack([[0, 0], position[:-1]]) + np.array([4.0, 3.0])
    states = np.column_stack([position, heading, np.ones(40)])[:, None]
    y = observe(view, UNICYCLE, states)
    y[7] = np.nan
    guess = guess_states(game, view, y)
    assert np.abs(guess[:-1] - states[:-1]).max() < 0.06
