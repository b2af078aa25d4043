import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, UNICYCLE, Dynamics, bicycle, rollout

NUMBERS = st.floats(-5, 5)


def step(dynamics: Dynamics, state: np.ndarray, control: np.ndarray, dt: float) -> np.ndarray:
    return np.array(ca.DM(dynamics.step(ca.DM(state), ca.DM(control), dt))).ravel()


@given(arrays(float, 4, elements=NUMBERS), arrays(float, 2, elements=NUMBERS), st.floats(0.01, 2))
def test_unicycle_is_the_papers_map(state: np.ndarray, control: np.ndarray, dt: float) -> None:
    px, py, heading, speed = state
    yaw_rate, acceleration = control
    expected = [
        px + dt * speed * np.cos(heading),
        py + dt * speed * np.sin(heading),
        heading + dt * yaw_rate,
        speed + dt * acceleration,
    ]
    np.testing.assert_allclose(step(UNICYCLE, state, control, dt), expected, atol=1e-12)


@given(arrays(float, 4, elements=NUMBERS), arrays(float, 2, elements=NUMBERS), st.floats(0.01, 2))
def test_double_integrator_is_linear(state: np.ndarray, control: np.ndarray, dt: float) -> None:
    expected = np.concatenate([state[:2] + dt * state[2:], state[2:] + dt * control])
    np.testing.assert_allclose(step(DOUBLE_INTEGRATOR, state, control, dt), expected, atol=1e-12)


@pytest.mark.parametrize("dynamics", [UNICYCLE, DOUBLE_INTEGRATOR], ids=lambda d: d.name)
def test_rollout_applies_the_step_to_every_player(dynamics: Dynamics) -> None:
    rng = np.random.default_rng(0)
    initial_state, controls = rng.standard_normal((3, 4)), rng.standard_normal((6, 3, 2))
    states = rollout(dynamics, initial_state, controls, 0.3)
    assert states.shape == (7, 3, 4)
    np.testing.assert_array_equal(states[0], initial_state)
    for t in range(6):
        for i in range(3):
            expected = step(dynamics, states[t, i], controls[t, i], 0.3)
            np.testing.assert_allclose(states[t + 1, i], expected, atol=1e-14)


def test_rollout_of_one_player_and_of_no_control() -> None:
    initial_state = np.array([[1.0, 2.0, 0.5, 0.1]])
    assert rollout(UNICYCLE, initial_state, np.zeros((3, 1, 2)), 0.1).shape == (4, 1, 4)
    np.testing.assert_array_equal(
        rollout(UNICYCLE, initial_state, np.zeros((0, 1, 2)), 0.1), initial_state[None]
    )


def test_positions_come_first() -> None:
    for dynamics in (UNICYCLE, DOUBLE_INTEGRATOR):
        assert dynamics.state_names[:2] == ("px", "py")
        assert (dynamics.state_size, dynamics.control_size) == (4, 2)


@given(arrays(float, 4, elements=NUMBERS), arrays(float, 2, elements=st.floats(-1, 1)))
def test_bicycle_is_the_map_of_highway_env(state: np.ndarray, control: np.ndarray) -> None:
    """Sub-steps under one control: a slip angle of half the steering, a yaw rate by the axle."""
    px, py, heading, speed = state
    slip, h = np.arctan(np.tan(control[0]) / 2), 0.6 / 3
    for _ in range(3):
        px += speed * np.cos(heading + slip) * h
        py += speed * np.sin(heading + slip) * h
        heading += speed * np.sin(slip) / 1.7 * h
        speed += control[1] * h
    found = step(bicycle(rear_axle=1.7, sub_steps=3), state, control, 0.6)
    np.testing.assert_allclose(found, [px, py, heading, speed], atol=1e-12)


def test_a_bicycle_has_an_axle_and_a_step() -> None:
    assert bicycle(sub_steps=1).state_size == 4
    for wrong in ({"sub_steps": 0}, {"rear_axle": 0.0}, {"rear_axle": -1.0}):
        with pytest.raises(ValueError, match="must be"):
            bicycle(**wrong)
