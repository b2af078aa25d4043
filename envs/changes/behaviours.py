"""Players that do not play an open-loop Nash equilibrium of the game that estimators are told."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from olne_bench.envs.changes.change import Change, own_plan, played
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.behaviours import answers, uncoupled
from olne_bench.games.solve.feedback import solve_feedback
from olne_bench.games.solve.leading import NoPlanError, bounded, led_by_first
from olne_bench.games.solve.plan_costs import PlanCosts


class Replanning(Change):
    """Players take a new equilibrium, of a horizon as long, each ``dial`` seconds."""

    name, unit, high = "replanning", "s", 10.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game, motion = scenario.game, [start]
        steps = max(1, round(self.dial / game.dt))
        plan = own_plan(scenario, start, game.horizon).controls
        while len(motion) < horizon:
            found = played(game, scenario.weights, motion[-1], game.horizon, plan)
            motion.extend(found.states[1 : steps + 1])
            still = np.zeros((steps, *game.control_shape[1:]))
            plan = np.concatenate([found.controls, still])[steps : steps + len(found.controls)]
        return np.stack(motion[:horizon])


class Feedback(Change):
    """Players play a feedback Nash equilibrium: each knows how the others would react."""

    name, high = "feedback", 1.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game = replace(scenario.game, horizon=horizon)
        plan = own_plan(scenario, start, horizon)
        found = solve_feedback(game, scenario.weights, start, initial_controls=plan.controls)
        if not found.converged:
            raise NoEquilibriumError("no feedback equilibrium is found")
        return blended(game, start, plan.controls, found.controls, self.dial)


class Responding(Change):
    """Each player responds best to others that drive as if they were alone (level one)."""

    name, high = "responding", 1.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game, weights = replace(scenario.game, horizon=horizon), scenario.weights
        plan = own_plan(scenario, start, horizon).controls
        others = played(uncoupled(game, 1.0), weights, start, horizon, plan).controls
        with _found():
            answered = answers(game, weights, start, others, plan)
        return blended(game, start, plan, answered, self.dial)


class Leading(Change):
    """The first player leads: it chooses its plan knowing how the others will respond to it."""

    name, high = "leading", 1.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game = replace(scenario.game, horizon=horizon)
        plan = own_plan(scenario, start, horizon).controls
        with _found():
            followed = led_by_first(game, scenario.weights, start, plan)
        return blended(game, start, plan, followed, self.dial)


class Alone(Change):
    """Players mind the others less, at 1 not at all."""

    name, high = "alone", 1.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game, plan = uncoupled(scenario.game, self.dial), own_plan(scenario, start, horizon)
        return played(game, scenario.weights, start, horizon, plan.controls).states


class Entropic(Change):
    """Controls are drawn around the equilibrium: the better an action, the likelier it is.

    Each player's have the covariance ``dial`` times the inverse Hessian of its own cost, so the
    dial is a temperature in units of that cost (maximum entropy, Ziebart et al. 2010).
    """

    name, unit, high = "entropic", "of the cost", 100.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game = replace(scenario.game, horizon=horizon)
        plan = own_plan(scenario, start, horizon).controls
        curvatures = PlanCosts(game, scenario.weights, start).at(plan).own_curvatures
        drawn, size = plan.copy(), plan[:, 0].size
        for i in range(game.num_players):
            own = slice(i * size, (i + 1) * size)
            values, vectors = bounded(curvatures[own, own])
            spread = np.sqrt(self.dial / values)
            away = vectors @ (spread * rng.standard_normal(size))
            drawn[:, i] += away.reshape(drawn[:, i].shape)
        return rollout(game.dynamics, start, drawn, game.dt)


class Stock(Change):
    """HighwayEnv's drivers drive, IDM and MOBIL; the dial is their wanted time gap over 1.5 s."""

    name, unit, high = "stock", "times 1.5 s", 3.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        from olne_bench.envs.roads.road_scenario import speed_feature  # slow to import
        from olne_bench.envs.roads.stock_drivers import StockDriver, drive_stock
        from olne_bench.envs.worlds.scene import is_on_road

        if not is_on_road(scenario):
            raise ValueError(f"stock drivers need a road of HighwayEnv, {scenario.name!r} has none")
        gap = self.dial * StockDriver(0.0).time_gap
        wanted = [speed_feature(player).target for player in scenario.game.players]
        drivers = [StockDriver(float(speed), time_gap=gap) for speed in wanted]
        return drive_stock(scenario.name, scenario.game, start, drivers, horizon - 1)


def blended(
    game: Game, start: np.ndarray, plan: np.ndarray, other: np.ndarray, share: float
) -> np.ndarray:
    """The motion (T, N, n) of controls between two plans (T-1, N, m)."""
    return rollout(game.dynamics, start, (1 - share) * plan + share * other, game.dt)


@contextmanager
def _found() -> Iterator[None]:
    """Plans that are not found are a draw without a motion."""
    try:
        yield
    except NoPlanError as error:
        raise NoEquilibriumError(str(error)) from error
