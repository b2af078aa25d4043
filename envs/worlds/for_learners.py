"""``highway_v0`` for learners: ego-relative observations and actions, scaled to about one.

All players have the same shapes and the bounds -1 and 1, and none leaves before the episode ends.
So SuperSuit and Stable-Baselines3 accept the world as it is.
"""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from gymnasium.spaces import Box
from pettingzoo.utils import BaseParallelWrapper

from olne_bench.envs.highway_v0 import HighwayWorld
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.worlds.layout import Infos, Start, Step, player_index
from olne_bench.games.model.costs import StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import Lane, LaneKeeping

#: Values that are 1 in observations.
SPEED = 40.0  # [m/s], HighwayEnv's limit
SPEED_DIFFERENCE = 20.0  # [m/s] from the target
BESIDE_LANE = 8.0  # [m], two lanes
DISTANCE = 100.0  # [m] to others
#: Values that are 1 in actions, as in HighwayEnv's ``ContinuousAction``.
STEERING, ACCELERATION = np.pi / 4, 5.0  # [rad], [m/s^2]

OWN = (
    *("speed", "speed_over_target", "beside_lane", "cos_to_lane", "sin_to_lane", "time_left"),
    *("proximity_weight", "speed_weight", "acceleration_weight", "steering_weight"),
)
OTHER = ("present", "ahead", "beside", "speed_ahead", "speed_beside", "cos_heading", "sin_heading")


class ForLearners(BaseParallelWrapper[str, np.ndarray, np.ndarray]):
    """Ego-relative, normalised observations and actions; crashed players stay, blind and idle.

    **Observation**: ``Box(-1, 1, (10 + 7 (N-1),), float32)``, clipped; the numbers of ``OWN``, then
    those of ``OTHER`` for each other player, the nearest first. Positions and velocities of others
    are relative to the player, in a frame along its heading. Weights are the player's own.

    **Action**: ``Box(-1, 1, (2,), float32)``, clipped; steering and acceleration in units of
    ``STEERING`` and ``ACCELERATION``.

    **Reward**: the world's reward, and ``crash_reward`` once for a crash, as a crashed player has
    no further costs.

    **End**: all players terminate or are truncated together. After a crash a player observes zeros,
    its rewards are 0, its actions are ignored ("black death"), and ``infos[player]["crashed"]`` is
    true.

    Args:
        env: a world of ``highway_v0``. With ``reveal_truth=False`` its infos hold no truth.
        draws: number of draws among which resets choose; each is solved once and kept. None leaves
            the choice to the world, which draws a new one of 2^31 at every reset.
        crash_reward: added to the reward of the step in which a player crashes.

    Raises:
        ValueError: if the world is not of ``highway_v0`` or is wrapped, or ``draws`` is below 1.
    """

    def __init__(
        self, env: HighwayWorld, draws: int | None = None, crash_reward: float = -50.0
    ) -> None:
        if not isinstance(env, HighwayWorld):  # it reads states and would bypass sensors
            raise ValueError(
                f"ForLearners goes right around a world of highway_v0, got {type(env).__name__}"
            )
        if draws is not None and draws < 1:
            raise ValueError(f"draws must be at least 1, got {draws}")
        super().__init__(env)
        self._draws, self._crash_reward = draws, crash_reward
        self._choice: np.random.Generator | None = None  # copies made before a reset differ
        self._drawn: dict[int, Scenario] = {}  # by seed
        self._spaces: dict[int, Box] = {}
        self._actions = Box(-1.0, 1.0, (2,), dtype=np.float32)

    def observation_space(self, agent: str) -> Box:
        size = len(OWN) + len(OTHER) * (len(self.env.possible_agents) - 1)
        if size not in self._spaces:
            self._spaces[size] = Box(-1.0, 1.0, (size,), dtype=np.float32)
        return self._spaces[size]

    def action_space(self, agent: str) -> Box:
        return self._actions

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Start:
        if self._draws is None or options:
            _, infos = self.env.reset(seed=seed, options=options)
        else:
            infos = self._reset_to_one(seed, self._draws)
        self.agents = list(self.env.possible_agents)
        return self._observations(self.agents), self._infos(self.agents, infos)

    def step(self, actions: dict[str, np.ndarray]) -> Step:
        players, before = self.agents, self._world.crashed
        controls = {p: _controls(action) for p, action in actions.items() if p not in before}
        _, rewards, _, truncations, infos = self.env.step(controls)
        crashes = self._world.crashed - before
        over, cut = not self.env.agents, any(truncations.values())
        if over:
            self.agents = []
        return (
            self._observations(players),
            {p: rewards.get(p, 0.0) + self._crash_reward * (p in crashes) for p in players},
            dict.fromkeys(players, over and not cut),
            dict.fromkeys(players, over and cut),
            self._infos(players, infos),
        )

    def _reset_to_one(self, seed: int | None, draws: int) -> Infos:
        """Reset to one of so many draws, each of which is solved once."""
        if seed is not None or self._choice is None:
            self._choice = np.random.default_rng(seed)
        draw = int(self._choice.integers(draws))
        known = {"scenario": self._drawn[draw]} if draw in self._drawn else None
        infos: dict[str, dict[str, Any]]
        _, infos = self.env.reset(seed=draw, options=known)
        self._drawn[draw] = self._world.scenario
        return infos

    @property
    def _world(self) -> HighwayWorld:
        world = self.env.unwrapped
        assert isinstance(world, HighwayWorld)
        return world

    def _infos(self, players: list[str], infos: Infos) -> Infos:
        crashed = self._world.crashed
        return {p: infos.get(p, {}) | {"crashed": p in crashed} for p in players}

    def _observations(self, players: list[str]) -> dict[str, np.ndarray]:
        world = self._world
        state = world.state()
        states, left = state[:-1].reshape(-1, 4), 1 - state[-1] / world.state_space.high[-1]
        scenario, crashed = world.scenario, world.crashed
        seen = {}
        for player in players:
            index = player_index(player)
            if player in crashed:
                seen[player] = np.zeros(self.observation_space(player).shape, dtype=np.float32)
                continue
            own = _own(states[index], scenario.game.players[index], left)
            others = _others(states[index], np.delete(states, index, axis=0))
            vector = np.concatenate([own, scenario.weights[index], others.ravel()])
            seen[player] = np.clip(vector, -1.0, 1.0).astype(np.float32)
        return seen


def _controls(action: np.ndarray) -> np.ndarray:
    """Steering [rad] and acceleration [m/s^2] (2,) of an action."""
    clipped = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
    return np.asarray(clipped * (STEERING, ACCELERATION))


def _own(state: np.ndarray, player: Player, time_left: float) -> np.ndarray:
    """The entries of ``OWN`` before the weights, for a state (4,)."""
    target = next(f.target for f in player.preferences if isinstance(f, StateDeviation))
    route = next(feature.route for feature in player.task if isinstance(feature, LaneKeeping))
    beside, direction = _lane_coordinates(state[:2], route)
    to_lane = state[2] - direction
    return np.array(
        [
            state[3] / SPEED,
            (state[3] - target) / SPEED_DIFFERENCE,
            beside / BESIDE_LANE,
            np.cos(to_lane),
            np.sin(to_lane),
            time_left,
        ]
    )


def _others(state: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The entries of ``OTHER`` (N-1, 7) for the others' states (N-1, 4), the nearest first."""
    cos, sin = np.cos(state[2]), np.sin(state[2])
    frame = np.array([[cos, -sin], [sin, cos]])
    offsets = (others[:, :2] - state[:2]) @ frame
    directions = np.column_stack([np.cos(others[:, 2]), np.sin(others[:, 2])]) @ frame
    velocities = others[:, 3:] * directions - (state[3], 0.0)
    order = np.argsort(np.hypot(*offsets.T), kind="stable")
    present = np.ones((len(others), 1))
    blocks = [present, offsets / DISTANCE, velocities / (2 * SPEED), directions]
    return np.hstack(blocks)[order]


def _lane_coordinates(position: np.ndarray, route: tuple[Lane, ...]) -> tuple[float, float]:
    """Distance [m] of a position beside its lane of a route, and the lane's direction [rad].

    Its lane is the first one whose end is not passed.
    """
    rows = _locator(route)(position).full()  # (lanes, 3): along, beside, direction
    lengths = np.array([lane.length for lane in route])
    ahead = np.flatnonzero(rows[:, 0] <= lengths)
    _, beside, direction = rows[ahead[0] if len(ahead) else -1]
    return float(beside), float(direction)


@lru_cache(maxsize=256)
def _locator(route: tuple[Lane, ...]) -> ca.Function:
    position = ca.SX.sym("p", 2)
    rows = [ca.horzcat(*lane.locate(position)) for lane in route]
    return ca.Function("locate", [position], [ca.vertcat(*rows)])
