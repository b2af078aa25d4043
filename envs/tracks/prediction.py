"""What recorded drivers do next: each plays the game ``following`` with those ahead of it.

A car's game has its leader, the leader's leader and so on. Everybody has the same weights, unless
others are given, keeps its place in the lane and wants the speed that it would have soon at its
present acceleration. Who drives away from the car behind it is no leader. Beside the game stands
driving on along the lane at constant speed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from olne_bench.envs.scenarios.following import CAR, driver
from olne_bench.envs.tracks.grid import Grid, Motion
from olne_bench.envs.tracks.leaders import (
    Scene,
    Standing,
    folded,
    motions_of,
    standing_cars,
    way_on,
)
from olne_bench.envs.tracks.road import Place, Road, locate
from olne_bench.errors import UserError
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import StraightLane
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.olne import solve_olne

#: Cars of one game: a car and those ahead of it.
MOST = 5
STEP = 0.2  # [s] of predictions
LONGEST = 20.0  # [s]
#: Seconds over whose samples the present speed is a mean.
_PRESENT = 0.5
#: Seconds over whose samples the present acceleration is the slope of the speed, and for how long
#: drivers want to go on with it (docs/people.md).
_RECENT, KEPT = 1.0, 1.0
#: 90 % of recorded drivers are within ``_SPREAD * t**_GROWTH`` [m] of the game along and across,
#: and along as much more as ``_CHANGE`` of what the game differs from driving straight on.
_SPREAD, _GROWTH, _CHANGE = np.array([0.79, 0.30]), np.array([1.16, 0.65]), 0.6
#: Who is so much faster than the car behind it drives away from it [m/s] (docs/people.md).
_AWAY = 5.0
_AHEAD = 1e3  # [m] of the way of a car that is in no lane
_LENGTH = 1e4  # [m] of lanes, beyond what anybody drives
#: Weights (N, 4) of the players of a game, of whose first samples states (T, N, 4) were seen, NaN
#: where not. Who is predicted has planned until then, so that the game ends with the prediction.
Weigh = Callable[[Game, np.ndarray], np.ndarray]
#: Why a car has no game.
NO_LANE, NO_LEADER, NO_ROOT = "in no lane", "no leader", "no equilibrium found"


@dataclass(frozen=True)
class Foreseen:
    """What is predicted of one car.

    Attributes:
        player: its name.
        leaders: those ahead of it, the nearest first, whom it need not follow.
        times: (S,) seconds after the last sample that was seen, 0 first.
        game: (S, 2) positions [m] by the game; those of ``straight`` where there is none.
        straight: (S, 2) positions at constant speed along the lane.
        way: (P, 2) points of the way on.
        recorded: (S, 2) what has happened, NaN where it is not known.
        why: why there is no game; empty where there is one.
        drivers: the car and its leaders.
    """

    player: str
    leaders: tuple[str, ...]
    times: np.ndarray
    game: np.ndarray
    straight: np.ndarray
    way: np.ndarray
    recorded: np.ndarray
    why: str = ""
    drivers: tuple["Driver", ...] = ()

    @property
    def half_widths(self) -> np.ndarray:
        """(S, 2) halves of the 90 % regions along the way and across it [m] (docs/people.md)."""
        changed = places(self.way, self.game) - places(self.way, self.straight)
        return np.asarray(
            self.times[:, None] ** _GROWTH * _SPREAD + np.abs(changed) * (_CHANGE, 0.0)
        )

    def errors(self, positions: np.ndarray) -> np.ndarray:
        """(S, 2) errors of predicted positions along the way and across it [m], left positive."""
        return np.asarray(places(self.way, positions) - self.happened)

    @property
    def happened(self) -> np.ndarray:
        """(S, 2) recorded distances along the way and to its left [m]."""
        return places(self.way, self.recorded)


@dataclass(frozen=True)
class Driver:
    """A car in coordinates of a way."""

    along: float  # [m]
    left: float  # [m]
    off: float  # heading [rad]
    speed: float  # [m/s]
    target: float  # wanted speed [m/s]


def predict_cars(
    grid: Grid,
    road: Road,
    at: float,
    ahead: float,
    *,
    players: Sequence[str] = (),
    weights: np.ndarray | Weigh | None = None,
    most: int = MOST,
) -> list[Foreseen]:
    """Predict cars from a time on.

    Args:
        grid: what was recorded; samples after ``at`` are only compared with.
        road: its lanes.
        at: the last sample that is seen [s].
        ahead: how far to look ahead [s].
        players: whom to predict. Default: all who are seen at that time.
        weights: (4,) of the leader's speed, the own, acceleration and steering, (N, 4) of a car and
            those ahead of it, or a function that finds these. Default: equal.
        most: number of cars in a game.

    Raises:
        UserError: on a time at which nothing is seen, or a player who is not seen then.
    """
    last = _sample(grid, at)
    if not STEP <= ahead <= LONGEST:
        raise UserError(f"--ahead {ahead:g}: expected {STEP:g} to {LONGEST:g} s")
    scene, motions = _seen(grid, road, last)
    cars = scene.cars
    missing = [name for name in players if name not in cars]
    if missing or not cars:
        who = f"player {missing[0]!r}" if missing else "nobody"
        there = ", ".join([*cars][:8]) or "none"
        raise UserError(f"{who} is seen moving at {grid.times[last]:g} s; there are: {there}")
    times = STEP * np.arange(round(ahead / STEP) + 1)
    past = _Past(dict(zip(grid.players, motions, strict=True)), grid.step)
    weights = np.full(4, 0.25) if weights is None else weights
    return [
        _foreseen(scene, name, times, (past, weights), most, _recorded(grid, last, times, name))
        for name in players or cars
    ]


def scene_at(grid: Grid, road: Road, at: float) -> Scene:
    """All cars that are seen at a time [s], by what is known then; UserError as of a prediction."""
    return _seen(grid, road, _sample(grid, at))[0]


def _seen(grid: Grid, road: Road, last: int) -> tuple[Scene, list[Motion]]:
    """Cars at a sample with their present speeds, and motions until then."""
    motions = motions_of(Grid(grid.times[: last + 1], grid.players, grid.states[: last + 1]))
    cars = {
        name: replace(car, speed=_present_speed(motions[grid.players.index(name)], grid.step))
        for name, car in standing_cars(grid.players, motions, last).items()
    }
    return Scene(road, cars), motions


@dataclass(frozen=True)
class _Past:
    """What has been seen of all cars, a motion for each name, at steps [s]."""

    motions: dict[str, Motion]
    step: float

    def driver(self, line: np.ndarray, name: str, car: Standing) -> Driver:
        """A car that is seen now, in coordinates of a way."""
        place = locate(line, car.position[None])
        along, left = _beside(line, place, car.position[None])[0]
        off = folded(car.heading - float(place.heading[0]))
        target = max(0.0, car.speed + KEPT * self._acceleration(name))
        return Driver(float(along), float(left), off, car.speed, target)

    def _acceleration(self, name: str) -> float:
        """Slope [m/s^2] of the speed of late; 0 of fewer than three samples."""
        recent = np.abs(self.motions[name].speeds[-1 - max(1, round(_RECENT / self.step)) :])
        seen = np.flatnonzero(np.isfinite(recent))
        return float(np.polyfit(self.step * seen, recent[seen], 1)[0]) if len(seen) > 2 else 0.0

    def on_way(self, line: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, float]:
        """States (T, N, 4) in coordinates of a way, about ``STEP`` apart, and their step [s]."""
        stride = max(1, round(STEP / self.step))
        parts = []
        for name in names:
            own = self.motions[name]
            states = np.full((len(own.headings), 4), np.nan)
            seen = own.seen & np.isfinite(own.headings) & np.isfinite(own.speeds)
            place = locate(line, own.positions[seen])
            off = [folded(angle) for angle in own.headings[seen] - place.heading]
            beside = _beside(line, place, own.positions[seen])
            states[seen] = np.column_stack([beside, off, np.abs(own.speeds[seen])])
            parts.append(states[::-1][::stride][::-1])
        return np.stack(parts, axis=1), stride * self.step


def prediction_table(found: Sequence[Foreseen]) -> pd.DataFrame:
    """A row for each car and time: positions and errors, ``along`` and ``left`` of the way [m]."""
    parts = []
    for one in found:
        columns = {"player": one.player, "leader": (*one.leaders, "")[0], "time": one.times}
        for name in ("game", "straight", "recorded"):
            columns[f"{name}_x"], columns[f"{name}_y"] = getattr(one, name).T
        for name in ("game", "straight"):
            errors = one.errors(getattr(one, name))
            columns[f"{name}_along"], columns[f"{name}_left"] = errors.T
        columns["along_90"], columns["left_90"] = one.half_widths.T
        parts.append(pd.DataFrame(columns | {"note": one.why}))
    return pd.concat(parts, ignore_index=True)


def _sample(grid: Grid, at: float) -> int:
    """Index of the last sample at a time [s]."""
    if not grid.times[0] - 1e-6 <= at <= grid.times[-1] + 1e-6:
        raise UserError(
            f"--at {at:g}: the recording has times from {grid.times[0]:g} to {grid.times[-1]:g} s"
        )
    return int(np.searchsorted(grid.times, at + 1e-6, side="right")) - 1


def _present_speed(motion: Motion, dt: float) -> float:
    recent = np.abs(motion.speeds[-max(1, round(_PRESENT / dt)) :])
    return float(np.nanmean(recent))


def _recorded(grid: Grid, last: int, times: np.ndarray, name: str) -> np.ndarray:
    """(S, 2) recorded positions at times after a sample; NaN where there are none."""
    own = grid.states[:, grid.players.index(name), :2]
    at, wanted = grid.times - grid.times[last], times.clip(max=grid.times[-1] - grid.times[last])
    columns = [np.interp(wanted, at, own[:, k]) for k in range(2)]  # NaN stays around gaps
    known = times <= grid.times[-1] - grid.times[last] + 1e-6
    return np.where(known[:, None], np.stack(columns, axis=1), np.nan)


def _foreseen(
    scene: Scene,
    name: str,
    times: np.ndarray,
    known: tuple[_Past, np.ndarray | Weigh],
    most: int,
    recorded: np.ndarray,
) -> Foreseen:
    car, lane = scene.cars[name], scene.lane(name)
    if lane is None:
        toward = np.array([np.cos(car.heading), np.sin(car.heading)])
        straight = car.position + car.speed * times[:, None] * toward
        way = car.position + _AHEAD * np.array([[0.0, 0.0], toward])
        return Foreseen(name, (), times, straight, straight, way, recorded, NO_LANE)
    line = way_on(scene.road, lane)
    first, *leaders = scene.chain(name, most)
    past, weights = known
    drivers = tuple(past.driver(line, who, scene.cars[who]) for who in (first, *leaders))
    own = drivers[0]
    straight = _points(line, own.along + car.speed * times, np.full(len(times), own.left))
    game, why = straight, NO_LEADER
    if leaders:
        if callable(weights):
            wanted = [replace(one, target=one.speed) for one in followed(drivers)]  # so far
            states, step = past.on_way(line, (first, *leaders)[: len(wanted)])
            plan = len(states) + round(times[-1] / step)
            weights = weights(_game(wanted, plan, step), states)
        played = play(drivers, len(times), weights)
        why = NO_ROOT if played is None else ""
        game = straight if played is None else _points(line, *played.T)
    return Foreseen(name, tuple(leaders), times, game, straight, line, recorded, why, drivers)


def places(line: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Distances (S, 2) along a line and to its left [m], beyond its ends as well."""
    return _beside(line, locate(line, positions), positions)


def _beside(line: np.ndarray, place: Place, positions: np.ndarray) -> np.ndarray:
    """``_places`` of positions that are located."""
    ahead = np.stack([np.cos(place.heading), np.sin(place.heading)], axis=1)
    off = positions - _points(line, place.along, np.zeros(len(positions)))
    along = place.along + (off * ahead).sum(axis=1)
    return np.stack([along, ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]], axis=1)


def _points(line: np.ndarray, along: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Points (S, 2) at distances along a line and to its left [m]; straight on beyond it."""
    steps = np.diff(line, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    k = (np.searchsorted(starts, along, side="right") - 1).clip(0, len(steps) - 1)
    unit = steps[k] / lengths[k][:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    return np.asarray(line[k] + (along - starts[k])[:, None] * unit + left[:, None] * normal)


def play(drivers: Sequence[Driver], steps: int, theta: np.ndarray) -> np.ndarray | None:
    """Places (S, 2) of the first driver along the way and to its left; None without an equilibrium.

    Weights are (4,), the same for all, or (N, 4) of those that are ``followed``; places are
    ``STEP`` apart.
    """
    drivers = followed(drivers)
    start = np.array([[one.along, one.left, one.off, one.speed] for one in drivers])
    theta = np.broadcast_to(theta, (len(drivers), 4))
    found = solve_olne(_game(drivers, steps, STEP), theta, start)
    return found.states[:, 0, :2] if found.certificate.passed else None


def followed(drivers: Sequence[Driver]) -> Sequence[Driver]:
    """The first driver and those ahead, as far as nobody drives away from the one behind."""
    away = (ahead.speed - car.speed > _AWAY for car, ahead in pairwise(drivers))
    return drivers[: next((k for k, is_away in enumerate(away, 1) if is_away), len(drivers))]


def respond(drivers: Sequence[Driver], leader: np.ndarray) -> np.ndarray | None:
    """As ``play``, of a driver whose leader is known to drive over places (S, 2); equal weights."""
    if len(followed(drivers)) == 1:
        return play(drivers, len(leader), np.full(4, 0.25))
    car, ahead = drivers[:2]
    game = _game((car, ahead), len(leader), STEP)
    start = np.array([[one.along, one.left, one.off, one.speed] for one in (car, ahead)])
    controls = np.zeros(game.control_shape)
    states = rollout(CAR, start, controls, STEP)
    states[1:, 1, :2], states[1:, 1, 2] = leader[1:], 0.0
    states[:, 1, 3] = np.gradient(leader[:, 0], STEP)
    given = game, 0, controls[None, :, 0], states, controls
    found = best_responses(*given, np.full((2, 4), 0.25))
    if not found.converged[0]:
        return None
    controls[:, 0] = found.controls[0]
    return np.asarray(rollout(CAR, start, controls, STEP)[:, 0, :2])


def _game(drivers: Sequence[Driver], steps: int, dt: float) -> Game:
    """The game of a car and those ahead of it.

    In coordinates of the way every lane is straight, and each driver keeps to its place in it.
    """
    players = tuple(
        driver(
            leader=k + 1 if k + 1 < len(drivers) else -1,
            target_speed=one.target,
            route=(StraightLane((0.0, one.left), (1.0, 0.0), _LENGTH),),
            dt=dt,
        )
        for k, one in enumerate(drivers)
    )
    return Game(players, CAR, steps, dt)
