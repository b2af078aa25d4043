"""The ego's plan, each step again: an equilibrium of the game of the ego and the cars around it.

The ego keeps a distance to each other car as a hard constraint. It tries, in this order and with
bounded effort,

1. the variational equilibrium near its former plan, then one from scratch;
2. the equilibrium without constraints, where the others leave no room or none is found;
3. the rest of its former plan;
4. to brake.

``constant_velocity`` takes the others to drive straight on, and the ego is alone in planning: it
responds (``envs.drive.response``), and pays for coming too near.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.envs.drive.cars import FIRST_STEP, MOTION, STEP, Mind, drive_game, least_gaps
from olne_bench.envs.drive.response import LEAST_GAP, response_with_room
from olne_bench.envs.roads.footprint import CarsApart
from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import grown_plans
from olne_bench.games.solve.constrained import solution_near, variational_solution
from olne_bench.games.solve.continuation import coupled_features
from olne_bench.games.solve.newton import Root, newton_root, unpack
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE, solve_olne

#: States of a plan: 4 s.
HORIZON = round(4.0 / STEP) + 1

#: How a plan was found.
CONSTRAINED, UNCONSTRAINED, KEPT, BRAKED = "constrained", "unconstrained", "kept", "braked"

_WARM_ITERATIONS = 40
_ATTEMPTS = 2  # from scratch
_ROUNDS = 2  # of best responses
_BRAKING = 8.0  # [m/s^2]


@dataclass(frozen=True)
class EgoPlan:
    """A plan of the ego, and what it expects of the others."""

    numbers: tuple[int, ...]  # of the cars, the ego first
    states: np.ndarray  # (T, N, 4), the present ones first
    controls: np.ndarray  # (T-1, N, 2)
    costates: np.ndarray  # (T-1, N, 4)
    kind: str  # how it was found
    guesses: np.ndarray | None = None  # (S, T, N, 4) by guesses at the others' minds

    @property
    def control(self) -> np.ndarray:
        """The ego's first control (2,), within what the simulator takes."""
        largest = np.array([MAX_STEERING, MAX_ACCELERATION])
        return np.asarray(np.clip(self.controls[0, 0], -largest, largest))


class Planner(ABC):
    """Plans again at each step, from its former plan; where it finds none, it keeps that."""

    def __init__(self) -> None:
        self._former: EgoPlan | None = None

    def plan(self, minds: Sequence[Mind], states: np.ndarray) -> EgoPlan:
        """The next plan, from minds and states (N, 4) of all cars as the ego knows them."""
        numbers = tuple(mind.number for mind in minds)
        found = self._found(minds, numbers, states)
        self._former = found or kept_or_braked(self._former, numbers, states)
        return self._former

    @abstractmethod
    def _found(
        self, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        """A new plan; None if none is found."""


class GamePlanner(Planner):
    """Plans by the game of the ego and the others."""

    def _found(
        self, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        game, weights = planned_game(minds), np.stack([mind.weights for mind in minds])
        found = equilibrium_near(game, weights, states, self._shifted(numbers, states))
        return found and EgoPlan(numbers, *found)

    def _shifted(self, numbers: tuple[int, ...], states: np.ndarray) -> Root | None:
        """The former plan from now on; None if it was about other cars."""
        former = self._former
        if former is None or former.numbers != numbers or former.kind in (KEPT, BRAKED):
            return None
        controls, costates = later(former.controls), later(former.costates)
        return Root(rollout(MOTION, states, controls, STEP), controls, costates, np.inf)


class StraightOnPlanner(Planner):
    """The others drive straight on along their velocity, and the ego plans alone among them."""

    def _found(
        self, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        controls = np.zeros((HORIZON - 1, len(minds), MOTION.control_size))
        controls[:, 0] = self._first_plan(minds[0], states[0])
        motion = rollout(MOTION, states, controls, STEP)
        return planned_response(minds[0], numbers, motion, controls)

    def _first_plan(self, ego: Mind, state: np.ndarray) -> np.ndarray:
        """Controls (T-1, 2) to begin with: the former plan's, or those of an empty road."""
        if self._former is not None and self._former.kind not in (KEPT, BRAKED):
            return later(self._former.controls)[:, 0]
        game = drive_game([ego.player], HORIZON)
        return grown_plans(game, state[None], ego.weights[None])[:, 0]


def planned_game(minds: Sequence[Mind]) -> Game:
    """The game in which the ego, player 0, keeps a distance from each other."""
    constraints = tuple(CarsApart((0, j), FIRST_STEP, LEAST_GAP) for j in range(1, len(minds)))
    return drive_game([mind.player for mind in minds], HORIZON, constraints)


def equilibrium_near(
    game: Game, weights: np.ndarray, states: np.ndarray, near: Root | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, str] | None:
    """States, controls and costates of an equilibrium, and how it was found; None if none is."""
    free = replace(game, constraints=())
    if near is not None and not np.isfinite(near.states).all():
        near = None
    if near is not None and game.constraints:
        solution = solution_near(game, near, weights, max_iterations=_WARM_ITERATIONS)
        if solution.solved:
            return *unpack(game, solution.z), CONSTRAINED
    if near is not None and not game.constraints:
        root = newton_root(free, near.states, near.controls, near.costates, weights)
        if root.residual < RESIDUAL_TOLERANCE:
            return root.states, root.controls, root.costates, CONSTRAINED
    controls = plans_alone(free, weights, states) if near is None else near.controls
    if game.constraints:
        solution = variational_solution(game, weights, states, controls, most_attempts=_ATTEMPTS)
        if solution.solved:
            return *unpack(game, solution.z), CONSTRAINED
    found = solve_olne(free, weights, states, initial_controls=controls, max_rounds=_ROUNDS)
    if not found.certificate.passed:
        return None
    kind = UNCONSTRAINED if game.constraints else CONSTRAINED
    return found.states, found.controls, found.costates, kind


def planned_response(
    ego: Mind, numbers: tuple[int, ...], motion: np.ndarray, controls: np.ndarray
) -> EgoPlan | None:
    """The plan of an ego that responds to the others' motion; None if no response is found."""
    own = response_with_room(ego, motion, controls)
    if own is None:
        return None
    controls = np.concatenate([own[:, None], controls[:, 1:]], axis=1)
    motion = rollout(MOTION, motion[0], controls, STEP)
    return EgoPlan(numbers, motion, controls, np.zeros_like(motion[1:]), kind_of_motion(motion))


def kind_of_motion(motion: np.ndarray) -> str:
    """Whether the ego keeps clear of all others in a motion (T, N, 4)."""
    return CONSTRAINED if least_gaps(motion).min() > 0 else UNCONSTRAINED


def kept_or_braked(former: EgoPlan | None, numbers: tuple[int, ...], states: np.ndarray) -> EgoPlan:
    """The rest of a former plan of the ego; if it is used up, braking. The others drive on.

    Numbers and states (N, 4) are those of the cars that are there now.
    """
    controls = np.zeros((HORIZON - 1, len(numbers), 2))
    if former is None or former.kind == BRAKED or len(former.controls) < 2:
        kind, left = BRAKED, 0
    else:
        kind, left = KEPT, len(former.controls) - 1
        controls = controls[:left]
        controls[:, 0] = former.controls[1:, 0]
    if kind == BRAKED:
        stopping = states[0, 3] / STEP - _BRAKING * np.arange(HORIZON - 1)
        controls[:, 0, 1] = -np.clip(stopping, 0.0, _BRAKING)
    motion = rollout(MOTION, states, controls, STEP)
    return EgoPlan(numbers, motion, controls, np.zeros_like(motion[1:]), kind)


def plan_from(
    game: Game, weights: np.ndarray, states: np.ndarray, controls: np.ndarray
) -> Root | None:
    """An equilibrium without constraints, from controls (T-1, N, 2); None if none is found."""
    found = solve_olne(game, weights, states, initial_controls=controls, max_rounds=_ROUNDS)
    if not found.certificate.passed:
        return None
    return Root(found.states, found.controls, found.costates, found.residual)


def plans_alone(game: Game, weights: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Controls (T-1, N, 2) of cars that do not mind each other; weights (N, K) or (N, K + U)."""
    alone, coupled = weights.copy(), coupled_features(game)
    alone[:, : coupled.shape[1]][coupled] = 0.0
    return grown_plans(game, states, alone)


def later(values: np.ndarray) -> np.ndarray:
    """Values (T-1, ...) of a plan without its first step, the last one repeated."""
    return np.concatenate([values[1:], values[-1:]])
