import casadi as ca
import numpy as np
import pytest

from olne_bench.games.model.costs import (
    CarProximity,
    ControlEffort,
    Feature,
    FinalGoal,
    Proximity,
    Stage,
    StateDeviation,
)
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, UNICYCLE

STATES = np.array([[1.0, 2.0, 0.3, 0.4], [1.5, 1.0, 0.1, 0.2], [-1.0, 0.0, 0.0, 0.6]])
CONTROL = np.array([0.7, -0.9])
DT = 0.25


def cost(feature: Feature, player: int, *, final: bool = False, states: np.ndarray = STATES):
    symbols = tuple(ca.DM(state) for state in states)
    control = None if final else ca.DM(CONTROL)
    stage = Stage(player, symbols, control, UNICYCLE, DT)
    return float(feature.final_cost(stage) if final else feature.running_cost(stage))


@pytest.mark.parametrize("player", [0, 1, 2])
@pytest.mark.parametrize("final", [False, True])
def test_proximity_sums_over_the_others(player: int, final: bool) -> None:
    expected = sum(
        0.1 * -np.log(np.sum((STATES[player, :2] - STATES[j, :2]) ** 2) + 0.1)
        for j in range(3)
        if j != player
    )
    assert cost(Proximity(), player, final=final) == pytest.approx(expected, rel=1e-12)


def test_proximity_grows_as_players_meet_and_stays_finite() -> None:
    apart, near, met = (np.array([[0.0, 0, 0, 0], [gap, 0, 0, 0]]) for gap in (2.0, 0.5, 0.0))
    values = [cost(Proximity(), 0, states=states) for states in (apart, near, met)]
    assert values[0] < values[1] < values[2] < np.inf


def test_proximity_of_a_lone_player_is_nothing() -> None:
    assert cost(Proximity(), 0, states=STATES[:1]) == 0


HEADING = np.pi / 3
AHEAD, LEFT = (np.array([np.cos(a), np.sin(a)]) for a in (HEADING, HEADING + np.pi / 2))


def car_cost(*places: np.ndarray, final: bool = False) -> float:
    """Cost of a car at (1, 2) that drives at an angle, of others at places seen from it."""
    own = np.array([1.0, 2.0, HEADING, 9.0])
    others = [np.array([*(own[:2] + place), 0.7, 3.0]) for place in places]
    feature = CarProximity(length=5.0, width=2.0, scale=1.5)
    return cost(feature, 0, final=final, states=np.array([own, *others]))


@pytest.mark.parametrize("final", [False, True])
def test_cars_measure_distances_in_lengths_ahead_and_widths_beside(final: bool) -> None:
    for ahead, beside in ((10.0, 0.0), (-5.0, 0.0), (0.0, 4.0), (7.5, -3.0), (2.0, 3.0)):
        squared = (ahead / 5) ** 2 + (beside / 2) ** 2
        found = car_cost(ahead * AHEAD + beside * LEFT, final=final)
        assert found == pytest.approx(-1.5 * np.log(squared + 0.1), rel=1e-9)


def test_cars_ahead_are_nearer_than_cars_beside_and_all_count() -> None:
    assert car_cost(4 * AHEAD) > car_cost(4 * LEFT)
    one, other = car_cost(4 * AHEAD), car_cost(-3 * LEFT)
    assert car_cost(4 * AHEAD, -3 * LEFT) == pytest.approx(one + other, rel=1e-12)


@pytest.mark.parametrize(("component", "column"), [("px", 0), ("heading", 2), ("speed", 3)])
@pytest.mark.parametrize("final", [False, True])
def test_state_deviation_counts_at_every_step(component: str, column: int, final: bool) -> None:
    feature = StateDeviation(component, target=0.5, scale=3.0)
    expected = 3.0 * (STATES[1, column] - 0.5) ** 2
    assert cost(feature, 1, final=final) == pytest.approx(expected, rel=1e-12)
    assert feature.name == component


@pytest.mark.parametrize(("component", "column"), [("yaw_rate", 0), ("acceleration", 1)])
def test_control_effort_is_per_step_and_ends_before_the_last_state(
    component: str, column: int
) -> None:
    feature = ControlEffort(component, scale=10.0)
    expected = 10.0 * (DT * CONTROL[column]) ** 2
    assert cost(feature, 0) == pytest.approx(expected, rel=1e-12)
    assert cost(feature, 0, final=True) == 0


def test_goal_counts_at_the_last_step_only() -> None:
    feature = FinalGoal((0.0, 1.0))
    assert cost(feature, 0) == 0
    assert cost(feature, 0, final=True) == pytest.approx(100 * (1 + 1), rel=1e-12)


def test_components_are_found_by_name() -> None:
    stage = Stage(0, (ca.DM(STATES[0]),), ca.DM(CONTROL), DOUBLE_INTEGRATOR, DT)
    assert float(stage.own_state("vy")) == STATES[0, 3]
    assert float(stage.own_control("ax")) == CONTROL[0]
    with pytest.raises(ValueError, match="tuple"):
        stage.own_state("speed")
