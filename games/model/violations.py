"""By how much a motion breaks a game's constraints, step by step."""

from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.model.constraints import Constraint, constraint_stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game


def violations(
    game: Game, step: int, states: np.ndarray, played: tuple[np.ndarray, np.ndarray] | None = None
) -> np.ndarray:
    """Violation of each constraint (constraints,), at least 0, in the unit of its margin.

    States (N, n) are those of a step, 0 for the initial state's; ``played`` are states and controls
    (N, m) of the step before it, whose controls are judged, too.
    """
    found = np.zeros(len(game.constraints))
    for k, constraint in enumerate(game.constraints):
        of_state, of_control = _functions(constraint, game.dynamics, game.dt)
        players = list(constraint.players)
        margins = [np.zeros(1)]
        if step >= constraint.first_step:
            margins.append(np.array(of_state(states[players].T)).ravel())
        if played is not None and step > constraint.first_step:
            before, controls = played
            margins.append(np.array(of_control(before[players].T, controls[players[0]])).ravel())
        found[k] = -np.concatenate(margins).min()
    return np.maximum(found, 0.0)


@lru_cache(maxsize=256)
def _functions(
    constraint: Constraint, dynamics: Dynamics, dt: float
) -> tuple[ca.Function, ca.Function]:
    """Margins of the states (n, players) alone, and those that depend on the control (m,)."""
    last = constraint_stage(constraint, dynamics, dt, last=True)
    stage = constraint_stage(constraint, dynamics, dt, last=False)
    control = stage.control
    assert control is not None
    margins = ca.vertsplit(ca.SX(constraint.margins(stage)))
    dependent = [margin for margin in margins if ca.depends_on(margin, control)]
    states = [ca.horzcat(*one.states) for one in (last, stage)]
    of_state = ca.densify(ca.SX(constraint.margins(last)))
    return (
        ca.Function("of_state", [states[0]], [of_state]),
        ca.Function("of_control", [states[1], control], [ca.densify(ca.vertcat(*dependent))]),
    )
