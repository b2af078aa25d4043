"""A primal-dual interior point method for games with hard constraints (``interior.c``).

A variational equilibrium solves the first-order conditions G of ``games.solve.kkt`` with the
constraints' multipliers v, those of a shared constraint common to all players, and slacks s:

    (I1)  G(z) - J' v = 0,    g(z) - s = 0,    s v = tau -> 0,    s > 0,  v > 0.

Newton's step (dz, ds, dv) follows from one sweep in time, as the last two rows can be eliminated
stage by stage:

    (I2)  (G_z - v' g'' + J' diag(v / s) J) dz = -G + J' (tau / s - v (g - s) / s),
          ds = J dz + g - s,    dv = tau / s - v - v ds / s.

With slacks above the margins, the constraints start relaxed: the iteration is also a continuation
from independent players, in which the players' radii grow from zero.

A filter decides how far to step (Waechter, Biegler 2006): a point has to be better than all before
it in the violation of the equations or in

    (I3)  phi = sum_i J^i - tau sum log s,

where the cost of player i is taken along its own new motion and the others' present one. Where
costs look at their own player only, this is the potential of the game. If a stage matrix is not
positive definite, the diagonal of the second derivatives is shifted, so that steps do not lead to
saddles.
"""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.compiled.bindings import check_size, dense
from olne_bench.games.compiled.complementarity import RELAXATION
from olne_bench.games.compiled.elimination import Elimination

#: The barrier's last weight tau; complementarity s v of every margin ends there.
LAST_TAU = RELAXATION
#: Equations hold to this.
TOLERANCE = 1e-9
#: Steps at most.
MOST_ITERATIONS = 150

#: ``InteriorOptions`` of ``interior.c``, in its order.
_OPTIONS = np.array(
    [
        LAST_TAU,
        TOLERANCE,
        *(0.1, 1.3),  # factor and power by which tau falls
        20.0,  # tau falls once all errors are below so many of it
        0.99,  # share of the way to s = 0 or v = 0
        1e-6,  # shortest step
        *(1e-3, 1e8),  # first and largest shift
        1e10,  # v stays within this factor of tau / s
        1e-13,  # rounding of phi, relative to 1 + |phi|
    ]
)


@dataclass(frozen=True)
class InteriorSolution:
    """Where the iteration ended."""

    z: np.ndarray  # (T, size) rows (x_t, u_t, lambda_t)
    multipliers: np.ndarray  # (T, C) v, zero where a margin is not enforced
    residual: float  # largest error of G - J' v and g - s
    solved: bool  # whether all equations of (I1) hold
    iterations: int  # number of steps


def solve_interior(
    solver: Elimination,
    theta: np.ndarray,
    z: np.ndarray,
    *,
    coupled: bool,
    tau: float,
    relaxed: float,
    max_iterations: int = MOST_ITERATIONS,
) -> InteriorSolution:
    """Iterate from a trajectory z (T, size), whose x_1 stays.

    ``coupled``: some player's cost looks at others; ``tau``: the barrier's first weight, in units
    of cost; ``relaxed``: smallest first slack, as a share of the margin's mean size along z.
    """
    stages, horizon, library = solver.stages, solver.horizon, solver.library
    z = dense("z", z, (horizon, stages.size)).copy()
    theta, v = dense("theta", theta, (stages.num_weights,)), np.zeros((horizon, stages.num_margins))
    residual, solved = np.zeros(1), np.zeros(1, dtype=np.int32)
    check_size(library.interior_options(), _OPTIONS.nbytes, "InteriorOptions")
    iterations = library.interior(
        *(solver.work, _OPTIONS, theta, solver.enforced, int(coupled)),
        *(tau, relaxed, max_iterations, z, v, residual, solved),
        np.empty(library.interior_space(horizon)),
    )
    return InteriorSolution(z, v, float(residual[0]), bool(solved[0]), iterations)
