"""Nash traffic in HighwayEnv's stock environments."""

import gymnasium
import highway_env  # noqa: F401  registers HighwayEnv's environments
import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.roads.highway_roads import road_network
from olne_bench.envs.traffic import (
    NashVehicle,
    Temperament,
    joint_planning,
    temperament,
    traffic_report,
)
from olne_bench.envs.traffic.lanes_ahead import points_along_lanes
from olne_bench.games.solve.reference_game import ReferenceGame

SIZES = {
    "highway-v0": {"vehicles_count": 8},
    "merge-v1": {},
    "roundabout-v1": {},
    "intersection-v2": {"initial_vehicle_count": 5},
}


@pytest.fixture(autouse=True)
def own_parameters(monkeypatch):
    """Set HighwayEnv's own parameters, which an intersection in another test may have changed."""
    for name in ("DISTANCE_WANTED", "COMFORT_ACC_MAX", "COMFORT_ACC_MIN"):
        monkeypatch.setattr(NashVehicle, name, getattr(IDMVehicle, name))


def make(version: str, kind: str = "NashVehicle", **config):
    config = {
        "other_vehicles_type": f"olne_bench.envs.traffic.{kind}",
        **SIZES.get(version, {}),
        **config,
    }
    return gymnasium.make(version, config=config)


def straight_road() -> Road:
    network = RoadNetwork.straight_road_network(2, speed_limit=30)
    return Road(network, np_random=np.random.default_rng(0))


def drive(road: Road, seconds: float, frequency: float = 15) -> None:
    for _ in range(round(seconds * frequency)):
        road.act()
        road.step(1 / frequency)


@pytest.mark.parametrize("version", SIZES)
def test_random_ego_for_many_steps(version):
    """Counts are per road; a new episode has a new one."""
    world = make(version)
    world.action_space.seed(0)
    world.reset(seed=0)
    solved = failed = 0
    for step in range(50):
        _, _, terminated, truncated, _ = world.step(world.action_space.sample())
        road = world.unwrapped.road
        assert all(np.isfinite([*v.position, v.heading, v.speed]).all() for v in road.vehicles)
        assert all(v.speed > -1e-9 for v in road.vehicles if not v.crashed)
        if terminated or truncated or step == 49:
            report = traffic_report(road)
            solved, failed = solved + report.solved, failed + report.shifted + report.braked
            world.reset(seed=step)
    assert solved > 100
    assert failed < 0.2 * solved


def test_vehicles_avoid_a_slow_one_ahead():
    road = straight_road()
    slow = NashVehicle(road, [100, 0], speed=15, target_speed=15)
    fast = NashVehicle(road, [60, 0], speed=28, target_speed=28)
    road.vehicles = [slow, fast]
    drive(road, 10)
    assert not (slow.crashed or fast.crashed)
    assert traffic_report(road).solved > 40
    assert fast.position[0] > slow.position[0] + 20  # MOBIL took the other lane


def test_vehicles_do_not_run_into_an_ego_that_stands():
    road = straight_road()
    ego = Vehicle(road, [130, 0], speed=0)
    coming = NashVehicle(road, [60, 0], speed=20, target_speed=20, enable_lane_change=False)
    road.vehicles = [ego, coming]
    drive(road, 8)
    assert not (ego.crashed or coming.crashed)


@pytest.mark.parametrize("may", [True, False])
def test_only_who_may_change_lanes_does(may):
    road = straight_road()
    slow = NashVehicle(road, [100, 0], speed=15, target_speed=15)
    fast = NashVehicle(road, [60, 0], speed=28, target_speed=28, enable_lane_change=may)
    road.vehicles = [slow, fast]
    drive(road, 6)
    assert (fast.target_lane_index[2] != slow.target_lane_index[2]) == may


def test_temperaments_differ():
    reached = {}
    for name in ("cautious", "normal", "aggressive"):
        road = straight_road()
        vehicle = NashVehicle(road, [50, 0], speed=22, target_speed=25)
        vehicle.set_temperament(name)
        road.vehicles = [vehicle]
        drive(road, 6)
        reached[name] = vehicle.speed
    assert reached["cautious"] < reached["normal"] < reached["aggressive"]


@pytest.mark.parametrize("kind", ["Aggressive", "Cautious", "Mixed"])
def test_presets_by_path(kind):
    world = make("highway-v0", f"{kind}NashVehicle", vehicles_count=6)
    world.reset(seed=0)
    found = {v.temperament for v in world.unwrapped.road.vehicles if isinstance(v, NashVehicle)}
    assert (len(found) > 1) == (kind == "Mixed")


def test_unknown_temperament_names_the_presets():
    with pytest.raises(ValueError, match="unknown temperament 'angry'; known are: aggressive, nor"):
        temperament("angry")
    own = Temperament(proximity=9.0)
    assert temperament(own) is own


def test_failed_plans_fall_back_and_are_counted(monkeypatch):
    road = straight_road()
    road.vehicles = [NashVehicle(road, [50, 0], speed=22), NashVehicle(road, [80, 0], speed=22)]
    drive(road, 1)
    before = traffic_report(road).solved
    solve = ReferenceGame.solve_all
    monkeypatch.setattr(
        ReferenceGame, "solve_all", lambda *args, **_: solve(*args, max_iterations=0, tolerance=0.0)
    )
    drive(road, 4)
    report = traffic_report(road)
    assert report.solved == before
    assert report.shifted == 2 * joint_planning.MAX_SHIFTS
    assert report.braked > 0
    assert not any(vehicle.crashed for vehicle in road.vehicles)


@pytest.mark.parametrize("kind", [IDMVehicle, NashVehicle])
def test_without_a_plan_a_car_stops_and_does_not_reverse(kind, monkeypatch):
    """HighwayEnv's driver model reverses from a car that stands too close in front."""
    solve = ReferenceGame.solve_all
    monkeypatch.setattr(
        ReferenceGame, "solve_all", lambda *args, **_: solve(*args, max_iterations=0, tolerance=0.0)
    )
    road = straight_road()
    ahead = IDMVehicle(road, [6.0, 0.0], speed=0.0, target_speed=0.0)
    behind = kind(road, [0.0, 0.0], speed=3.0)
    road.vehicles = [behind, ahead]
    speeds = []
    for _ in range(30):
        behind.act()
        behind.step(1 / 15)
        speeds.append(behind.speed)
    assert speeds[-1] < 0.2
    assert (min(speeds) > -1e-9) == (kind is NashVehicle)


def test_singular_systems_fall_back(monkeypatch):
    def fail(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(np.linalg, "solve", fail)
    road = straight_road()
    road.vehicles = [NashVehicle(road, [50, 0], speed=22, target_speed=28)]
    drive(road, 2)
    assert traffic_report(road).braked > 0


@pytest.mark.parametrize(
    ("road", "index", "along"),
    [
        ("highway", ("0", "1", 2), 40.0),
        ("merge", ("j", "k", 0), 100.0),  # a straight lane, then a sine, then a straight one
        ("roundabout", ("ser", "ses", 0), 100.0),  # a straight lane, a sine, arcs
        ("intersection", ("o0", "ir0", 0), 80.0),
    ],
)
def test_points_along_lanes_are_those_of_one_distance_at_a_time(road, index, along):
    network = road_network(road)
    position = network.get_lane(index).position(along, 0.5)
    distances = np.linspace(0.0, 60.0, 13)
    points, limits = points_along_lanes(network, index, None, position, distances, 0.3)
    for distance, point, limit in zip(distances, points, limits, strict=True):
        one = points_along_lanes(network, index, None, position, np.array([distance]), 0.3)
        np.testing.assert_allclose(one[0][0], point, atol=1e-12)
        assert one[1][0] == limit
    steps = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert (np.abs(steps - 5.0) < 1.5).all()  # lanes need not touch


def test_collisions_are_highway_envs():
    """Nash vehicles skip distant objects early, and collide with near ones as IDM vehicles do."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(300):
        states = rng.uniform((0, 0, -3, -5), (9, 4, 3, 30), (2, 4))
        outcomes = []
        for kind in (NashVehicle, IDMVehicle):
            road = straight_road()
            pair = [kind(road, state[:2], *state[2:]) for state in states]
            pair[0].handle_collisions(pair[1], 0.2)
            outcomes.append(
                [(v.crashed, None if v.impact is None else v.impact.tolist()) for v in pair]
            )
        assert outcomes[0] == outcomes[1]
        seen.add(outcomes[0][0][0])
    assert seen == {True, False}
