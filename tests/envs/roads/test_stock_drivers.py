"""HighwayEnv's stock drivers as rivals of games, and fits of them."""

from importlib import import_module

import numpy as np
import pytest

from olne_bench.envs.roads.highway_roads import DT, ROAD_NAMES, road_network
from olne_bench.envs.roads.stock_drivers import (
    StockDriver,
    drive_among,
    drive_stock,
    fit_stock,
    predict_by_fit,
    routes,
)
from olne_bench.envs.scenarios.scenario import Scenario


def proposed(name: str, count: int, seed: int = 0) -> Scenario:
    family = import_module(f"olne_bench.envs.scenarios.{name}")
    scenario: Scenario = family.propose(np.random.default_rng(seed), count)
    return scenario


def drivers(states: np.ndarray) -> list[StockDriver]:
    return [StockDriver(float(speed)) for speed in states[:, 3]]


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_every_player_has_a_route_that_starts_where_it_is(name):
    scenario = proposed(name, 2)
    start = scenario.initial_state
    found = routes(name, scenario.game)
    assert len(found) == 2
    for (px, py, heading, _), route in zip(start, found, strict=True):
        assert [index[0] for index in route[1:]] == [index[1] for index in route[:-1]]
        first = road_network(name).get_closest_lane_index(np.array([px, py]), heading)
        assert first[:2] == route[0][:2]
    motion = drive_stock(name, scenario.game, start, drivers(start), 2)
    np.testing.assert_array_equal(motion[0], start)
    assert np.isfinite(motion).all()


def test_cars_that_are_alone_follow_their_routes():
    scenario = proposed("roundabout", 1, seed=1)
    motion = drive_stock(
        "roundabout", scenario.game, scenario.initial_state, [StockDriver(8.0)], 15
    )
    assert abs(motion[-1, 0, 3] - 8.0) < 1.0
    turned = np.unwrap(motion[:, 0, 2])
    assert np.ptp(turned) > 0.3  # it went into the circle


def test_a_stock_driver_brakes_behind_a_car_that_stands():
    scenario = proposed("two_way", 2)
    start = np.array([[100.0, 4.0, 0.0, 15.0], [160.0, 4.0, 0.0, 0.0]])
    others = np.tile(start, (16, 1, 1))
    own = drive_among("two_way", scenario.game, 0, start[0], StockDriver(15.0), others)
    assert own.shape == (16, 4)
    assert own[-1, 0] < 160.0
    assert own[-1, 3] < 4.0


def test_a_fit_finds_the_target_speed_of_a_stock_driver_and_predicts_it():
    scenario = proposed("highway", 2, seed=2)
    start = np.array([[100.0, 4.0, 0.0, 20.0], [300.0, 8.0, 0.0, 25.0]])
    truth = [StockDriver(26.0), StockDriver(21.0)]
    motion = drive_stock("highway", scenario.game, start, truth, 14)
    deviations = np.array([0.01, 0.01, 0.001, 0.01])
    fit = fit_stock("highway", scenario.game, 0, motion[:10], deviations)
    assert fit.driver.target_speed == pytest.approx(26.0, abs=1.0)
    # The start's last digits decide when MOBIL changes lanes, so positions across differ more.
    np.testing.assert_allclose(fit.states[:, 0], motion[:10, 0, 0], atol=0.1)
    np.testing.assert_allclose(fit.states[:, 1], motion[:10, 0, 1], atol=1.0)
    ahead = predict_by_fit("highway", scenario.game, motion[:10], deviations, 5)
    assert ahead.shape == (6, 2, 4)
    moved = motion[-1, :, 0] - motion[9, :, 0]
    assert (moved > 4 * DT * 20).all()
    np.testing.assert_allclose(ahead[:, :, 0], motion[9:, :, 0], atol=0.5)
