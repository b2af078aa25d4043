"""An ego's best responses to the others' motion, which may leave room between the cars.

To come too near costs a multiple of the missing room squared, so that there is a response wherever
others are, and Newton's method finds it.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.envs.drive.cars import Mind, drive_game
from olne_bench.envs.roads.footprint import CarsApart
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.best_response import Responses, best_responses

#: What the ego keeps beside the distance of footprints [m]. Cars that cross are nearest between two
#: steps, noise hides where the others are, and they plan anew.
LEAST_GAP = 0.8
#: Cost of a square metre that is missing, for a step: responses then miss a few millimetres where
#: there is room.
_MISSING = 1e4
#: Of responses: the share of 1 + |J| that a last step promises, and Newton steps.
_SETTLED, _STEPS = 1e-6, 60


@dataclass(frozen=True)
class Room:
    """What coming too near another car costs an ego: ``scale`` times the missing room squared.

    The room is that of ``CarsApart`` with ``more`` [m] between the circles.
    """

    other: int  # whose car; -1 for nobody's
    more: float = LEAST_GAP
    scale: float = _MISSING
    name: str = "room"

    @property
    def watched(self) -> tuple[int, ...]:
        return (self.other,) if self.other >= 0 else ()

    def watching(self, players: tuple[int, ...]) -> "Room":
        return replace(self, other=players[0] if players else -1)

    def running_cost(self, stage: Stage) -> ca.SX | float:
        if self.other < 0:
            return 0.0
        pair = (stage.states[stage.player], stage.states[self.other])
        margin = CarsApart((0, 1), more=self.more).margins(replace(stage, states=pair))
        return self.scale * ca.fmax(0, -margin) ** 2

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


def responses(
    ego: Mind, plans: np.ndarray, motion: np.ndarray, controls: np.ndarray, *, room: bool
) -> Responses:
    """The ego's best responses to the others' motion (T, N, 4), from B first plans (B, T-1, 2).

    With ``room``, it keeps that.
    """
    steps, players = motion.shape[:2]
    return best_responses(
        _responding_game(ego.player, players, steps, room),
        *(0, plans, motion, controls, np.tile(ego.weights, (players, 1))),
        tolerance=_SETTLED,
        max_iterations=_STEPS,
    )


@lru_cache(maxsize=64)
def _responding_game(ego: Player, players: int, steps: int, room: bool) -> Game:
    """The same game whoever the others are: their features do not matter to a response."""
    apart = tuple(Room(j) for j in range(1, players)) if room else ()
    return drive_game([Player(ego.preferences, (*ego.task, *apart)), *[ego] * (players - 1)], steps)


def response_with_room(ego: Mind, motion: np.ndarray, controls: np.ndarray) -> np.ndarray | None:
    """Controls (T-1, 2) of the ego's best response with room; None if none is found.

    It begins with the ego's part of the controls (T-1, N, 2).
    """
    found = responses(ego, controls[None, :, 0], motion, controls, room=True)
    return found.controls[0] if found.converged[0] else None
