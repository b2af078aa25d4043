"""Explain a recording by a scenario's costs, and note all assumptions.

The targets of a player (speed, lane, goal) are taken, in this order,

- from the ``file``, if the recording has them;
- from the ``draw``, if the scenario has a player with the same start;
- from the ``scenario``, if all of its players have the same;
- from the ``data``: the median speed, the lanes that were driven, the last position.

Costs are sums over steps. If tracks have another time step than the scenario, efforts and goals are
rescaled, so that weights keep their meaning.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from olne_bench.envs.recordings.recording_file import RecordingFile
from olne_bench.envs.roads.road_scenario import RoadFamily
from olne_bench.envs.scenarios import (
    check_options,
    get_scenario,
    is_family,
    scenario_options,
)
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.tracks.matching import check_on_road, lane_warnings
from olne_bench.envs.tracks.motion import Motion, roughness
from olne_bench.envs.tracks.of_scenario import road_of_scenario
from olne_bench.envs.tracks.road import Road
from olne_bench.envs.tracks.road_file import RoadFile
from olne_bench.envs.tracks.targets import Assumption, Known, Targets, check_told
from olne_bench.errors import UserError
from olne_bench.games.model.costs import ControlEffort, Feature, FinalGoal, StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import LaneKeeping, StraightLane

START_TOLERANCE = 0.25  # [m] from a drawn player's start, in addition to three times the noise


@dataclass(frozen=True)
class Explained:
    """A game that may explain a recording.

    Attributes:
        scenario: holds the game, whose players are those of the recording, and the noise scales;
            its weights and initial state are placeholders.
        assumptions: the assumed targets of each player, with their sources.
        noise: upper estimate of the noise on positions from the data [m]; NaN if unknown.
        warnings: one line each.
    """

    scenario: Scenario
    assumptions: tuple[Assumption, ...]
    noise: float
    warnings: tuple[str, ...]


def explain(
    name: str, seed: int | None, known: RecordingFile, episode: int, noise: float | None = None
) -> Explained:
    """Make the game of a recording's episode.

    Args:
        name: name of the scenario whose costs the players have.
        seed: the draw that the tracks show; None if they do not show a draw.
        known: the recording.
        episode: index of the episode.
        noise: noise of positions [m], if known.

    Raises:
        UserError: if scenario and recording do not fit each other.
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
    players, assumptions = [], []
    for i, (player, motion) in enumerate(zip(entry.players, motions, strict=True)):
        match = None if drawn is None else drawn[i]
        costs = scenario.game.players[0 if match is None else match]
        targets = Targets(player, motion, sources, None if match is None else costs)
        players.append(_at_step(targets.applied(costs), dt / scenario.game.dt))
        assumptions += targets.assumptions
    if road is not None:
        warnings += lane_warnings(entry.players, motions, players, level)
    game = replace(scenario.game, players=tuple(players), horizon=len(states), dt=dt)
    count = len(players)
    explained = replace(
        scenario,
        game=game,
        weights=np.full((count, game.num_weights), 1 / game.num_weights),
        initial_state=np.zeros((count, game.dynamics.state_size)),
    )
    return Explained(explained, tuple(assumptions), rough, tuple(warnings))


def costs_of(name: str, seed: int | None, count: int) -> Scenario:
    """A scenario whose players have the costs; without a seed, its draw may be unplayable.

    Raises:
        UserError: on an unknown scenario, or a number of players that it does not hold.
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
        return term

    return Player(tuple(map(bare, player.preferences)), tuple(map(bare, player.task)))


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

    if abs(ratio - 1) < 1e-9:
        return player
    return Player(tuple(map(rescaled, player.preferences)), tuple(map(rescaled, player.task)))
