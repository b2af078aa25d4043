"""A prior of the initial states of players that the first sample misses.

A flat one does not do: where accelerating costs little, a player gets from nearly anywhere to its
first sample. So the posterior has a long tail of starts at hundreds of metres per second, or no
integral at all.

In one step, the fastest player moves w on average. A player that is first seen k steps late is k
w / 2 away from where its samples say that it began (standard deviation); its speed is off by half
of the fastest player's, and its heading by half a radian. Of 237 players seen late on HighwayEnv's
roads, the root mean square of the errors is 0.05 to 1.0 of these, the largest is 3.1 (``python
scripts/unseen_starts.py``).
"""

import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.followed_games import StartPrior
from olne_bench.estimators.shared.forward_model import initial_state_prior
from olne_bench.estimators.shared.trajectory_fit import guess_states

#: Deviations: this share of a way or a speed, and as many radians.
_SHARE = 0.5


def unseen_starts(problem: Problem, observation: Observation) -> StartPrior | None:
    """The prior, flat for players in the first sample; None if that has all players.

    Args:
        problem: what is known; its noise is white.
        observation: a player without any complete sample counts as one in the first.
    """
    complete = np.isfinite(observation.y).all(axis=2)
    late = complete.argmax(axis=0)
    if not late.any():
        return None
    mean, deviation = initial_state_prior(problem, observation, problem.sigma)
    one_step = _one_step(guess_states(problem.game, problem.view, observation.y), complete)
    least = np.full(mean.shape, _SHARE * one_step / problem.game.dt)
    least[:, :2] = _SHARE * one_step * late[:, None]
    names = problem.game.dynamics.state_names
    if "heading" in names:
        least[:, names.index("heading")] = _SHARE
    deviation = np.maximum(deviation, least)
    return StartPrior(mean, np.where(late[:, None] > 0, deviation, np.inf))


def _one_step(guess: np.ndarray, complete: np.ndarray) -> float:
    """How far [m] the fastest player gets in a step, from its first to its last sample."""
    ways = [0.0]
    for player, seen in enumerate(complete.T):
        steps = np.flatnonzero(seen)
        if len(steps) > 1:
            way = guess[steps[-1], player, :2] - guess[steps[0], player, :2]
            ways.append(float(np.linalg.norm(way) / (steps[-1] - steps[0])))
    return max(ways)
