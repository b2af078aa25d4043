"""An ego among cars that do not know what it has in mind: it leads them by what it does.

It compares plans by what they cost it with the others' reaction (``envs.drive.others``): to drive
as on an empty road, faster or slower, to go on as before, and its best responses to what the others
do if it follows the best of these. So who goes first is not left to the former plan.

Where it is not sure of the others, it has several guesses at their minds, and a plan costs the mean
over them:

- ``expected``: it follows the plan to the end;
- ``contingency``: it follows the plan for a second, by when it knows which guess is right, and
  responds to the others at its best from then on.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from olne_bench.envs.drive.cars import (
    MOTION,
    STEP,
    Car,
    DriveRoad,
    EgoCost,
    Mind,
    drive_game,
    least_gaps,
)
from olne_bench.envs.drive.ego_seen import EgoSeen
from olne_bench.envs.drive.nash_traffic import REPLAN
from olne_bench.envs.drive.others import Others, Plans
from olne_bench.envs.drive.planner import (
    BRAKED,
    HORIZON,
    KEPT,
    EgoPlan,
    Planner,
    kind_of_motion,
    later,
)
from olne_bench.envs.drive.response import LEAST_GAP, response_with_room, responses
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.best_response import grown_plans

#: Accelerations [m/s^2] of first plans, and for how many steps.
_CHANGES = ((3.0, 10), (-4.0, 8))
#: Times that the ego responds to what the others do if it follows its best plan so far.
_ROUNDS = 2
#: Responses that are made to keep the distance, the cheapest ones.
_REFINED = 2
#: Plans that are compared by several guesses.
_COMPARED = 3
#: Differences of steering [rad] and acceleration [m/s^2] that count alike between plans.
_SCALE = np.array([0.1, 2.0])
#: In these units, plans this near to each other are the same.
_SAME = 1e-3


@dataclass
class _Present:
    """What the others planned when they last did."""

    numbers: tuple[int, ...]  # who was there
    states: np.ndarray  # (N, 4) where they were
    steps: int = 0  # since then
    plans: Plans | None = None  # what they seemed to plan, by each guess


class RespondingPlanner(Planner):
    """Plans with the others' reaction."""

    def __init__(
        self,
        road: DriveRoad,
        ego: Car,
        seen: EgoSeen,
        *,
        straight_on: bool = False,
        contingent: bool = False,
    ) -> None:
        """Others take the ego for what is ``seen``; it may take them to go ``straight_on``."""
        super().__init__()
        self._road, self._ego, self._seen, self._straight_on = road, ego, seen, straight_on
        self._cost, self._contingent = EgoCost(ego), contingent
        self._mind = Mind(ego.number, ego.player, ego.weights)
        self._cycle = 0
        self._present: _Present | None = None

    def plan(
        self, minds: Sequence[Mind], states: np.ndarray, guesses: Sequence[Sequence[Mind]] = ()
    ) -> EgoPlan:
        """The next plan for the most probable minds, or for several guesses at them."""
        self._guesses = guesses if len(minds) > 1 else ()
        return super().plan(minds, states)

    def _found(
        self, minds: Sequence[Mind], numbers: tuple[int, ...], states: np.ndarray
    ) -> EgoPlan | None:
        road, ego, every = self._road, self._ego, [minds, *self._guesses]
        others = Others(road, ego, self._seen, every, self._straight_on)
        plans, left = self._planned(others, numbers, states, len(every))
        probable = others
        if self._guesses:
            probable = Others(road, ego, self._seen, every[:1], self._straight_on)
        ways, guesses = self._ways(probable, plans.one(0), left, states[0]), None
        if self._guesses:
            motion, controls = others.played(plans, _apart(ways, _COMPARED), left)
            costs = self._branched(motion, controls)[1:].mean(axis=0)
            ways, guesses = _Ways(motion[0], controls[0], costs), motion[1:, int(np.argmin(costs))]
        own, inputs = ways.best
        return EgoPlan(numbers, own, inputs, np.zeros_like(own[1:]), kind_of_motion(own), guesses)

    def _planned(
        self, others: Others, numbers: tuple[int, ...], states: np.ndarray, count: int
    ) -> tuple[Plans, int]:
        """What is left of the others' plans, by each guess, and the steps until they plan again."""
        now, turn = self._present, [self._cycle // REPLAN % count]
        if now is None or now.numbers != numbers or now.steps == REPLAN:
            near = None
            if now is not None and now.numbers == numbers and now.plans is not None:
                near = now.plans.later(REPLAN, np.repeat(states[None], count, axis=0))
            now = self._present = _Present(numbers, states, plans=near)
        else:
            turn = []
        if now.plans is None and count > 1:  # guesses begin near the most probable minds
            first = others.first_planned(now.states)
            now.plans = first.repeated(count)
        now.plans = others.planned(now.states, now.plans, turn)
        left, plans = REPLAN - now.steps, now.plans
        if now.steps:
            plans = plans.later(now.steps, np.repeat(states[None], count, axis=0))
        now.steps += 1
        self._cycle += 1
        return plans, left

    def _ways(self, others: Others, plan: Plans, left: int, state: np.ndarray) -> "_Ways":
        """What becomes of plans of the ego for the most probable minds."""

        def played(own: np.ndarray) -> _Ways:
            motion, controls = (part[0] for part in others.played(plan, own, left))
            return _Ways(motion, controls, self._costs(motion, controls[:, :, 0]))

        ways = played(self._starts(state))
        for _ in range(_ROUNDS):
            cheapest = ways.costs.min()
            own = self._responses(*ways.best, ways.controls[:, :, 0])
            ways = ways.with_more(played(own)) if len(own) else ways
            if not ways.costs.min() < cheapest:  # another round would respond to the same motion
                break
        return ways

    def _starts(self, state: np.ndarray) -> np.ndarray:
        """Plans (C, T-1, 2): those of an empty road, faster, slower, and the former one."""
        game = drive_game([self._ego.player], HORIZON)
        alone = grown_plans(game, state[None], self._ego.weights[None])[:, 0]
        found = [alone]
        for acceleration, steps in _CHANGES:
            changed = alone.copy()
            changed[:steps, 1] = acceleration
            found.append(changed)
        if self._former is not None and self._former.kind not in (KEPT, BRAKED):
            found.append(later(self._former.controls)[:, 0])
        return np.array(found)

    def _responses(
        self, motion: np.ndarray, controls: np.ndarray, starts: np.ndarray
    ) -> np.ndarray:
        """Controls (R, T-1, 2) of the ego's best responses to a motion (T, N, 4), from first plans.

        The cheapest ones are made to keep the distance.
        """
        found = responses(self._mind, starts, motion, controls, room=False)
        good, chosen = np.flatnonzero(found.converged), []
        good = good[np.argsort(found.costs[good])]
        for own in different(found.controls[good])[:_REFINED]:
            joint = controls.copy()
            joint[:, 0] = own
            if least_gaps(rollout(MOTION, motion[0], joint, STEP)).min() < LEAST_GAP:
                refined = response_with_room(self._mind, motion, joint)
                own = own if refined is None else refined
            chosen.append(own)
        return np.array(chosen).reshape(-1, *starts.shape[1:])

    def _branched(self, motion: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Costs (S, C) of plans, if contingent with the best response after a second."""
        costs = self._costs(motion, controls[:, :, :, 0])
        if not self._contingent:
            return costs
        motion, controls = motion.copy(), controls.copy()
        for place in np.ndindex(*costs.shape):
            own, joint = motion[place], controls[place]
            left = own[REPLAN:], joint[REPLAN:]
            response = responses(self._mind, joint[None, REPLAN:, 0], *left, room=False)
            if response.converged[0]:
                joint[REPLAN:, 0] = response.controls[0]
                own[REPLAN:, 0] = rollout(MOTION, own[REPLAN], joint[REPLAN:], STEP)[:, 0]
        return np.asarray(np.minimum(costs, self._costs(motion, controls[:, :, :, 0])))

    def _costs(self, motion: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Costs (...) of plans, of which none should come nearer than the least gap."""
        return self._cost.of_plans(motion, controls, room=LEAST_GAP)


@dataclass(frozen=True)
class _Ways:
    """What becomes of C plans of the ego."""

    motion: np.ndarray  # (C, T, N, 4)
    controls: np.ndarray  # (C, T-1, N, 2)
    costs: np.ndarray  # (C,)

    @property
    def best(self) -> tuple[np.ndarray, np.ndarray]:
        """Motion and controls of the cheapest."""
        place = int(np.argmin(self.costs))
        return self.motion[place], self.controls[place]

    def with_more(self, more: "_Ways") -> "_Ways":
        """These and more of them."""
        pairs = zip(astuple(self), astuple(more), strict=True)
        return _Ways(*(np.concatenate(pair) for pair in pairs))


def different(plans: np.ndarray) -> list[np.ndarray]:
    """Those of plans (C, T-1, 2) that are not like one before: most starts lead to one response."""
    taken: list[np.ndarray] = []
    for plan in plans:
        if all(np.abs((plan - other) / _SCALE).max() > _SAME for other in taken):
            taken.append(plan)
    return taken


def _apart(ways: _Ways, most: int) -> np.ndarray:
    """Controls (C, T-1, 2) of the cheapest way, and of those that differ most from all others."""
    own = ways.controls[:, :, 0]
    first = int(np.argmin(ways.costs))
    taken, left = [own[first]], [one for place, one in enumerate(own) if place != first]
    while left and len(taken) < most:
        away = [min(float(np.abs((one - other) / _SCALE).max()) for other in taken) for one in left]
        taken.append(left.pop(int(np.argmax(away))))
    return np.array(taken)
