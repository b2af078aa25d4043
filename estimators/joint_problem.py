"""What the back ends of the joint method start from and return."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.game import Game


@dataclass(frozen=True)
class JointPoint:
    """Values of all unknowns of the joint problem.

    Attributes:
        states: (T, N, n).
        controls: (T-1, N, m).
        costates: (T-1, N, n).
        weights: (N, K), rows sum to one.
    """

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    weights: np.ndarray

    @classmethod
    def from_trajectory(
        cls, game: Game, states: np.ndarray, controls: np.ndarray | None = None
    ) -> "JointPoint":
        """A trajectory with costates at zero and uniform weights; zero controls where absent."""
        if controls is None:
            controls = np.zeros(game.control_shape)
        uniform = np.full((game.num_players, game.num_weights), 1 / game.num_weights)
        return cls(states, controls, np.zeros_like(states[1:]), uniform)


@dataclass(frozen=True)
class JointSolution:
    """Where a start led.

    Attributes:
        point: the last point.
        objective: sum of squared observation errors.
        iterations: of the interior-point method.
        converged: whether the point is a local optimum to the back end's tolerance.
        message: why not, in one line; empty where converged.
    """

    point: JointPoint
    objective: float
    iterations: int
    converged: bool
    message: str
