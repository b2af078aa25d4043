"""Lanes as curves: geometry of arcs, smooth routes, cost on and beside the lane."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import UNICYCLE, bicycle
from olne_bench.games.model.lanes import (
    ArcLane,
    Lane,
    LaneKeeping,
    RouteTable,
    SineLane,
    StraightLane,
)

EAST = StraightLane((0.0, 0.0), (1.0, 0.0), 20.0)
# Goes on where EAST ends, a quarter turn towards +y about (20, 10).
TURN = ArcLane((20.0, 10.0), 10.0, -np.pi / 2, 0.0)
LAST = StraightLane((30.0, 10.0), (30.0, 11.0), 20.0)


def cost_function(feature: LaneKeeping) -> ca.Function:
    state = ca.SX.sym("x", 4)
    stage = Stage(0, (state,), None, bicycle(), 0.4)
    return ca.Function("cost", [state], [feature.final_cost(stage)])


@pytest.mark.parametrize("phases", [(-np.pi / 2, 0.0), (3.0, 1.0), (0.5, 4.0)])
def test_arc_locates_its_own_points(phases):
    arc = ArcLane((3.0, -2.0), 12.0, *phases)
    turn = np.sign(phases[1] - phases[0])
    position = ca.SX.sym("p", 2)
    locate = ca.Function("locate", [position], list(arc.locate(position)))
    for along in np.linspace(0, arc.length, 9):
        phase = phases[0] + turn * along / 12
        radius = 12 - turn * 0.7
        point = np.array([3, -2]) + radius * np.array([np.cos(phase), np.sin(phase)])
        found = [float(value) for value in locate(point)]
        np.testing.assert_allclose(found, [along, 0.7, phase + turn * np.pi / 2], atol=1e-12)


def test_route_costs_nothing_along_its_middle():
    cost = cost_function(LaneKeeping((EAST, TURN), blend=0.5))
    for state in ([5, 0, 0, 8], [20, 0, 0, 8], [30, 10, np.pi / 2, 8]):
        assert float(cost(state)) < 1e-6
    # Blending near the joint costs little: both lanes lead there alike.
    assert float(cost([21, 0.05, 0.1, 8])) < 0.01


def test_cost_grows_beside_the_lane_and_across_it():
    cost = cost_function(LaneKeeping((EAST,), width=2.0, heading_scale=3.0))
    assert float(cost([5, 2, 0, 8])) == pytest.approx(1.0)
    assert float(cost([5, 0, 0.1, 8])) == pytest.approx(3 * 0.01, rel=1e-3)
    assert float(cost([5, 0, 2 * np.pi, 8])) == pytest.approx(0.0, abs=1e-12)


def test_far_beyond_the_joint_only_the_later_lane_counts():
    cost = cost_function(LaneKeeping((EAST, TURN), blend=0.5))
    assert float(cost([27.0711, 2.9289, np.pi / 4, 8])) < 1e-3
    assert np.isfinite(float(cost([1e6, 0, 0, 8])))


def test_beside_a_route_each_lane_costs_what_it_costs_alone():
    """But near a joint, where the two are mixed."""
    route = cost_function(LaneKeeping((EAST, TURN, LAST), width=2.0, blend=0.5))
    for lane, state in (
        (EAST, [5, 1.5, 0.3, 8]),
        (TURN, [27, 2, 0.5, 8]),
        (LAST, [31, 25, 1.2, 8]),
    ):
        alone = float(cost_function(LaneKeeping((lane,), width=2.0))(state))
        assert float(route(state)) == pytest.approx(alone, abs=1e-3)
        assert alone > 0.1
    at_the_joint = [20, 1.0, 0.2, 8]
    first, second = (
        float(cost_function(LaneKeeping((lane,), width=2.0))(at_the_joint)) for lane in (EAST, TURN)
    )
    assert float(route(at_the_joint)) == pytest.approx((first + second) / 2, abs=1e-3)


@pytest.mark.parametrize("turn", [TURN, StraightLane((20, 0), (0.6, 0.8), 10.0)])
def test_far_past_a_turn_only_the_last_lane_counts(turn: Lane) -> None:
    """Also where it leads away from the first one at a right angle, and straight from an arc."""
    end = turn.general().point(turn.length)
    last = StraightLane(end, (0.0, 1.0), 100.0)
    route = cost_function(LaneKeeping((EAST, turn, last), width=0.7, heading_scale=10.0))
    for along in (15.0, 40.0, 90.0):
        assert float(route([end[0], end[1] + along, np.pi / 2, 8])) < 1e-3
        beside = float(route([end[0] + 0.7, end[1] + along, np.pi / 2, 8]))
        assert beside == pytest.approx(1.0, abs=1e-3)


def test_a_route_needs_lanes():
    with pytest.raises(ValueError, match="at least one lane"):
        LaneKeeping(())


SINE = SineLane(EAST, amplitude=2.0, pulsation=0.1, phase=0.4)
CLOCKWISE = ArcLane((3.0, -2.0), 8.0, 2.0, -1.5)
SLANTED = StraightLane((3.6, -10.0), (0.0, 1.0), 10.0)  # from its end to EAST


@pytest.mark.parametrize("route", [(EAST, TURN), (SINE,), (CLOCKWISE, SLANTED, SINE)])
@pytest.mark.parametrize("spare", [0, 2])
def test_a_table_costs_what_its_route_costs(route: tuple[Lane, ...], spare: int) -> None:
    """Up to third derivatives, which the inverse problem needs; where lanes begin, too."""
    keeping = LaneKeeping(route, width=2.0, heading_scale=3.0, blend=1.5)
    table = keeping.resized(len(route) + spare)
    assert isinstance(table, RouteTable) and len(table.route) == len(route) + spare
    state = ca.SX.sym("x", 4)
    direction = ca.SX([0.3, -0.8, 0.5, 0.1])

    def derivatives(feature: LaneKeeping) -> ca.Function:
        stage = Stage(0, (state,), ca.SX.sym("u", 2), UNICYCLE, 0.25)
        cost = feature.running_cost(stage)
        gradient = ca.gradient(cost, state)
        third = ca.hessian(ca.dot(gradient, direction), state)[0]
        return ca.Function("f", [state], [cost, ca.densify(gradient), ca.densify(third)])

    plain, general = derivatives(keeping), derivatives(table)
    rng = np.random.default_rng(1)
    places = [[0.0, 0.0, 0.1, 1.0], [1.0, 2.0, 0.1, 1.0], *rng.uniform(-15, 15, (20, 4))]
    for place in places:
        for a, b in zip(general(place), plain(place), strict=True):
            np.testing.assert_allclose(np.array(a), np.array(b), rtol=1e-9, atol=1e-9)


def test_a_route_longer_than_its_table_is_refused() -> None:
    with pytest.raises(ValueError, match="a route of 2 lanes does not fit into 1"):
        LaneKeeping((EAST, TURN)).resized(1)


@pytest.mark.parametrize(
    "lane",
    [
        StraightLane((3.0, 4.0), (0.6, 0.8), 50.0),
        SineLane(StraightLane((0.0, 0.0), (0.6, 0.8), 60.0), 3.0, 0.05, 0.7),
        ArcLane((5.0, 6.0), 20.0, 0.4, 1.9),
        ArcLane((5.0, 6.0), 20.0, 1.9, 0.4),
    ],
)
def test_points_of_a_lane_lie_on_it(lane) -> None:
    for along in (0.0, 0.3 * lane.length, lane.length):
        located = lane.locate(ca.SX(lane.general().point(along)))[:2]
        found = [float(ca.evalf(ca.SX(value))) for value in located]
        np.testing.assert_allclose(found, [along, 0.0], atol=1e-9)


def test_lanes_of_a_route_have_to_join() -> None:
    first = StraightLane((0.0, 0.0), (1.0, 0.0), 10.0)
    LaneKeeping((first, StraightLane((5.0, 4.0), (1.0, 0.0), 20.0)))  # beside, as to overtake
    away = StraightLane((10.0, 30.0), (1.0, 0.0), 20.0)
    with pytest.raises(ValueError, match=r"lanes 0 and 1 of a route do not join: one ends at"):
        LaneKeeping((first, away))
    behind = StraightLane((30.0, 0.0), (1.0, 0.0), 20.0)
    with pytest.raises(ValueError, match=r"20\.0 m away from the next"):
        LaneKeeping((first, behind))
