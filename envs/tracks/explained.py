"""Explain a recording by a scenario's costs, and note all assumptions.

The targets of a player (speed, lane, goal) are taken, in this order,

- from the ``file``, if the recording has them;
- from the ``draw``, if the scenario has a player with the same start;
- from the ``scenario``, if all of its players have the same;
- from the ``data``: the median speed, the lanes that were driven, the last position.

A target speed and a place in the lane that are taken from the data are guesses. Where they are
``free``, they are unknown numbers about these, and estimated with the weights.

Whom a player follows is read off the data, at the last sample.

Costs are sums over steps. If tracks have another time step than the scenario, efforts and goals are
rescaled, so that weights keep their meaning.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from olne_bench.envs.recordings.recording_file import RecordingFile
from olne_bench.envs.roads.road_scenario import RoadFamily
from olne_bench.envs.scenarios import check_options, get_scenario, is_family, scenario_options
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.tracks.grid import Motion, roughness
from olne_bench.envs.tracks.leaders import Scene, standing_cars
from olne_bench.envs.tracks.matching import check_on_road, driven, lane_warnings, route
from olne_bench.envs.tracks.road import Road
from olne_bench.envs.tracks.road_file import PlayerEntry, RoadFile, road_of_scenario, route_curves
from olne_bench.errors import UserError
from olne_bench.games.model.costs import (
    ControlEffort,
    Feature,
    FinalGoal,
    Following,
    StateDeviation,
)
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import LaneKeeping, StraightLane
from olne_bench.games.model.unknowns import Unknown

FILE, DRAW, SCENARIO, DATA = "file", "draw", "scenario", "data"
#: How far guesses may be off, one standard deviation, and how many of them at most.
_SPEED_SPREAD, _OFFSET_SPREAD, _REACH = 3.0, 0.5, 5.0  # [m/s], [m]
START_TOLERANCE = 0.25  # [m] from a drawn player's start, in addition to three times the noise


@dataclass(frozen=True)
class Assumption:
    """An assumed target of a player."""

    player: str
    what: str  # a component of the state, such as ``speed``, or ``lanes`` or ``goal``
    value: str
    source: str  # ``file``, ``draw``, ``scenario`` or ``data``
    how: str = ""  # how it was computed from the data; empty for other sources
    is_free: bool = False  # whether it is only where an estimate begins


@dataclass(frozen=True)
class Known:
    """The sources of targets."""

    file: RoadFile  # road file of the recording
    road: Road | None  # lanes, if costs depend on them
    players: Sequence[Player]  # players of the scenario


def check_told(scenario: str, known: Known) -> list[str]:
    """Warnings on entries that costs do not use; UserError on a target of an unknown component."""
    terms = [term for player in known.players for term in (*player.preferences, *player.task)]
    components = sorted({term.component for term in terms if isinstance(term, StateDeviation)})
    warnings = []
    for name, entry in known.file.players.items():
        for target in entry.targets:
            if target not in components:
                raise UserError(
                    f"the road file has a target of {target!r} for player {name!r}; costs of "
                    f"{scenario!r} have: {', '.join(components) or 'none'}"
                )
        for what, told, kind in (
            ("lanes", entry.lanes, LaneKeeping),
            ("goal", entry.goal, FinalGoal),
        ):
            if told is not None and not any(isinstance(term, kind) for term in terms):
                warnings.append(
                    f"{what} of player {name!r}: not used, {scenario!r} has no such cost"
                )
    return warnings


@dataclass
class Targets:
    """Look up one player's targets and note their sources."""

    player: str
    motion: Motion
    known: Known  # sources of targets
    drawn: Player | None  # the scenario's player with the same start, or None
    leader: int = -1  # index of whom it follows, -1 for nobody
    names: Sequence[str] = ()  # of all players
    free: bool = False  # whether guesses are unknown numbers
    assumptions: list[Assumption] = field(default_factory=list)  # assumptions made so far

    def __post_init__(self) -> None:
        self._told = self.known.file.players.get(self.player, PlayerEntry())

    def applied(self, costs: Player) -> Player:
        """The costs with this player's targets."""
        return costs.changed(self._aimed)

    def _aimed(self, term: Feature) -> Feature:
        if isinstance(term, StateDeviation):
            return self._component(term)
        if isinstance(term, FinalGoal):
            return self._goal(term)
        if isinstance(term, LaneKeeping):
            return self._lanes(term)
        if isinstance(term, Following):
            return self._following(term)
        return term

    def _following(self, term: Following) -> Feature:
        whom = self.names[self.leader] if self.leader >= 0 else "nobody"
        self._note("leader", whom, DATA, "who drives ahead in its lane at the end")
        return replace(term, leader=self.leader)

    def _note(
        self, what: str, value: str, source: str, how: str = "", is_free: bool = False
    ) -> None:
        self.assumptions.append(Assumption(self.player, what, value, source, how, is_free))

    def _component(self, term: StateDeviation) -> Feature:
        name = term.component
        source, how = FILE, ""
        target = self._told.targets.get(name)
        everybody = {
            other.target
            for player in self.known.players
            for other in (*player.preferences, *player.task)
            if isinstance(other, StateDeviation) and other.component == name
        }
        if target is None and self.drawn is not None:
            target, source = term.target, DRAW
        elif target is None and len(everybody) == 1:
            target, source = term.target, SCENARIO
        elif target is None:
            target, how = self._from_data(name, sorted(everybody))
            source = DATA
        if source == DATA and name == "speed" and self.free:
            how, shown = f"{how}, then estimated", f"{target:.4g} ± {_SPEED_SPREAD:g}"
            self._note(name, shown, source, how, is_free=True)
            return replace(term, target=_guess("target speed", "m/s", float(target), _SPEED_SPREAD))
        self._note(name, f"{target:.4g}", source, how)
        return replace(term, target=float(target))

    def _from_data(self, name: str, everybody: list[float]) -> tuple[float, str]:
        """The target of a component from the track, and how it was computed."""
        told = {"speed": self.motion.speeds, "heading": self.motion.headings}.get(name)
        if told is not None and np.isfinite(told).any():
            return float(np.nanmedian(told)), f"median {name}"
        if name not in ("px", "py"):
            raise UserError(
                f"the target of {name!r} of player {self.player!r} is unknown; give it in a TOML "
                "file to 'olne-bench import --road'"
            )
        column = ("px", "py").index(name)
        last = float(self.motion.positions[self.motion.seen][-1, column])
        nearest = min(everybody, key=lambda value: abs(value - last))
        spacing = np.diff(everybody).min()
        if abs(nearest - last) < spacing / 2:
            return nearest, "the scenario's lane nearest to where it was last seen"
        return last, "where it was last seen"

    def _goal(self, term: FinalGoal) -> Feature:
        goal, source, how = self._told.goal, FILE, ""
        if goal is None and self.drawn is not None:
            goal, source = term.goal, DRAW
        elif goal is None:
            x, y = self.motion.positions[self.motion.seen][-1]
            goal, source, how = (float(x), float(y)), DATA, "where it was last seen"
        self._note("goal", f"({goal[0]:.4g}, {goal[1]:.4g})", source, how)
        return replace(term, goal=goal)

    def _lanes(self, term: LaneKeeping) -> Feature:
        told = self._told
        blend = told.blend or self._usual_blend()
        if told.lanes is not None:
            self._note("lanes", ", ".join(told.lanes), FILE)
            return replace(term, route=route_curves(self.known.file.lanes, told.lanes), blend=blend)
        if self.drawn is not None:
            count = len(term.route)
            self._note("lanes", f"{count} lane{'s'[: count > 1]}", DRAW)
            return term
        assert self.known.road is not None, "a road is looked for where lanes matter"
        curves, names = route(self.known.road, driven(self.known.road, self.motion))
        self._note("lanes", ", ".join(names), DATA, "the lanes driven, by position and heading")
        offset = _guess("offset", "m", 0.0, _OFFSET_SPREAD) if self.free else 0.0
        return replace(term, route=curves, blend=blend, offset=offset)

    def _usual_blend(self) -> float:
        """The longest passage between lanes of any player of the scenario [m]."""
        return max(
            term.blend
            for player in self.known.players
            for term in player.task
            if isinstance(term, LaneKeeping)
        )


def _guess(name: str, unit: str, value: float, spread: float) -> Any:
    """An unknown number, which stands where a known one would."""
    reach = _REACH * spread
    return Unknown(name, unit, value - reach, value + reach, mean=value, deviation=spread)


@dataclass(frozen=True)
class Explained:
    """A game that may explain a recording."""

    #: Holds the game, whose players are those of the recording, and the noise scales; its weights
    #: and initial state are placeholders.
    scenario: Scenario
    assumptions: tuple[Assumption, ...]  # the assumed targets of each player, with their sources
    noise: float  # upper estimate of the noise on positions from the data [m]; NaN if unknown
    warnings: tuple[str, ...]  # one line each


def explain(
    name: str,
    seed: int | None,
    known: RecordingFile,
    episode: int,
    noise: float | None = None,
    free: bool = False,
    ahead: float = 0.0,
) -> Explained:
    """Make the game of a recording's episode, whose players have the costs of a named scenario.

    The seed is that of the draw that the tracks show, if they show one; ``noise`` that of positions
    [m], if known; ``free`` leaves guesses to be estimated; the game ends ``ahead`` seconds after
    the last sample. UserError if scenario and recording do not fit each other.
    """
    states, entry = known.states[episode], known.metadata.episodes[episode]
    names, dt = known.metadata.state_names, known.metadata.dt
    scenario = costs_of(name, seed, states.shape[1])
    told = entry.road or RoadFile()
    rough = roughness(states[..., :2])
    level = noise if noise is not None else (rough if np.isfinite(rough) else 0.0)
    drawn, warnings = _drawn(name, scenario, seed, entry.players, states, told, level)
    motions = [Motion.of(states[:, i], names, dt) for i in range(states.shape[1])]
    road = _road(scenario, told)
    if road is not None:
        check_on_road(road, entry.players, motions, level)
    sources = Known(told, road, scenario.game.players)
    warnings += check_told(name, sources)
    players, assumptions = _aimed_players(scenario, sources, motions, drawn, entry.players, free)
    players = [_at_step(player, dt / scenario.game.dt) for player in players]
    if road is not None:
        warnings += lane_warnings(entry.players, motions, players, level)
    steps = round(ahead / dt)
    if steps:
        _check_goals(assumptions)
    game = replace(scenario.game, players=tuple(players), horizon=len(states) + steps, dt=dt)
    count = len(players)
    explained = replace(
        scenario,
        game=game,
        weights=np.full((count, game.num_weights), 1 / game.num_weights),
        initial_state=np.zeros((count, game.dynamics.state_size)),
    )
    return Explained(explained, tuple(assumptions), rough, tuple(warnings))


def _check_goals(assumptions: Sequence[Assumption]) -> None:
    """Refuse goals at the end of a game that the data do not show."""
    for one in assumptions:
        if one.what == "goal" and one.source == DATA:
            raise UserError(
                f"--ahead: player {one.player!r} has a goal at the end of the game, after the "
                "recording; give it in a TOML file to 'olne-bench import --road', or leave "
                "--ahead away"
            )


def _aimed_players(
    scenario: Scenario,
    sources: Known,
    motions: Sequence[Motion],
    drawn: Sequence[int] | None,
    names: Sequence[str],
    free: bool,
) -> tuple[list[Player], list[Assumption]]:
    """The scenario's costs with each player's own targets, and what was assumed for them."""
    leaders = [-1] * len(motions)
    if sources.road is not None and any(
        isinstance(feature, Following) for feature in sources.players[0].features
    ):
        leaders = _leaders(sources.road, names, motions)
    players, assumptions = [], []
    for i, (name, motion) in enumerate(zip(names, motions, strict=True)):
        match = None if drawn is None else drawn[i]
        costs = scenario.game.players[0 if match is None else match]
        known = None if match is None else costs
        targets = Targets(name, motion, sources, known, leaders[i], names, free)
        players.append(targets.applied(costs))
        assumptions += targets.assumptions
    return players, assumptions


def _leaders(road: Road, names: Sequence[str], motions: Sequence[Motion]) -> list[int]:
    """Index of the player whom each follows where it is last seen, -1 for nobody."""
    found = []
    for name, motion in zip(names, motions, strict=True):
        at = int(np.flatnonzero(motion.seen)[-1])
        scene = Scene(road, standing_cars(names, motions, at))
        leader = scene.leader(name) if name in scene.cars else None
        found.append(-1 if leader is None else list(names).index(leader))
    return found


def costs_of(name: str, seed: int | None, count: int) -> Scenario:
    """A scenario whose players have the costs; UserError on an unknown name or number of players.

    Without a seed, its draw may be unplayable.
    """
    try:
        if seed is None and is_family(name):
            plugin = check_options(name)
            if isinstance(plugin, RoadFamily):
                return plugin.propose(np.random.default_rng(0), plugin.count(0))
        sized = {"num_players": count} if "num_players" in scenario_options(name) else {}
        return get_scenario(name, seed, **(sized if seed is not None else {}))
    except (ValueError, NoEquilibriumError) as error:
        raise UserError(f"--scenario: {error}") from error


def _drawn(
    name: str,
    scenario: Scenario,
    seed: int | None,
    names: Sequence[str],
    states: np.ndarray,
    told: RoadFile,
    noise: float,
) -> tuple[list[int] | None, list[str]]:
    """The scenario's player for each player of the recording, or None, and warnings."""
    players = scenario.game.players
    alike = len({_without_targets(player) for player in players}) == 1
    if alike and all(player in told.players for player in names):
        return None, []
    starts = scenario.initial_state[:, :2]
    matched = None
    if (seed is not None or not is_family(name)) and len(starts) >= len(names):
        matched = _by_start(starts, states[0, :, :2], START_TOLERANCE + 3 * noise)
    if matched is None and seed is not None:
        raise UserError(
            f"--seed {seed}: the players do not start where those of that draw of "
            f"{name!r} do; leave --seed away to take targets from the file or the data"
        )
    if matched is not None or alike:
        return matched, []
    if len(players) != len(names):
        raise UserError(
            f"--scenario {name!r} has {len(players)} players with different costs, "
            f"the recording has {len(names)}"
        )
    order = ", ".join(f"{player} = {k}" for k, player in enumerate(names))
    return list(range(len(names))), [
        f"players of {name!r} have different costs, and none starts where another does: "
        f"they are taken in the order of the file: {order}"
    ]


def _by_start(starts: np.ndarray, seen: np.ndarray, tolerance: float) -> list[int] | None:
    """For each seen position (N, 2) the player with that start (P, 2); None if any has none."""
    if not np.isfinite(seen).all():
        return None
    apart = np.linalg.norm(seen[:, None] - starts, axis=-1)
    rows, columns = linear_sum_assignment(apart)
    return [int(k) for k in columns] if apart[rows, columns].max() < tolerance else None


def _without_targets(player: Player) -> Player:
    nowhere = (StraightLane((0.0, 0.0), (1.0, 0.0), 1.0),)

    def bare(term: Feature) -> Feature:
        if isinstance(term, StateDeviation):
            return replace(term, target=0.0)
        if isinstance(term, FinalGoal):
            return replace(term, goal=(0.0, 0.0))
        if isinstance(term, LaneKeeping):
            return replace(term, route=nowhere, blend=1.0)
        if isinstance(term, Following):
            return replace(term, leader=-1)
        return term

    return player.changed(bare)


def _road(scenario: Scenario, told: RoadFile) -> Road | None:
    """The lanes of the file, else of the scenario's road; None if no cost depends on lanes."""
    terms = [term for player in scenario.game.players for term in player.task]
    if not any(isinstance(term, LaneKeeping) for term in terms):
        return None
    road = told.road() or road_of_scenario(scenario)
    if road is None:
        raise UserError(
            f"players of {scenario.name!r} keep to lanes, and nothing says where these are: "
            "give them in a TOML file to 'olne-bench import --road'"
        )
    return road


def _at_step(player: Player, ratio: float) -> Player:
    """The player's costs at a time step that is ``ratio`` times the scenario's."""

    def rescaled(term: Feature) -> Feature:
        if isinstance(term, ControlEffort):
            return replace(term, scale=term.scale / ratio**2)
        if isinstance(term, FinalGoal):
            return replace(term, scale=term.scale / ratio)
        return term

    return player if abs(ratio - 1) < 1e-9 else player.changed(rescaled)
