"""HighwayEnv's stock drivers, as its users predict traffic: IDM for speeds, MOBIL for lane changes.

The Intelligent Driver Model (Treiber et al. 2000) and MOBIL (Kesting et al. 2007) are HighwayEnv's
own, in its frames. Cars know their routes, as the players of a game do. What a user without games
would do to predict is to fit them to what was seen (``predict_by_fit``).
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from functools import lru_cache

import numpy as np
from highway_env.road.road import LaneIndex, Road
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from scipy.optimize import least_squares

from olne_bench.envs.roads.highway_roads import (
    SIMULATION_FREQUENCY,
    SUB_STEPS,
    make_road,
    road_network,
)
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import ArcLane, Lane, LaneKeeping, SineLane, StraightLane

#: Distance [m] between points of a route, and to it of lanes that are part of it.
_SPACING, _ON_ROUTE = 0.25, 0.3
#: A route that ends straight goes straight on, as that of a player does [m].
_STRAIGHT_ON = 300.0
#: Least and largest values of a driver's parameters, in the order of ``StockDriver``.
_LOW, _HIGH = (0.1, 0.1, 5.5, 0.3, 0.5), (45.0, 4.0, 30.0, 8.0, 12.0)
#: How far parameters are from HighwayEnv's before that weighs as much as an error of the noise's
#: size: a short window does not determine all of them.
_DEVIATIONS = (10.0, 1.5, 5.0, 2.0, 4.0)
#: Finite differences, relative to these deviations; MOBIL's decisions make smaller ones rough.
_STEP = 1e-2
#: Evaluations of the residuals at most; those for derivatives are not counted.
_MOST_EVALUATIONS = 15


@dataclass(frozen=True)
class StockDriver:
    """Parameters of one driver; the defaults are HighwayEnv's."""

    target_speed: float  # [m/s]
    time_gap: float = IDMVehicle.TIME_WANTED  # wanted time to the car in front [s]
    #: Wanted distance to a car in front that stands, from centre to centre [m].
    jam_distance: float = IDMVehicle.DISTANCE_WANTED
    acceleration: float = IDMVehicle.COMFORT_ACC_MAX  # comfortable acceleration [m/s^2]
    braking: float = -IDMVehicle.COMFORT_ACC_MIN  # comfortable deceleration [m/s^2]


def drive_stock(
    name: str, game: Game, states: np.ndarray, drivers: Sequence[StockDriver], steps: int
) -> np.ndarray:
    """States (steps + 1, N, 4), the given ones first, where stock drivers drive on from there."""
    road = _empty_road(name)
    cars = [
        stock_car(road, state, driver, route)
        for state, driver, route in zip(states, drivers, routes(name, game), strict=True)
    ]
    road.vehicles = list(cars)
    motion = [states]
    for _ in range(steps):
        _advance(road)
        motion.append(_states(cars))
    return np.stack(motion)


def drive_among(
    name: str, game: Game, player: int, start: np.ndarray, driver: StockDriver, others: np.ndarray
) -> np.ndarray:
    """States (n, 4) of a stock driver in a player's place, among recorded cars (n, N, 4)."""
    road = _empty_road(name)
    car = stock_car(road, start, driver, routes(name, game)[player])
    motion = [start]
    for now in others[:-1]:
        rest = np.delete(now, player, axis=0)
        recorded = [Vehicle(road, [px, py], heading, speed) for px, py, heading, speed in rest]
        road.vehicles = [car, *recorded]
        _advance(road)
        motion.append(_states([car])[0])
    return np.stack(motion)


def routes(name: str, game: Game) -> tuple[tuple[LaneIndex, ...], ...]:
    """The lanes of a road's network that each player keeps, in the order in which they come."""
    found = []
    for player in game.players:
        (keeping,) = (one for one in player.task if isinstance(one, LaneKeeping))
        found.append(stock_route(name, keeping.route))
    return tuple(found)


@lru_cache(maxsize=256)
def stock_route(name: str, lanes: tuple[Lane, ...]) -> tuple[LaneIndex, ...]:
    """The lanes of a road's network along a route, in the order in which they come."""
    points = np.vstack([_points(lane) for lane in lanes[:-1]] + [_points(lanes[-1], _STRAIGHT_ON)])
    placed = []
    for index, lane in road_network(name).lanes_dict().items():
        own = [lane.position(share * lane.length, 0) for share in (0.1, 0.5, 0.9)]
        distances = np.linalg.norm(points - np.array(own)[:, None], axis=2)
        if (distances.min(axis=1) < _ON_ROUTE).all():
            where = distances.argmin(axis=1)
            if where[0] < where[-1]:  # not a lane in the opposite direction
                placed.append((int(where[1]), index))
    return tuple(index for _, index in sorted(placed))


def _points(lane: Lane, straight_on: float = 0.0) -> np.ndarray:
    assert isinstance(lane, StraightLane | SineLane | ArcLane), "HighwayEnv's lanes are such"
    numbers, farther = lane.general(), straight_on * isinstance(lane, StraightLane)
    along = np.arange(0, lane.length + farther, _SPACING)
    return np.array([numbers.point(float(value)) for value in along])


def _empty_road(name: str) -> Road:
    """The road as HighwayEnv makes it, which may have rules of way."""
    made = _template(name)
    return type(made)(network=made.network, np_random=np.random.RandomState(0))


@lru_cache(maxsize=8)
def _template(name: str) -> Road:
    return make_road(name).road


def stock_car(
    road: Road, state: np.ndarray, driver: StockDriver, route: tuple[LaneIndex, ...]
) -> IDMVehicle:
    """A car (px [m], py [m], heading [rad], speed [m/s]) that HighwayEnv drives along a route."""
    px, py, heading, speed = (float(value) for value in state)
    car = IDMVehicle(road, [px, py], heading, speed, target_speed=driver.target_speed)
    car.route = _ahead(car.lane_index, route)
    car.TIME_WANTED, car.DISTANCE_WANTED = driver.time_gap, driver.jam_distance
    car.COMFORT_ACC_MAX, car.COMFORT_ACC_MIN = driver.acceleration, -driver.braking
    return car


def _ahead(here: LaneIndex, route: tuple[LaneIndex, ...]) -> list[LaneIndex]:
    """The rest of a route from the stretch of road where a car is; nothing if it is elsewhere."""
    stretches = [index[:2] for index in route]
    return list(route[stretches.index(here[:2]) :]) if here[:2] in stretches else []


def _advance(road: Road) -> None:
    """One step of the game: the simulator's frames."""
    for _ in range(SUB_STEPS):
        for car in road.vehicles:
            if isinstance(car, IDMVehicle):
                car.act()
        road.step(1 / SIMULATION_FREQUENCY)


def _states(cars: Sequence[Vehicle]) -> np.ndarray:
    return np.array([[*car.position, car.heading, car.speed] for car in cars])


@dataclass(frozen=True)
class StockFit:
    """A fitted driver, and the player's states (n, 4) as it drove them."""

    driver: StockDriver
    states: np.ndarray


def fit_stock(
    name: str, game: Game, player: int, seen: np.ndarray, deviations: np.ndarray
) -> StockFit:
    """Fit one player's driver and first state to noisy states (n, N, 4); others move as recorded.

    ``deviations`` (4,) are the standard deviations of the noise.
    """
    first, usual = seen[0, player], np.array(astuple(StockDriver(float(seen[0, player, 3]))))
    scale = np.concatenate([_DEVIATIONS, deviations])
    low = np.concatenate([_LOW, first - 4 * deviations])
    high = np.concatenate([_HIGH, first + 4 * deviations])
    centre = np.concatenate([usual.clip(_LOW, _HIGH), first])
    # SciPy's steps are relative to the variables, so these start at one.
    origin = centre - scale

    def drive(point: np.ndarray) -> np.ndarray:
        driver = StockDriver(*map(float, point[: len(usual)]))
        return drive_among(name, game, player, point[len(usual) :], driver, seen)

    def residuals(x: np.ndarray) -> np.ndarray:
        errors = (drive(origin + scale * x) - seen[:, player]) / deviations
        return np.concatenate([errors.ravel(), x[: len(usual)] - 1])

    found = least_squares(
        residuals,
        np.ones(len(scale)),
        bounds=((low - origin) / scale, (high - origin) / scale + 1e-9),
        diff_step=np.full(len(scale), _STEP),
        max_nfev=_MOST_EVALUATIONS,
    )
    point = origin + scale * found.x
    values = dict(zip((f.name for f in fields(StockDriver)), map(float, point), strict=False))
    return StockFit(StockDriver(**values), drive(point))


def predict_by_fit(
    name: str, game: Game, seen: np.ndarray, deviations: np.ndarray, steps: int
) -> np.ndarray:
    """States (steps + 1, N, 4) of all players' fitted drivers, which drive on together.

    They start from the last ones of the window (n, N, 4), which come first.
    """
    fits = [fit_stock(name, game, player, seen, deviations) for player in range(seen.shape[1])]
    return drive_stock(name, game, seen[-1], [fit.driver for fit in fits], steps)
