"""Recorded drivers at the moments at which they are predicted.

Each car counts once, at the first moment at which it has been seen for ``SEEN``, has a leader and
is seen for ``AHEAD`` more. Files that share motion are one piece. All that a case holds is known at
its moment, but for ``happened`` and what ``intent`` and ``leader known`` predict.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from olne_bench.bench.people.beside import Beside, lanes_beside
from olne_bench.envs.scenarios.following import NOISE_SCALE
from olne_bench.envs.tracks.grid import Grid
from olne_bench.envs.tracks.prediction import (
    KEPT,
    NO_ROOT,
    STEP,
    Driver,
    Foreseen,
    places,
    play,
    predict_cars,
    respond,
    scene_at,
)
from olne_bench.envs.tracks.reading import grid_and_road, read_whole
from olne_bench.envs.tracks.road import Road
from olne_bench.estimators.imperfect import Imperfect
from olne_bench.estimators.map import Map
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.sample_series import with_unseen
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import FullView

SEEN, AHEAD, FARTHER = 2.7, 3.0, 5.0  # [s]
HORIZONS = (1.0, 2.0, 3.0, 5.0)  # [s]
WAVE, CLOSING, DRIFTING, CALM = KINDS = "wave", "closing", "drifting", "calm"
IMPERFECT = "imperfect"  # method of ``Case.sampled``
#: Names of NGSIM's roads in those of files.
_ROADS = {"US101": "US-101", "Lanker": "Lankershim", "Peach": "Peachtree"}
#: Speeds of two leaders in a wave, and of a car and its leader, that differ by more [m/s].
_WAVE, _CLOSING = 2.0, 1.5
#: A car drifts that is so far beside its lane [m] and went so much of it in the last second.
_BESIDE, _DRIFT = 0.5, 0.3
#: Displacements that tell motions apart.
_TUPLE = 25
#: Noise of what is seen [m], its logarithm's standard deviation, and the time for weights [s].
_SIGMA, _SIGMA_SPREAD, _SECONDS = 0.1, 1.0, 60.0
#: Samples that are played.
_LOOSE = Imperfect(first=100, more=50, most=400, enough=100, count=100)


@dataclass(frozen=True)
class Source:
    """Cars of a file that count, and the piece of recording that they are in."""

    path: Path
    format_name: str
    road: str
    piece: str
    names: tuple[str, ...]


@dataclass
class Case:
    """A car at its moment. Places (H, 2) are metres along its way since then, and to its left."""

    road: str
    piece: str
    kind: str
    happened: np.ndarray  # at those of ``HORIZONS`` at which it is recorded
    predicted: dict[str, np.ndarray]  # by methods that need no other cars
    claimed: np.ndarray  # (H, 2) halves of the 90 % regions of ``olne-bench predict``
    gaps: np.ndarray  # (C,) distances [m] from each car of the game to the next
    speeds: np.ndarray  # (C,) [m/s], the car's own first
    slopes: np.ndarray  # (C,) how much faster each of them wants to be [m/s]
    answered: bool = True
    seconds: float = np.nan  # for weights of its own
    residual: float = np.nan  # [m] of what was seen, with them
    beside: tuple[Beside, ...] = ()  # lanes that it could change to
    #: Weights (M, N, 4) of imperfect drivers, and places with them.
    samples: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 4)))
    sampled: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 2)))  # (M, H, 2)


def sources(paths: Iterable[Path], format_name: str) -> Iterator[Source]:
    """Files with lanes, one after the other; a motion that files share is in the first."""
    known: dict[tuple[float, ...], str] = {}  # displacements, and the piece that has them
    for path in paths:
        grid, road = grid_and_road(read_whole(path, format_name))
        marks = {name: _marks(grid, name) for name in grid.players}
        shared = [known[mark] for own in marks.values() for mark in own if mark in known]
        piece = min(shared, default=path.name)
        new = tuple(n for n in grid.players if not any(mark in known for mark in marks[n]))
        known |= {mark: piece for own in marks.values() for mark in own}
        if road is not None:
            yield Source(path, format_name, _road_name(path), piece, new)


def _marks(grid: Grid, name: str) -> list[tuple[float, ...]]:
    """Displacements [mm] of a car over spans of samples in which it does not stand."""
    own = grid.states[:, grid.players.index(name), :2]
    moved = np.round(np.linalg.norm(np.diff(own, axis=0), axis=1) * 1000)
    if len(moved) < _TUPLE:
        return []
    spans = np.lib.stride_tricks.sliding_window_view(moved, _TUPLE)
    return [tuple(span) for span in spans if np.isfinite(span).all() and len({*span}) > _TUPLE / 2]


def _road_name(path: Path) -> str:
    """CommonRoad's name of the place, or the file's."""
    parts = path.stem.split("_")
    name = parts[1].split("-")[0] if len(parts) > 2 else path.stem
    return _ROADS.get(name, name)


def cases_in(source: Source, weights: bool) -> list[Case]:
    """The cars of a file that can be predicted; with weights of their own, which take seconds."""
    grid, road = grid_and_road(read_whole(source.path, source.format_name))
    assert road is not None
    found = (_case(grid, road, name, source, weights) for name in source.names)
    return [case for case in found if case is not None]


def _case(grid: Grid, road: Road, name: str, source: Source, weights: bool) -> Case | None:
    seen = np.flatnonzero(np.isfinite(grid.states[:, grid.players.index(name), 0]))
    if not seen.size or grid.times[seen[-1]] - grid.times[seen[0]] < SEEN + AHEAD - 1e-6:
        return None
    at = float(grid.times[seen[0]]) + SEEN
    left = float(grid.times[seen[-1]]) - at
    seconds = FARTHER if left > FARTHER - 1e-6 else AHEAD
    past = _Past()
    (one,) = predict_cars(grid, road, at, seconds, players=[name], weights=past)
    if not one.leaders or not np.isfinite(one.recorded).all():
        return None
    case = _known(one, past.states, source)
    case.beside = lanes_beside(scene_at(grid, road, at), name)
    (leader,) = predict_cars(grid, road, at, seconds, players=[one.leaders[0]], most=1)
    led = places(one.way, leader.recorded)
    known = respond(one.drivers, led) if np.isfinite(led).all() else None
    case.predicted["leader known"] = _since(one.drivers, one.times, known)
    if weights:
        _weigh(case, one, past)
    return case


class _Past:
    """Keeps what was seen of a game, and weighs all preferences alike."""

    def __call__(self, game: Game, states: np.ndarray) -> np.ndarray:
        self.game, self.states = game, states
        return np.full((game.num_players, 4), 0.25)


def _known(one: Foreseen, states: np.ndarray, source: Source) -> Case:
    """The case without weights of its own."""
    own, *ahead = one.drivers
    at = _at(len(one.times))
    speeds = np.array([car.speed for car in one.drivers])
    along = np.array([car.along for car in one.drivers])
    start = np.array([own.along, own.left])
    straight = np.column_stack([own.speed * one.times, 0 * one.times])
    intent = [_wanting(own, one.happened), *ahead]
    return Case(
        source.road,
        source.piece,
        _kind(speeds, states[:, 0, 1], one.times[1]),
        one.happened[at] - start,
        {
            "straight": straight[at],
            "controls": _held(own, one.times)[at],
            "game": _played(one.drivers, one.times),
            "alone": _played(one.drivers[:2], one.times),
            "intent": _played(intent, one.times),
        },
        one.half_widths[at],
        np.diff(along),
        speeds,
        np.array([car.target - car.speed for car in one.drivers]),
        one.why != NO_ROOT,
    )


def _at(steps: int) -> list[int]:
    """Indices of the horizons among so many times."""
    return [round(h / STEP) for h in HORIZONS if round(h / STEP) < steps]


def _played(
    drivers: Sequence[Driver], times: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Places (H, 2) by the game; those of driving straight on without an equilibrium."""
    found = play(drivers, len(times), np.full(4, 0.25) if weights is None else weights)
    return _since(drivers, times, found)


def _since(drivers: Sequence[Driver], times: np.ndarray, found: np.ndarray | None) -> np.ndarray:
    """Places (H, 2) since the moment; those of driving straight on where none are found."""
    if found is None:
        found = np.column_stack([drivers[0].speed * times, 0 * times])
    else:
        found = found - (drivers[0].along, drivers[0].left)
    return np.asarray(found[_at(len(times))])


def _held(own: Driver, times: np.ndarray) -> np.ndarray:
    """Places (S, 2) at the present acceleration, until the car stands."""
    slope = (own.target - own.speed) / KEPT
    speeds = (own.speed + slope * times).clip(min=0)
    moved = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * STEP)])
    return np.column_stack([moved, 0 * times])


def _wanting(own: Driver, happened: np.ndarray) -> Driver:
    """The driver who wants the speed at which it will drive in the end."""
    last = happened[-1, 0] - happened[-1 - round(1 / STEP), 0]
    return replace(own, target=max(0.0, float(last)))


def _kind(speeds: np.ndarray, beside: np.ndarray, step: float) -> str:
    """What a moment is, by what is known then."""
    if len(speeds) > 2 and abs(speeds[1] - speeds[2]) > _WAVE:
        return WAVE
    if speeds[0] - speeds[1] > _CLOSING:
        return CLOSING
    before, now = beside[-1 - round(1 / step)], beside[-1]
    return DRIFTING if abs(now) > _BESIDE and np.sign(now) * (now - before) > _DRIFT else CALM


def _weigh(case: Case, one: Foreseen, past: _Past) -> None:
    """Add what weights of its own, found in what was seen, predict."""
    problem = Problem(
        past.game, FullView(), _SIGMA, noise_scale=NOISE_SCALE, sigma_spread=_SIGMA_SPREAD
    )
    given = problem, Observation(with_unseen(past.states, past.game.horizon))
    begun = time.perf_counter()
    found = Map().estimate(*given, rng=np.random.default_rng(0), budget=_SECONDS)
    case.seconds = time.perf_counter() - begun
    case.answered = case.answered and found.converged
    theta = found.weights if found.converged else np.full(4, 0.25)
    case.predicted["own weights"] = _played(one.drivers, one.times, theta)
    if found.states is not None:
        off = (found.states[: len(past.states)] - past.states)[:, 0, :2]
        case.residual = float(np.sqrt(np.nanmean(off**2)))
    drawn = _LOOSE.estimate(*given, rng=np.random.default_rng(0), budget=_SECONDS)
    case.predicted[IMPERFECT] = case.predicted["game"]
    if drawn.converged and drawn.samples is not None:
        case.samples = np.asarray(drawn.samples)
        played = [_played(one.drivers, one.times, theta) for theta in case.samples]
        case.sampled = np.stack(played)
        case.predicted[IMPERFECT] = case.sampled.mean(axis=0)
