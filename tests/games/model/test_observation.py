"""Observation models: geometry, bounds, derivatives, and the way back to states."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.estimators.shared.trajectory_fit import guess_states
from olne_bench.games.model.costs import ControlEffort
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import (
    VIEWS,
    ComponentView,
    FullView,
    NamedComponents,
    RangeBearingView,
    StackedView,
    View,
    WhitenedView,
    observation_function,
    observation_size,
    observe,
    stacked,
    whitening,
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


SCALE = np.array([1.0, 2.0, 0.1, 0.5])


def test_noise_has_the_scale_of_what_is_seen():
    np.testing.assert_array_equal(FullView().noise_scale(SCALE, UNICYCLE), SCALE)
    view = ComponentView("x", ("speed", "px"))
    np.testing.assert_array_equal(view.noise_scale(SCALE, UNICYCLE), [0.5, 1.0])
    lidar = RangeBearingView(bearing_scale=0.25)
    np.testing.assert_array_equal(lidar.noise_scale(SCALE, UNICYCLE), [2.0, 0.5])
    own = View.noise_scale(view, SCALE, UNICYCLE)  # of views that do not say
    np.testing.assert_array_equal(own, [1.0, 1.0])


def test_components_are_read_off_by_their_names():
    y = np.arange(8.0).reshape(2, 4)
    read = FullView().read_off(y, UNICYCLE)
    assert list(read) == list(UNICYCLE.state_names)
    np.testing.assert_array_equal(read["speed"], y[:, 3])
    view = ComponentView("x", ("speed", "px"))
    assert view.component_names(UNICYCLE) == ("speed", "px")
    read = view.read_off(y[:, :2], UNICYCLE)
    assert {name: values.tolist() for name, values in read.items()} == {
        "speed": [0, 4],
        "px": [1, 5],
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": (1.0,)},
        {"position": (1.0, np.nan)},
        {"facing": np.inf},
        {"bearing_scale": 0.0},
        {"bearing_scale": -0.1},
        {"bearing_scale": np.inf},
    ],
)
def test_a_lidar_stands_somewhere_and_has_noise(wrong):
    with pytest.raises(
        ValueError, match=r"position must be px and py|bearing_scale must be above 0"
    ):
        RangeBearingView(**wrong)


def test_the_usual_lidar_stands_at_the_origin_and_faces_along_x():
    view = RangeBearingView()
    np.testing.assert_allclose(observe(view, UNICYCLE, np.array([3.0, 4.0, 0, 0]))[0], 5.0)
    np.testing.assert_allclose(observe(view, UNICYCLE, np.array([3.0, 0.0, 0, 0]))[1], 0.0)
    low, high = view.bounds(np.array([-3.0, -4, 0, 0]), np.array([1.0, 1, 0, 0]), UNICYCLE)
    np.testing.assert_allclose([low, high], [[0, -np.pi], [5, np.pi]])


TURNED = StackedView((ComponentView("turned", ("heading", "py", "px")), LIDAR))


def test_a_view_looks_at_what_the_one_below_shows():
    states = np.random.default_rng(0).normal(size=(6, 4))
    assert TURNED.name == "turned+range_bearing"
    np.testing.assert_allclose(observe(TURNED, UNICYCLE, states), observe(LIDAR, UNICYCLE, states))
    assert TURNED.component_names(UNICYCLE) == ("range", "bearing")
    np.testing.assert_array_equal(
        TURNED.noise_scale(SCALE, UNICYCLE), LIDAR.noise_scale(SCALE, UNICYCLE)
    )
    limits = np.array([[-1.0, -2, -3, -4], [1, 2, 3, 4]])
    for one, other in zip(
        TURNED.bounds(*limits, UNICYCLE), LIDAR.bounds(*limits, UNICYCLE), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    blind = StackedView((ComponentView("blind", ("px", "speed")), LIDAR))
    with pytest.raises(ValueError, match="no component 'py' here; there are: px, speed"):
        observe(blind, UNICYCLE, states)


def test_what_a_stack_hides_is_not_read_off():
    states = np.random.default_rng(1).normal(size=(3, 2, 4))
    read = TURNED.read_off(observe(TURNED, UNICYCLE, states), UNICYCLE)
    assert set(read) == {"px", "py"}
    np.testing.assert_allclose(read["px"], states[..., 0])
    np.testing.assert_allclose(read["py"], states[..., 1])
    distance = StackedView((LIDAR, ComponentView("distance", ("range",))))
    assert distance.read_off(np.ones((3, 1)), UNICYCLE) == {}
    names = StackedView((VIEWS["partial"], ComponentView("x", ("heading", "px"))))
    y = observe(names, UNICYCLE, states)
    y[0, 0] = np.nan  # a gap is one, and the component is known all the same
    read = names.read_off(y, UNICYCLE)
    assert set(read) == {"heading", "px"}
    np.testing.assert_array_equal(read["heading"][1:], states[1:, :, 2])
    assert np.isnan(read["px"][0, 0])


def test_stacks_are_as_small_as_they_can_be():
    partial = VIEWS["partial"]
    assert stacked([]) == FullView()
    assert stacked([FullView(), FullView()]) == FullView()
    assert stacked([FullView(), partial]) is partial
    assert stacked([partial, FullView(), LIDAR]) == StackedView((partial, LIDAR))


@pytest.mark.parametrize("seed", range(3))
def test_whitening_makes_noise_independent_and_of_unit_scale(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3))
    covariance = root @ root.T + 0.1 * np.eye(3)
    matrix = whitening(covariance)
    np.testing.assert_allclose(matrix @ covariance @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.triu(matrix, 1), 0, atol=1e-12)
    view = WhitenedView(VIEWS["partial"], tuple(map(tuple, matrix)))
    assert view.name == "partial"
    states = np.random.default_rng(seed).normal(size=(5, 4))
    y = observe(view, UNICYCLE, states)
    np.testing.assert_allclose(y, states[:, :3] @ matrix.T, atol=1e-12)
    read = view.read_off(y, UNICYCLE)
    np.testing.assert_allclose(np.column_stack(list(read.values())), states[:, :3], atol=1e-9)


@pytest.mark.parametrize(
    ("covariance", "said"),
    [
        ([1.0, 2.0], "is a square matrix"),
        ([[1.0, 0.0]], "is a square matrix"),
        ([[1.0, 0.5], [0.4, 1.0]], "finite and symmetric"),
        ([[np.nan, 0.0], [0.0, 1.0]], "finite and symmetric"),
        ([[1.0, 1.0], [1.0, 1.0]], "positive definite"),
        ([[1.0, 0.0], [0.0, -1.0]], "positive definite"),
        ([[0.0, 0.0], [0.0, 0.0]], "positive definite"),
        ([[1.0, 0.0], [0.0, 1e-13]], "positive definite"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance, said):
    with pytest.raises(ValueError, match=said):
        whitening(covariance)
    assert whitening([[1.0, 0.0], [0.0, 1e-11]]).shape == (2, 2)  # small, but not too small


def test_solvers_find_views_again_by_what_they_are():
    assert observation_function(RangeBearingView(), UNICYCLE) is observation_function(
        RangeBearingView(), UNICYCLE
    )
    assert NamedComponents(("a", "b")).state_size == 2
    assert set(VIEWS) == {"full", "partial"}
    assert observation_size(VIEWS["partial"], UNICYCLE) == 3
