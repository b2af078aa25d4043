"""Players that play an equilibrium, of a game other than the one that estimators are told."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from olne_bench.envs.changes.change import Change, own_plan, played
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.model.costs import CarProximity, Feature, FinalGoal, Stage, StateDeviation
from olne_bench.games.model.dynamics import bicycle
from olne_bench.games.model.game import Game
from olne_bench.games.model.lanes import ArcLane, Lane, LaneKeeping, SineLane, StraightLane


class _OtherGame(Change):
    """Players play the game that ``really`` gives."""

    def really(self, game: Game) -> Game:
        """The game that is played; ValueError if the change does not apply to it."""
        raise NotImplementedError

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game, plan = self.really(scenario.game), own_plan(scenario, start, horizon)
        return played(game, scenario.weights, start, horizon, plan.controls).states

    def _changed(self, game: Game, kind: type, change: Callable[[Feature], Feature]) -> Game:
        """The game with features of a kind changed; ValueError if it has none."""

        def one(feature: Feature) -> Feature:
            return change(feature) if isinstance(feature, kind) else feature

        players = tuple(player.changed(one) for player in game.players)
        if players == game.players:
            raise ValueError(f"{self.name!r} does not apply: no player has a {kind.__name__}")
        return replace(game, players=players)


@dataclass(frozen=True)
class LateralAcceleration:
    """``scale * (speed * turning)^2``, where turning is the first control: comfort in bends."""

    scale: float = 1.0
    name: str = "lateral_acceleration"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        assert stage.control is not None, "a running stage has controls"
        return self.scale * (stage.own_state("speed") * stage.control[0]) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 0.0


class HiddenCost(_OtherGame):
    """Players also mind ``dial (speed * turning)^2``, as much as their mean weight."""

    name, high = "hidden_cost", 1000.0

    def really(self, game: Game) -> Game:
        hidden = LateralAcceleration(float(self.dial))
        players = tuple(replace(one, task=(*one.task, hidden)) for one in game.players)
        return replace(game, players=players)


class TargetSpeed(_OtherGame):
    """Players want to drive ``dial`` faster than estimators are told."""

    name, unit, low, high = "target_speed", "m/s", -20.0, 20.0

    def really(self, game: Game) -> Game:
        def faster(feature: Feature) -> Feature:
            if isinstance(feature, StateDeviation) and feature.component == "speed":
                return replace(feature, target=feature.target + self.dial)
            return feature

        return self._changed(game, StateDeviation, faster)


class Goal(_OtherGame):
    """Goals are ``dial`` metres to the left, along y, of those that estimators are told."""

    name, unit, low, high = "goal", "m", -10.0, 10.0

    def really(self, game: Game) -> Game:
        def moved(feature: Feature) -> Feature:
            assert isinstance(feature, FinalGoal)
            return replace(feature, goal=(feature.goal[0], feature.goal[1] + self.dial))

        return self._changed(game, FinalGoal, moved)


class LaneOffset(_OtherGame):
    """Players keep ``dial`` metres to one side of the middle of their lanes."""

    name, unit, low, high = "lane_offset", "m", -2.0, 2.0

    def really(self, game: Game) -> Game:
        def beside(feature: Feature) -> Feature:
            assert isinstance(feature, LaneKeeping)
            route = tuple(_beside(lane, self.dial) for lane in feature.route)
            return replace(feature, route=route)

        return self._changed(game, LaneKeeping, beside)


class VehicleLength(_OtherGame):
    """Players keep distances as of cars that are longer by the share ``dial``."""

    name, low, high = "vehicle_length", -0.9, 3.0

    def really(self, game: Game) -> Game:
        def longer(feature: Feature) -> Feature:
            assert isinstance(feature, CarProximity)
            return replace(feature, length=(1 + self.dial) * feature.length)

        return self._changed(game, CarProximity, longer)


class Wheelbase(_OtherGame):
    """Cars have a wheelbase that is longer by the share ``dial``."""

    name, low, high = "wheelbase", -0.9, 3.0

    def really(self, game: Game) -> Game:
        known = game.dynamics.step
        axle, steps = getattr(known, "rear_axle", None), getattr(known, "sub_steps", 1)
        if axle is None:
            raise ValueError(f"{self.name!r} does not apply: {game.dynamics.name!r} has no wheels")
        return replace(game, dynamics=bicycle((1 + self.dial) * axle, steps))


class UnseenCars(Change):
    """There are ``dial`` more players, whom nobody reports."""

    name, unit, high = "unseen_cars", "cars", 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dial != int(self.dial):
            raise ValueError(f"the dial of {self.name!r} is a whole number, got {self.dial!r}")

    @property
    def unreported(self) -> int:
        return int(self.dial)

    def told(self, scenario: Scenario) -> Scenario:
        count = scenario.game.num_players - self.unreported
        return replace(
            scenario,
            game=replace(scenario.game, players=scenario.game.players[:count]),
            weights=scenario.weights[:count],
            initial_state=scenario.initial_state[:count],
        )


def _beside(lane: Lane, offset: float) -> Lane:
    """The lane that is ``offset`` metres to the side on which ``beside`` is positive."""
    if isinstance(lane, StraightLane):
        cos, sin = lane.direction
        start = lane.start[0] - offset * sin, lane.start[1] + offset * cos
        return replace(lane, start=start)
    if isinstance(lane, SineLane):
        axis = _beside(lane.axis, offset)
        assert isinstance(axis, StraightLane)
        return replace(lane, axis=axis)
    if isinstance(lane, ArcLane):
        turn = 1.0 if lane.end_phase > lane.start_phase else -1.0
        return replace(lane, radius=lane.radius - turn * offset)
    raise ValueError(f"a {type(lane).__name__} cannot be moved to the side")
