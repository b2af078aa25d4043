"""What an ego expects others to do who do not know what it has in mind, and how they react to it.

They plan an equilibrium with the driver that they take the ego for, each second from where
everybody is by then. Several guesses at their minds are followed at once, and several plans of the
ego: the games of all of them are one batch, in which target speeds are unknowns like weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.envs.drive.cars import MOTION, STEP, Car, DriveRoad, Mind, drive_game
from olne_bench.envs.drive.ego_seen import EgoSeen
from olne_bench.envs.drive.nash_traffic import HORIZON, REPLAN
from olne_bench.envs.drive.planner import plan_from, plans_alone
from olne_bench.envs.roads.road_scenario import speed_feature, unknown_speed, with_target
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.newton import rows, unpack

_ITERATIONS, _LIMIT = 8, 1.0  # of Newton's method: more of them rarely find what is not near
_RESIDUAL = 1e-6  # of an equilibrium that is expected: nobody plans as exactly as that
#: Times that they plan again in what is expected; then they follow their plans.
_AGAIN = 2
#: Guesses whose plans are looked for from scratch, at most, where nothing is found near others.
_LOST = 2


@dataclass(frozen=True)
class Plans:
    """B plans of all cars, the ego first."""

    states: np.ndarray  # (B, T, N, 4)
    controls: np.ndarray  # (B, T-1, N, 2)
    costates: np.ndarray  # (B, T-1, N, 4)

    def later(self, steps: int, states: np.ndarray) -> "Plans":
        """What is left of them after some steps, from states (B, N, 4); last controls go on."""
        controls, costates = (_later(one, steps) for one in (self.controls, self.costates))
        return Plans(rollouts(states, controls), controls, costates)

    def repeated(self, count: int) -> "Plans":
        """Each of them so many times, one after the other."""
        parts = self.states, self.controls, self.costates
        return Plans(*(np.repeat(one, count, axis=0) for one in parts))

    def put(self, index: int, one: "Plans") -> None:
        """Put a single one into the place of another."""
        self.states[index] = one.states[0]
        self.controls[index] = one.controls[0]
        self.costates[index] = one.costates[0]

    def one(self, index: int) -> "Plans":
        """A single one of them."""
        return Plans(
            *(one[index : index + 1] for one in (self.states, self.controls, self.costates))
        )


class Others:
    """Guesses at the minds of others, who plan each second; or who go straight on."""

    def __init__(
        self,
        road: DriveRoad,
        ego: Car,
        seen: EgoSeen,
        guesses: Sequence[Sequence[Mind]],
        straight_on: bool = False,
    ) -> None:
        """Each guess (S of them) has the minds of all cars, the ego first, which nobody knows."""
        taken_for, speed = seen.car(ego, ego.start), unknown_speed(road.family.speeds)
        cars = [
            [Mind(ego.number, taken_for.player, taken_for.weights), *one[1:]] for one in guesses
        ]
        self._known = [drive_game([mind.player for mind in one], HORIZON) for one in cars]
        self._weights = [np.stack([mind.weights for mind in one]) for one in cars]
        players = [with_target(player, speed) for player in self._known[0].players]
        self._game = drive_game(players, HORIZON)
        self._theta = np.stack(list(map(self._told, self._known, self._weights)))
        self._plans = len(players) > 1 and not straight_on

    def _told(self, game: Game, weights: np.ndarray) -> np.ndarray:
        """(N, 5): weights of all, and standardised target speeds."""
        speeds = np.array([[float(speed_feature(player).target)] for player in game.players])
        return np.hstack([weights, self._game.parameters.standardised(speeds)])

    def first_planned(self, states: np.ndarray) -> Plans:
        """What is planned at states (N, 4) by the first guess, from scratch."""
        plan = self._straight_on(states, 1)
        if self._plans:
            self._take(plan, 0, states, keep=False)
        return plan

    def planned(self, states: np.ndarray, near: Plans | None, from_scratch: Sequence[int]) -> Plans:
        """What is planned at states (N, 4) by each guess, near other plans.

        The guesses ``from_scratch`` do not look near these; nor does anybody without them, nor the
        first ones for which nothing is found there. Where nothing is found, all do as in the first
        guess, and straight on in that one.
        """
        count = len(self._theta)
        if near is None:
            near, from_scratch = self._straight_on(states, count), range(count)
        if not self._plans:
            return self._straight_on(states, count)
        plans, good = self._roots(near, self._theta)
        lost = [index for index in range(count) if not good[index] and index not in from_scratch]
        for index in sorted([*from_scratch, *lost[:_LOST]]):
            self._take(plans, index, states, keep=bool(good[index]))
        for index in lost[_LOST:]:
            plans.put(index, plans.one(0))
        return plans

    def _take(self, plans: Plans, index: int, states: np.ndarray, *, keep: bool) -> None:
        """Put a plan from scratch into plans; if there is none and none to keep, another one."""
        first = plans_alone(self._game, self._theta[index], states)  # one game for all guesses
        found = plan_from(self._known[index], self._weights[index], states, first)
        if found is not None:
            plans.put(index, Plans(found.states[None], found.controls[None], found.costates[None]))
        elif not keep:
            plans.put(index, plans.one(0) if index else self._straight_on(states, 1))

    def played(self, plans: Plans, own: np.ndarray, left: int) -> tuple[np.ndarray, np.ndarray]:
        """What all do if the ego has controls (C, T-1, 2), by each guess: motion and controls.

        Motion is (S, C, T, N, 4) and controls (S, C, T-1, N, 2). The others follow their plans for
        the steps that are left of a second, then plan each second, ``_AGAIN`` times.
        """
        guesses, ways, last = len(plans.states), len(own), own.shape[1]
        theta = np.repeat(self._theta, ways, axis=0)
        now, mine = plans.repeated(ways), np.tile(own, (guesses, 1, 1))
        players = self._game.num_players
        motion = np.empty((guesses * ways, last + 1, players, 4))
        controls = np.empty((guesses * ways, last, players, 2))
        motion[:, 0], done = now.states[:, 0], 0
        for steps in _parts(left, last):
            part = slice(done, done + steps)
            controls[:, part] = now.controls[:, :steps]
            controls[:, part, 0] = mine[:, part]
            motion[:, done : done + steps + 1] = rollouts(motion[:, done], controls[:, part])
            done += steps
            if done < last:
                now = now.later(steps, motion[:, done])
                now = self._roots(now, theta)[0] if self._plans else now
        return (
            motion.reshape(guesses, ways, *motion.shape[1:]),
            controls.reshape(guesses, ways, *controls.shape[1:]),
        )

    def _roots(self, near: Plans, theta: np.ndarray) -> tuple[Plans, np.ndarray]:
        """Equilibria near plans, which stay as they are where none is found, and where one is."""
        z = rows(self._game, near.states, near.controls, near.costates)
        finite = np.isfinite(z).all(axis=(1, 2))
        z[~finite] = 0.0
        residuals, _ = elimination(self._game).newton(
            z,
            theta.reshape(len(z), -1),
            tolerance=_RESIDUAL / 10,
            max_iterations=_ITERATIONS,
            limit=_LIMIT,
        )
        good = finite & (residuals < _RESIDUAL)
        found = unpack(self._game, z)
        parts = (near.states, near.controls, near.costates)
        chosen = [
            np.where(good.reshape(-1, 1, 1, 1), new, old)
            for new, old in zip(found, parts, strict=True)
        ]
        return Plans(*chosen), good

    def _straight_on(self, states: np.ndarray, count: int) -> Plans:
        controls = np.zeros((count, *self._game.control_shape))
        motion = rollouts(np.repeat(states[None], count, axis=0), controls)
        return Plans(motion, controls, np.zeros_like(motion[:, 1:]))


def _parts(left: int, steps: int) -> list[int]:
    """Steps of each plan that the others follow, of so many."""
    parts = [min(left, steps)]
    while sum(parts) < steps:
        rest = steps - sum(parts)
        parts.append(rest if len(parts) == _AGAIN else min(REPLAN, rest))
    return parts


def rollouts(states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """Motions (B, T, N, 4) from states (B, N, 4) under controls (B, T-1, N, 2)."""
    count, steps, players, size = controls.shape
    together = controls.transpose(1, 0, 2, 3).reshape(steps, count * players, size)
    motion = rollout(MOTION, states.reshape(count * players, -1), together, STEP)
    return motion.reshape(steps + 1, count, players, -1).transpose(1, 0, 2, 3)


def _later(values: np.ndarray, steps: int) -> np.ndarray:
    """Values (B, T-1, ...) of plans without their first steps, the last ones repeated."""
    return np.concatenate([values[:, steps:], np.repeat(values[:, -1:], steps, axis=1)], axis=1)
