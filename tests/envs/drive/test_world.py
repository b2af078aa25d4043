import numpy as np
import pytest
from highway_env.road.regulation import RegulatedRoad
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.drive.cars import ROADS, STEPS
from olne_bench.envs.drive.nash_traffic import drivable, nash_plan
from olne_bench.envs.drive.setting import NASH, STOCK, DriveSetting
from olne_bench.envs.drive.world import DriveWorld

SLIGHT = np.array([0.001, 0.2])


def driven(world: DriveWorld, steps: int, control: np.ndarray | None) -> list[np.ndarray]:
    states = [world.states()]
    for _ in range(steps):
        if world.over:
            break
        world.advance(control)
        states.append(world.states())
    return states


@pytest.mark.parametrize("road", ROADS)
def test_the_same_seed_and_controls_make_the_same_drive(road: str) -> None:
    one, other = (driven(DriveWorld(DriveSetting(road, STOCK), 7), 12, SLIGHT) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_another_seed_makes_another_drive() -> None:
    one, other = (DriveWorld(DriveSetting("highway", STOCK), seed).states() for seed in (1, 2))
    assert not np.array_equal(one, other)


def test_cars_leave_and_others_enter() -> None:
    world = DriveWorld(DriveSetting("two_way", STOCK), 0, stock_ego=True)
    driven(world, STEPS, None)
    assert world.over
    assert world.counts.left > 0
    assert world.counts.entered > 0
    assert max(car.number for car in world.cars) >= ROADS["two_way"].cars
    assert len(world.cars) <= ROADS["two_way"].cars


def test_a_drive_ends_when_the_ego_collides() -> None:
    world = DriveWorld(DriveSetting("highway", STOCK), 0)
    world._vehicles[0].position = world._vehicles[1].position + 0.5
    world.advance(np.zeros(2))
    assert world.crashed
    assert world.over


def test_how_hard_a_collision_is_depends_on_what_the_ego_hits() -> None:
    beside = DriveWorld(DriveSetting("highway", STOCK), 0)
    assert beside.collision_speed is None
    beside._vehicles[0].position = beside._vehicles[1].position + 0.5
    beside._vehicles[0].speed = beside._vehicles[1].speed + 2.0
    beside.advance(np.zeros(2))
    assert beside.collision_speed == pytest.approx(2.0, abs=0.1)
    assert not beside.at_lane_end

    merging = DriveWorld(DriveSetting("merge", STOCK), 0)
    (end,) = merging.road.road.objects
    merging.cars[1:] = []  # all others have left
    merging._vehicles[0].position = end.position - [3.0, 0.0]
    merging._vehicles[0].heading, merging._vehicles[0].speed = 0.0, 15.0
    merging.advance(np.zeros(2))
    assert merging.collision_speed == 15.0
    assert merging.at_lane_end


def test_right_of_way_is_left_out_where_it_changes_nothing(monkeypatch) -> None:
    looked = []
    rules = RegulatedRoad.enforce_road_rules
    monkeypatch.setattr(
        RegulatedRoad, "enforce_road_rules", lambda road: (looked.append(road), rules(road))
    )
    driven(DriveWorld(DriveSetting("intersection", STOCK), 0), 5, SLIGHT)
    assert looked

    looked.clear()
    quick, whole = (DriveWorld(DriveSetting("intersection", STOCK), 0) for _ in range(2))
    for world in (quick, whole):
        road = world.road.road
        for number, one in world._vehicles.items():
            world._vehicles[number] = Vehicle(road, one.position, one.heading, one.speed)
        world._show()
    for _ in range(15):
        quick._frame()
    assert not looked
    for _ in range(15):
        whole.road.road.step(1 / 15)
    assert looked
    assert np.array_equal(quick.states(), whole.states())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"road": "motorway"}, "unknown road 'motorway'; known are: highway, merge"),
        ({"traffic": "none"}, "unknown traffic 'none'; known are: nash, stock"),
        ({"weights": "moderate"}, "unknown weights 'moderate'; known are: temperaments, dirichlet"),
    ],
)
def test_unknown_names(arguments: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DriveSetting(**({"road": "highway"} | arguments))


def test_controls_must_fit_the_ego() -> None:
    with pytest.raises(ValueError, match="finite"):
        DriveWorld(DriveSetting("highway", STOCK), 0).advance(np.array([0.0, np.nan]))
    with pytest.raises(ValueError, match="unless HighwayEnv"):
        DriveWorld(DriveSetting("highway", STOCK), 0).advance(None)


@pytest.mark.long
@pytest.mark.parametrize("road", ROADS)
def test_nash_traffic_drives_its_plans(road: str) -> None:
    world = DriveWorld(DriveSetting(road, NASH), 0)
    found = nash_plan(world.cars, world.states(), [None] * len(world.cars))
    assert found is not None
    states, controls = found
    assert drivable(states, controls).all()
    for step in range(5):
        world.advance(controls[step, 0])
    assert np.allclose(world.states(), states[5], atol=1e-9)
    again = DriveWorld(DriveSetting(road, NASH), 0)
    motion = driven(again, 5, controls[0, 0])
    assert np.array_equal(motion[0], states[0])
