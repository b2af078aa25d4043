"""The targets of one player, and their sources."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from olne_bench.envs.tracks.matching import driven, route
from olne_bench.envs.tracks.motion import Motion
from olne_bench.envs.tracks.road import Road
from olne_bench.envs.tracks.road_file import PlayerEntry, RoadFile, route_curves
from olne_bench.errors import UserError
from olne_bench.games.model.costs import Feature, FinalGoal, StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import LaneKeeping

FILE, DRAW, SCENARIO, DATA = "file", "draw", "scenario", "data"


@dataclass(frozen=True)
class Assumption:
    """An assumed target of a player.

    Attributes:
        player: name of the player.
        what: a component of the state, such as ``speed``, or ``lanes`` or ``goal``.
        value: the target as text.
        source: ``file``, ``draw``, ``scenario`` or ``data``.
        how: how it was computed from the data; empty for other sources.
    """

    player: str
    what: str
    value: str
    source: str
    how: str = ""


@dataclass(frozen=True)
class Known:
    """The sources of targets.

    Attributes:
        file: road file of the recording.
        road: lanes, if costs depend on them.
        players: players of the scenario.
    """

    file: RoadFile
    road: Road | None
    players: Sequence[Player]


def check_told(scenario: str, known: Known) -> list[str]:
    """Warnings on entries of the file that the scenario's costs do not use.

    Raises:
        UserError: on a target of a component that no cost has, which is a mistake.
    """
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
    """Look up one player's targets and note their sources.

    Attributes:
        player: name of the player.
        motion: motion of the player.
        known: sources of targets.
        drawn: the scenario's player with the same start, or None.
        assumptions: assumptions made so far.
    """

    player: str
    motion: Motion
    known: Known
    drawn: Player | None
    assumptions: list[Assumption] = field(default_factory=list)

    @property
    def _told(self) -> PlayerEntry:
        return self.known.file.players.get(self.player, PlayerEntry())

    def applied(self, costs: Player) -> Player:
        """The costs with this player's targets."""
        return Player(
            tuple(map(self._aimed, costs.preferences)), tuple(map(self._aimed, costs.task))
        )

    def _aimed(self, term: Feature) -> Feature:
        if isinstance(term, StateDeviation):
            return self._component(term)
        if isinstance(term, FinalGoal):
            return self._goal(term)
        if isinstance(term, LaneKeeping):
            return self._lanes(term)
        return term

    def _note(self, what: str, value: str, source: str, how: str = "") -> None:
        self.assumptions.append(Assumption(self.player, what, value, source, how))

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
        self._note(name, f"{target:.4g}", source, how)
        return replace(term, target=float(target))

    def _from_data(self, name: str, everybody: list[float]) -> tuple[float, str]:
        """The target of a component from the track, and how it was computed.

        Raises:
            UserError: if the track does not give it either.
        """
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
        if told.lanes is not None:
            self._note("lanes", ", ".join(told.lanes), FILE)
            curves = route_curves(self.known.file.lanes, told.lanes)
            return replace(term, route=curves, blend=told.blend or self._usual_blend())
        if self.drawn is not None:
            self._note("lanes", _count(len(term.route)), DRAW)
            return term
        assert self.known.road is not None, "a road is looked for where lanes matter"
        curves, names = route(self.known.road, driven(self.known.road, self.motion))
        self._note("lanes", ", ".join(names), DATA, "the lanes driven, by position and heading")
        return replace(term, route=curves, blend=told.blend or self._usual_blend())

    def _usual_blend(self) -> float:
        """The longest passage between lanes of any player of the scenario [m]."""
        return max(
            term.blend
            for player in self.known.players
            for term in player.task
            if isinstance(term, LaneKeeping)
        )


def _count(lanes: int) -> str:
    return f"{lanes} lane{'s'[: lanes > 1]}"
