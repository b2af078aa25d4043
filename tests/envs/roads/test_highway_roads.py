"""HighwayEnv's roads, with players on lanes that are curves of games."""

import subprocess
import sys
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.road import lane as highway_lanes
from highway_env.road.lane import PolyLaneFixedWidth
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.roads.highway_roads import (
    CAR,
    DT,
    LENGTH,
    MAX_ACCELERATION,
    MAX_SPEED,
    MAX_STEERING,
    ROAD_NAMES,
    SIMULATION_FREQUENCY,
    SUB_STEPS,
    appended,
    lane_curve,
    make_road,
    replay,
    road_network,
)
from olne_bench.envs.roads.simulated_roads import ROADS
from olne_bench.envs.scenarios.two_way import ONCOMING_DISTANCE
from olne_bench.envs.tracks.road import curve_points
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.lanes import ArcLane, SineLane, StraightLane

LANES = {
    "straight": highway_lanes.StraightLane([3.0, 4.0], [33.0, 44.0]),
    "sine": highway_lanes.SineLane([0.0, 0.0], [60.0, 80.0], 3.0, 0.05, 0.7),
    "clockwise": highway_lanes.CircularLane([5.0, 6.0], 20.0, 0.4, 2.0, clockwise=True),
    "counter-clockwise": highway_lanes.CircularLane([5.0, 6.0], 20.0, 2.0, 0.4, clockwise=False),
}


def test_vehicles_are_those_of_the_simulator() -> None:
    assert (Vehicle.LENGTH, Vehicle.MAX_SPEED) == (LENGTH, MAX_SPEED)
    assert tuple(ROADS) == ROAD_NAMES


def test_a_family_is_known_without_the_simulator() -> None:
    """Its import takes a second."""
    names = ", ".join(f"olne_bench.envs.scenarios.{name}" for name in ROAD_NAMES)
    line = f'import sys, {names}; assert not {{"highway_env", "pygame"}} & set(sys.modules)'
    subprocess.run([sys.executable, "-c", line], check=True)


@pytest.mark.parametrize("kind", LANES)
def test_a_curve_goes_where_the_lane_goes(kind: str) -> None:
    lane = LANES[kind]
    curve = lane_curve(lane)
    assert curve.length == pytest.approx(lane.length)
    points = curve_points(curve)
    places = np.array([lane.local_coordinates(point) for point in points])
    np.testing.assert_allclose(places[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(places[[0, -1], 0], [0, lane.length], atol=1e-9)
    assert (np.diff(places[:, 0]) > 0).all()
    assert isinstance(curve, {"straight": StraightLane, "sine": SineLane}.get(kind, ArcLane))


def test_arcs_of_one_circle_are_joined() -> None:
    first = ArcLane((5.0, 6.0), 20.0, 0.4, 1.0)
    onward = ArcLane((5.0, 6.0), 20.0, 1.0 - 2 * np.pi, 1.8 - 2 * np.pi)
    (joined,) = appended([first], onward)
    assert isinstance(joined, ArcLane)
    assert (joined.centre, joined.radius, joined.start_phase) == ((5.0, 6.0), 20.0, 0.4)
    assert joined.end_phase == pytest.approx(1.8)
    straight = StraightLane((0.0, 0.0), (1.0, 0.0), 9.0)
    assert appended([], first) == [first]
    assert appended([straight, first], onward) == [straight, joined]
    for other in (ArcLane((5.0, 6.0), 21.0, 1.0, 1.8), ArcLane((5.0, 6.5), 20.0, 1.0, 1.8)):
        assert appended([first], other) == [first, other]
    assert appended([straight], first) == [straight, first]
    assert appended([first], straight) == [first, straight]


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_motion_is_that_of_the_simulator(name):
    rng = np.random.default_rng(0)
    initial = np.array([[100, 0, 0.1, 20.0], [160, 4, -0.1, 15.0], [40, 60, 2.0, 9.0]])
    controls = rng.uniform(-1, 1, (20, 3, 2)) * [0.2, 4.0]
    simulated = replay(name, initial, controls)
    np.testing.assert_allclose(rollout(CAR, initial, controls, DT), simulated, atol=1e-11)


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_lanes_have_the_simulators_coordinates(name):
    for lanes in road_network(name).lanes_dict().values():
        curve = lane_curve(lanes)
        position = ca.SX.sym("p", 2)
        locate = ca.Function("locate", [position], list(curve.locate(position)))
        assert curve.length == pytest.approx(lanes.length)
        for place in np.linspace(0, lanes.length, 5):
            point = lanes.position(place, 0.7)
            along, beside, heading = (float(value) for value in locate(point))
            expected = lanes.local_coordinates(point)
            np.testing.assert_allclose([along, beside], expected, atol=1e-9)
            assert np.sin((heading - lanes.heading_at(expected[0])) / 2) == pytest.approx(
                0, abs=1e-12
            )


def test_the_simulator_runs_at_its_usual_pace():
    assert AbstractEnv.default_config()["simulation_frequency"] == SIMULATION_FREQUENCY
    for name in ROAD_NAMES:
        config = make_road(name).unwrapped.config
        assert config["simulation_frequency"] / config["policy_frequency"] == SUB_STEPS
        assert 1 / config["policy_frequency"] == pytest.approx(DT)


def test_other_lanes_and_roads_are_refused():
    with pytest.raises(ValueError, match="no curve for a PolyLaneFixedWidth; known are: Straight"):
        lane_curve(PolyLaneFixedWidth([(0, 0), (10, 0), (20, 5)]))
    with pytest.raises(ValueError, match="no road for 'racetrack'; known are: highway"):
        make_road("racetrack")


def test_plans_that_the_simulator_would_interfere_with_are_seen():
    """Two cars side by side that are apart without a margin, and in contact with one."""
    initial = np.array([[100, 0, 0, 20.0], [100, 2.3, 0, 20.0]])
    controls = np.zeros((3, 2, 2))
    free = replay("highway", initial, controls)
    np.testing.assert_allclose(free[-1, :, 1], [0, 2.3], atol=1e-12)
    cushioned = replay("highway", initial, controls, margin=0.25)
    assert np.abs(cushioned - free).max() > 0.1


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_a_road_has_its_players_and_nobody_else(name):
    road = make_road(name)
    states = np.array([[100, 0.5, 0.1, 20.0], [130, 4, 0, 15.0], [20, 0, 1.0, 0.0]])
    road.place(states)
    np.testing.assert_array_equal(road.states(), states)
    assert road.road.vehicles == road.controlled_vehicles
    colours = [tuple(vehicle.color) for vehicle in road.controlled_vehicles]
    assert len(set(colours)) == 3
    assert all(0 <= part <= 255 for colour in colours for part in colour)
    assert not road.crashed().any()
    # Controls are not clipped, however large, and nothing ends an episode.
    before = road.states()
    control = np.array([[MAX_STEERING, -MAX_ACCELERATION], [0, 0], [0, MAX_ACCELERATION]])
    road.apply(control)
    expected = rollout(CAR, before, control[None], DT)[-1]
    np.testing.assert_allclose(road.states(), expected, atol=1e-9)
    assert not (road._is_terminated() or road._is_truncated())
    assert road._reward(None) == 0
    assert road.config["spawn_probability"] == 0
    assert road.config["centering_position"] == [0.5, 0.5]
    road.place(states[:1])
    assert len(road.controlled_vehicles) == 1
    np.testing.assert_array_equal(road.states(), states[:1])


@pytest.mark.parametrize("heading", [0.0, 0.8])
@pytest.mark.parametrize(
    ("gap", "margin", "crashed"),
    [
        *((-0.1, 0.0, True), (0.1, 0.0, False), (0.3, 0.1, False), (0.3, 0.2, True)),
        *((1.9, 0.9, False), (1.9, 1.0, True)),
    ],
)
def test_a_margin_widens_a_car_on_every_side(heading, gap, margin, crashed):
    """Two cars in line, at a given distance and the same speed."""
    along = (5 + gap) * np.array([np.cos(heading), np.sin(heading)])
    states = np.array([[100, 4, heading, 10.0], [100, 4, heading, 10.0]])
    states[1, :2] += along
    road = make_road("highway")
    road.place(states, margin)
    road.apply(np.zeros((2, 2)))
    assert road.crashed().tolist() == [crashed] * 2


def test_pictures_show_the_cars_in_the_middle():
    for name in ("highway", "roundabout"):
        road = make_road(name, "rgb_array")
        road.place(np.array([[100.0, 4, 0, 10], [120, 8, 0, 10]]))
        picture = road.render()
        assert picture.dtype == np.uint8 and picture.std() > 5
        middle = road.viewer.observer_vehicle.position
        np.testing.assert_array_equal(middle, [110, 6] if name == "highway" else [0, 0])
        assert picture.shape[1] == (1200 if name == "highway" else 600)
        road.close()
        assert road.viewer is None


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_pictures_can_be_filmed(name):
    """Video encoders want even numbers of pixels."""
    road = make_road(name, "rgb_array")
    road.place(np.array([[100.0, 0, 0, 10]]))
    height, width, _ = road.render().shape
    assert width % 4 == height % 2 == 0
    road.close()
    if name == "two_way":
        assert max(ONCOMING_DISTANCE) * road.config["scaling"] < width  # all cars are seen
    assert 2.5 < road.config["scaling"] < 10  # a car is a box, and some of the road is seen


def test_a_window_gets_the_pictures_of_every_step():
    shown = []
    event = SimpleNamespace(type=None)
    window = SimpleNamespace(show=lambda picture: shown.append(picture) or [event])
    road = make_road("highway", "rgb_array")
    road.window = window
    road.place(np.array([[100.0, 4, 0, 10]]))
    assert road.render() is None
    handled = []
    road.viewer.sim_surface.handle_event = handled.append
    before = len(shown)
    road.apply(np.zeros((1, 2)))
    assert len(shown) - before == SUB_STEPS - 1  # between two actions; the last is asked for
    assert road.render() is None
    assert handled == [event] * (len(shown) - before)
    road.window = None
    assert road.render().shape == shown[0].shape
    again = road.__getstate__()
    assert again["viewer"] is None and again["margin"] == road.margin
