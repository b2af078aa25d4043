"""Players that do not play an open-loop Nash equilibrium of the game that estimators are told."""

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from olne_bench.envs.changes.change import Change, own_plan, played
from olne_bench.envs.changes.plan_costs import PlanCosts
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.games.model.costs import CarProximity, Feature, Proximity
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.feedback import solve_feedback

#: Rounds in which followers respond to each other, and change [control units] that ends them.
_ROUNDS, _SETTLED = 30, 1e-9
#: Iterations of the leader's search.
_ITERATIONS = 20
#: Curvature of a cost, relative to the largest, that counts at least: no draw is without bounds.
_FLATTEST = 1e-6


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
        game = replace(scenario.game, horizon=horizon)
        plan = own_plan(scenario, start, horizon)
        others = played(uncoupled(game, 1.0), scenario.weights, start, horizon, plan.controls)
        answers = np.stack(
            [
                response(game, i, plan.controls[:, i], others.states, others.controls, scenario)
                for i in range(game.num_players)
            ],
            axis=1,
        )
        return blended(game, start, plan.controls, answers, self.dial)


class Leading(Change):
    """The first player leads: it chooses its plan knowing how the others will respond to it."""

    name, high = "leading", 1.0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        game = replace(scenario.game, horizon=horizon)
        plan = own_plan(scenario, start, horizon).controls
        costs, shape, size = (
            PlanCosts(game, scenario.weights, start),
            plan[:, 0].shape,
            plan[:, 0].size,
        )
        # In these units the leader's own cost bends the same in all directions.
        values, vectors = _bounded(costs.at(plan).own_curvatures[:size, :size])
        unit, followed = vectors / np.sqrt(values), plan

        def led(away: np.ndarray) -> tuple[float, np.ndarray]:
            """The leader's cost at its plan, and the derivative, the others' answers included."""
            nonlocal followed  # the last answers are near the next ones
            own = plan[:, 0] + (unit @ away).reshape(shape)
            followed = _followed(game, scenario, start, followed, own)
            at = costs.at(followed)
            bent = at.own_curvatures[size:]
            answers = -np.linalg.solve(bent[:, size:], bent[:, :size])
            slope = at.slopes[0, :size] + at.slopes[0, size:] @ answers
            return at.costs[0], unit.T @ slope

        found = minimize(
            led, np.zeros(size), jac=True, options={"maxiter": _ITERATIONS, "gtol": 1e-4}
        )
        own = plan[:, 0] + (unit @ found.x).reshape(shape)
        followed = _followed(game, scenario, start, followed, own)
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
            values, vectors = _bounded(curvatures[own, own])
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


def uncoupled(game: Game, share: float) -> Game:
    """The game in which a share of what players mind of the others is gone."""

    def changed(feature: Feature) -> Feature:
        if isinstance(feature, Proximity | CarProximity):
            return replace(feature, scale=(1 - share) * feature.scale)
        return feature

    return replace(game, players=tuple(player.changed(changed) for player in game.players))


def blended(
    game: Game, start: np.ndarray, plan: np.ndarray, other: np.ndarray, share: float
) -> np.ndarray:
    """The motion (T, N, n) of controls between two plans (T-1, N, m)."""
    return rollout(game.dynamics, start, (1 - share) * plan + share * other, game.dt)


def response(
    game: Game,
    player: int,
    plan: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    scenario: Scenario,
) -> np.ndarray:
    """A player's best plan (T-1, m) next to a first one, where the others move as given.

    Raises:
        NoEquilibriumError: if none is found.
    """
    found = best_responses(game, player, plan[None], states, controls, scenario.weights)
    if not found.converged[0]:
        raise NoEquilibriumError(f"player {player} finds no response")
    return np.asarray(found.controls[0])


def _bounded(curvature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of a symmetric matrix, none of them too small, and eigenvectors."""
    values, vectors = np.linalg.eigh(curvature)
    return np.maximum(values, _FLATTEST * values[-1]), vectors


def _followed(
    game: Game, scenario: Scenario, start: np.ndarray, plan: np.ndarray, own: np.ndarray
) -> np.ndarray:
    """Controls (T-1, N, m) in which all others respond to the first player's plan (T-1, m)."""
    controls = plan.copy()
    controls[:, 0] = own
    for _ in range(_ROUNDS):
        before = controls.copy()
        for i in range(1, game.num_players):
            states = rollout(game.dynamics, start, controls, game.dt)
            controls[:, i] = response(game, i, controls[:, i], states, controls, scenario)
        if np.abs(controls - before).max() < _SETTLED:
            break
    return controls
