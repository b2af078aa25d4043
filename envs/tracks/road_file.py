"""The road and the players' targets as plain data, and as the TOML file beside a file of tracks.

    scenario = "highway"              # whose costs the players have; may be left out

    [lanes.left]
    points = [[0, 0], [120, 0]]       # centre line [m], in the driving direction
    following = ["bend"]              # lanes that it leads to
    width = 3.5                       # [m]

    [players.car_1]
    targets = { speed = 28.0 }        # target values of components of the state
    lanes = ["left"]                  # its route, in driving order
    goal = [80, 0]                    # goal position at the end [m]

A lane is given by ``points``, or exactly by ``curves``: straight lines, sines and arcs with their
parameters, as ``olne-bench export`` writes them.
"""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from olne_bench.checks import first_problem
from olne_bench.envs.roads.highway_roads import ROAD_NAMES, lane_curve, road_network
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.tracks.checks import FASTEST
from olne_bench.envs.tracks.road import (
    DEFAULT_WIDTH,
    FARTHEST,
    LONGEST,
    LONGEST_NAME,
    Road,
    RoadLane,
    check_shown,
    curves_through,
)
from olne_bench.envs.tracks.text import listed
from olne_bench.envs.worlds.layout import player_name
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input, whole_file
from olne_bench.games.model.costs import FinalGoal, StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import ArcLane, Lane, LaneKeeping, SineLane, StraightLane

#: Largest road file [bytes]; reading more takes minutes.
MOST_BYTES = 2 * 10**6
_Number = Annotated[float, Field(strict=True)]  # no text, no truth value
_Positive = Annotated[float, Field(strict=True, gt=0)]
_Pair = tuple[_Number, _Number]
_BESIDE = 1.5  # largest gap between a lane's end and a following lane, in lane widths


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StraightEntry(_Strict):
    """``games.model.lanes.StraightLane`` as plain numbers."""

    kind: Literal["straight"] = "straight"
    start: _Pair
    direction: _Pair
    length: _Positive

    def curve(self) -> StraightLane:
        """The lane."""
        return StraightLane(self.start, self.direction, self.length)


class SineEntry(_Strict):
    """``games.model.lanes.SineLane`` as plain numbers, those of its axis first."""

    kind: Literal["sine"] = "sine"
    start: _Pair
    direction: _Pair
    length: _Positive
    amplitude: _Number
    pulsation: _Number
    phase: _Number

    def curve(self) -> SineLane:
        """The lane."""
        axis = StraightLane(self.start, self.direction, self.length)
        return SineLane(axis, self.amplitude, self.pulsation, self.phase)


class ArcEntry(_Strict):
    """``games.model.lanes.ArcLane`` as plain numbers."""

    kind: Literal["arc"] = "arc"
    centre: _Pair
    radius: _Positive
    start_phase: _Number
    end_phase: _Number

    def curve(self) -> ArcLane:
        """The lane."""
        return ArcLane(self.centre, self.radius, self.start_phase, self.end_phase)


CurveEntry = Annotated[StraightEntry | SineEntry | ArcEntry, Field(discriminator="kind")]


class LaneEntry(_Strict):
    """``envs.tracks.road.RoadLane`` as plain data: either points or curves."""

    points: list[_Pair] | None = None
    curves: list[CurveEntry] | None = None
    width: _Positive = DEFAULT_WIDTH
    following: list[str] = []

    @model_validator(mode="after")
    def _is_one_of_both(self) -> "LaneEntry":
        if bool(self.points) == bool(self.curves):
            raise ValueError("a lane has either points or curves")
        self.lane()
        return self

    def lane(self) -> RoadLane:
        """The lane."""
        curves = (
            curves_through(self.points)
            if self.points
            else tuple(entry.curve() for entry in self.curves or [])
        )
        return RoadLane(curves, self.width, tuple(self.following))


class PlayerEntry(_Strict):
    """The known targets of one player.

    Attributes:
        targets: target values by component of the state.
        lanes: names of the lanes of its route, in driving order.
        blend: length of the passage between these lanes [m].
        goal: goal position at the end [m].
    """

    targets: dict[str, _Number] = {}
    lanes: list[str] | None = Field(default=None, min_length=1, max_length=1000)
    blend: Annotated[float, Field(strict=True, gt=0, le=LONGEST)] | None = None
    goal: _Pair | None = None

    @model_validator(mode="after")
    def _is_on_earth(self) -> "PlayerEntry":
        for name, value in [*self.targets.items(), *(("goal", x) for x in self.goal or ())]:
            most = FASTEST if name == "speed" else FARTHEST
            if abs(value) > most:
                raise ValueError(f"{name} is {value:g}, beyond {most:g}")
        return self


class RoadFile(_Strict):
    """Lanes and players' targets, as described above.

    Attributes:
        scenario: name of the scenario whose costs the players have.
        lanes: lanes by name.
        players: targets by name of the player.
    """

    scenario: str | None = None
    lanes: dict[str, LaneEntry] = {}
    players: dict[str, PlayerEntry] = {}

    @model_validator(mode="after")
    def _knows_its_lanes(self) -> "RoadFile":
        named: dict[str, Iterable[str]] = {
            "lane": self.lanes,
            "player": self.players,
            "target": [name for player in self.players.values() for name in player.targets],
            "scenario": [] if self.scenario is None else [self.scenario],
        }
        for what, names in named.items():
            for name in names:
                check_shown(what, name)
        if self.lanes:  # else they are those of a map
            self.check_lanes()
        return self

    def check_lanes(self) -> None:
        """Refuse names of unknown lanes; ValueError says where it is and which are known."""
        named = [
            *((f"lane {name!r}", lane.following) for name, lane in self.lanes.items()),
            *((f"player {name!r}", player.lanes or []) for name, player in self.players.items()),
        ]
        for who, lanes in named:
            for lane in lanes:
                if lane not in self.lanes:
                    known = listed(list(self.lanes)) or "none"
                    raise ValueError(
                        f"{who} names the lane {lane[:LONGEST_NAME]!r}; there are: {known}"
                    )

    def road(self) -> Road | None:
        """The lanes as a road; None if there are none."""
        if not self.lanes:
            return None
        return Road({name: entry.lane() for name, entry in self.lanes.items()})


def read_road_file(path: Path) -> RoadFile:
    """Read a TOML file of lanes and targets; a UserError's line names the place."""
    check_input("road file", path, MOST_BYTES)
    with bad_input(f"{path} is not a TOML file", OSError):
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    try:
        return RoadFile.model_validate(data)
    except ValidationError as error:
        raise UserError(f"{path}: {first_problem(error)}") from error


def write_road_file(path: Path, content: RoadFile) -> None:
    """Write a TOML file, completely or not at all."""
    data = content.model_dump(exclude_none=True)
    text = tomli_w.dumps({name: value for name, value in data.items() if value})
    with whole_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def curve_entry(curve: Lane) -> StraightEntry | SineEntry | ArcEntry:
    """A curve of ``games.model.lanes`` as plain numbers; TypeError on a curve of another kind."""
    if isinstance(curve, StraightLane):
        return StraightEntry(**asdict(curve))
    if isinstance(curve, SineLane):
        values = asdict(curve)
        return SineEntry(**values.pop("axis"), **values)
    if isinstance(curve, ArcLane):
        return ArcEntry(**asdict(curve))
    raise TypeError(f"no plain numbers for a {type(curve).__name__}")


def lane_entries(road: Road) -> dict[str, LaneEntry]:
    """The lanes of a road as plain data, with exact curves, followed by lanes of this road only."""
    return {
        name: LaneEntry(
            curves=[curve_entry(curve) for curve in lane.curves],
            width=lane.width,
            following=[other for other in lane.following if other in road.lanes],
        )
        for name, lane in road.lanes.items()
    }


def route_curves(lanes: Mapping[str, LaneEntry], names: Sequence[str]) -> tuple[Lane, ...]:
    """The curves of a route of named lanes, one after the other."""
    return tuple(curve for name in names for curve in lanes[name].lane().curves)


def road_of_scenario(scenario: Scenario) -> Road | None:
    """The lanes of a scenario's HighwayEnv road; None if it is not on one."""
    if scenario.world != "highway_v0" or scenario.name not in ROAD_NAMES:
        return None
    return highway_road(scenario.name)


@lru_cache(maxsize=len(ROAD_NAMES))
def highway_road(name: str) -> Road:
    """All lanes of one of HighwayEnv's roads; ``a_b_0`` is the first lane from node a to b."""
    lanes = {
        (start, end, number): RoadLane((lane_curve(lane),), float(lane.width))
        for start, ends in road_network(name).graph.items()
        for end, parallel in ends.items()
        for number, lane in enumerate(parallel)
    }
    return Road(
        {
            _name(index): replace(
                lane,
                following=tuple(
                    _name(other)
                    for other, after in lanes.items()
                    if other[0] == index[1] and _goes_on(lane, after)
                ),
            )
            for index, lane in lanes.items()
        }
    )


def _name(index: tuple[str, str, int]) -> str:
    return "_".join(map(str, index))


def _goes_on(lane: RoadLane, after: RoadLane) -> bool:
    """Whether a car at the end of a lane can continue on another one, ahead or beside it."""
    gap = after.line[0] - lane.line[-1]
    turn = (after.line[1] - after.line[0]) @ (lane.line[-1] - lane.line[-2])
    return bool(turn > 0 and np.linalg.norm(gap) < _BESIDE * lane.width)


def road_file(scenario: Scenario) -> RoadFile:
    """The road and targets of a scenario's players, without weights, and lanes of plain numbers."""
    road = road_of_scenario(scenario)
    lanes = lane_entries(road) if road else {}
    players = {
        player_name(index): _player(player, player_name(index), lanes)
        for index, player in enumerate(scenario.game.players)
    }
    return RoadFile(scenario=scenario.name, lanes=lanes, players=players)


def _player(player: Player, name: str, lanes: dict[str, LaneEntry]) -> PlayerEntry:
    """The player's targets; lanes that only its route has are added to ``lanes``."""
    terms = (*player.preferences, *player.task)
    goals = [term.goal for term in terms if isinstance(term, FinalGoal)]
    routes = [term for term in terms if isinstance(term, LaneKeeping)]
    entry = PlayerEntry(
        targets={t.component: float(t.target) for t in terms if isinstance(t, StateDeviation)},
        goal=goals[0] if goals else None,
    )
    if not routes:
        return entry
    try:
        names = [_named(curve, name, lanes) for curve in routes[0].route]
    except TypeError:
        return entry
    return entry.model_copy(update={"lanes": names, "blend": float(routes[0].blend)})


def _named(curve: Lane, player: str, lanes: dict[str, LaneEntry]) -> str:
    """The name of the lane with exactly this curve, which is added if there is none."""
    entry = curve_entry(curve)
    for name, lane in lanes.items():
        if lane.curves == [entry]:
            return name
    new = next(name for k in count() if (name := f"{player}_lane_{k}") not in lanes)
    lanes[new] = LaneEntry(curves=[entry])
    return new
