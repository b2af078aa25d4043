"""Settings, starting points and solutions of the joint method, for both of its back ends.

The back ends are the project's own method (``interior_point``) and IPOPT (``joint_ipopt``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View

_MOST_ITERATIONS = 10**6


@dataclass(frozen=True)
class JointPoint:
    """Values of all unknowns of the joint problem."""

    states: np.ndarray  # (T, N, n)
    controls: np.ndarray  # (T-1, N, m)
    costates: np.ndarray  # (T-1, N, n)
    weights: np.ndarray  # (N, K), rows sum to one
    #: (N, U) standardised values of the game's unknowns; None where it has none.
    parameters: np.ndarray | None = None

    @property
    def theta(self) -> np.ndarray:
        """(N, K + U): weights and standardised parameters, as solvers take them."""
        return (
            self.weights if self.parameters is None else np.hstack([self.weights, self.parameters])
        )

    @classmethod
    def from_trajectory(
        cls, game: Game, states: np.ndarray, controls: np.ndarray | None = None
    ) -> "JointPoint":
        """A trajectory with zero costates, uniform weights, unknowns' means; or zero controls."""
        if controls is None:
            controls = np.zeros(game.control_shape)
        uniform = np.full((game.num_players, game.num_weights), 1 / game.num_weights)
        count = game.parameters.count
        parameters = np.zeros((game.num_players, count)) if count else None
        return cls(states, controls, np.zeros_like(states[1:]), uniform, parameters)


@dataclass(frozen=True)
class SeenMotion:
    """One of several motions that share weights."""

    game: Game  # its game
    view: View  # the observation model
    y: np.ndarray  # (T, N, d) observations, NaN where missing
    #: (d,) relative standard deviations of the observations; ones if empty.
    noise_scale: Sequence[float] = ()
    #: (N,) who each player is, from 0 on; players in their order if empty.
    drivers: Sequence[int] = ()
    #: Motions of one situation share the values of their unknowns; None for values of its own.
    situation: int | None = None

    @property
    def rows(self) -> Sequence[int]:
        """(N,) who each player is."""
        return self.drivers or range(self.game.num_players)


def weights_of(motions: Sequence[SeenMotion], points: Sequence[JointPoint]) -> np.ndarray:
    """(D, K) weights of all drivers, from a point of each motion."""
    count = 1 + max(max(one.rows) for one in motions)
    weights = np.empty((count, points[0].weights.shape[1]))
    for one, point in zip(motions, points, strict=True):
        weights[list(one.rows)] = point.weights
    return weights


def inside(point: JointPoint, floor: float) -> JointPoint:
    """The point with its weights moved off their bound, as interior-point methods need it."""
    weights = np.maximum(point.weights, 2 * floor)
    return replace(point, weights=weights / weights.sum(axis=1, keepdims=True))


@dataclass(frozen=True)
class JointSettings:
    """How a joint problem is posed and solved.

    Raises ValueError on a number of iterations out of range.
    """

    #: (d,) relative standard deviations of the observations; ones if empty.
    noise_scale: Sequence[float] = ()
    weight_floor: float = 1e-5  # lower bound of every weight, below 1/K
    #: Factor of a further term |theta - 1/K|^2 of what is minimised, which holds the weights
    #: near uniform.
    tie: float = 0.0
    parameter_tie: float = 0.0  # factor of a term |s|^2 of standardised unknowns
    #: Factors, one or (N, K), of further terms -log(theta - floor): with 2 sigma^2 alpha they
    #: are the Dirichlet prior of ``map``.
    barrier: float | np.ndarray = 0.0
    tolerance: float = 1e-9  # on all optimality conditions
    max_iterations: int = 300  # largest number of iterations
    first_barrier: float = 0.1  # initial barrier parameter (native method only)
    limit: float = 60.0  # wall-clock seconds (native method only; IPOPT stops by its iterations)

    def __post_init__(self) -> None:
        if not 0 <= self.max_iterations <= _MOST_ITERATIONS:
            raise ValueError(
                f"max_iterations must be 0 to {_MOST_ITERATIONS}, got {self.max_iterations}"
            )

    def check_floor(self, num_weights: int) -> None:
        """Check that some weights satisfy the floor; ValueError gives the floor and its range."""
        if not 0 <= self.weight_floor * num_weights < 1:
            raise ValueError(
                f"weight_floor must be in [0, {1 / num_weights:g}) for "
                f"{num_weights} weights per player, got {self.weight_floor}"
            )


class Status(IntEnum):
    """Why a run stopped; the first ones in the order of ``interior_point.c``."""

    CONVERGED = 0
    NOT_FINITE = 1
    SINGULAR = 2
    NO_TIME = 3
    NO_CURVATURE = 4
    NO_STEP = 5
    NO_ITERATIONS = 6
    CLOSE_TO_KNOWN = 7
    IPOPT_FAILED = 8


_MESSAGES = {
    Status.CONVERGED: "",
    Status.NOT_FINITE: "the start is not finite",
    Status.SINGULAR: "singular stage of the first-order conditions",
    Status.NO_TIME: "time limit reached",
    Status.NO_CURVATURE: "the Hessian could not be corrected",
    Status.NO_STEP: "line search and restoration failed",
    Status.NO_ITERATIONS: "iteration limit reached",
    Status.CLOSE_TO_KNOWN: "close to a known optimum",
    Status.IPOPT_FAILED: "IPOPT stopped",
}


@dataclass(frozen=True)
class JointSolution:
    """The result of one start."""

    points: tuple[JointPoint, ...]  # the last point of each trajectory; all have the same weights
    objective: float  # sum of squared observation errors
    iterations: int  # iterations of the interior-point method
    status: Status  # whether this is a local optimum to the back end's tolerance, or why not
    detail: str = ""  # IPOPT's own status if it failed
    penalty: float = 0.0  # what the terms of ``tie`` and ``barrier`` add

    @property
    def criterion(self) -> float:
        """What was minimised."""
        return self.objective + self.penalty

    @property
    def point(self) -> JointPoint:
        """The point of the first trajectory."""
        return self.points[0]

    @property
    def converged(self) -> bool:
        """Whether it is a local optimum."""
        return self.status is Status.CONVERGED

    @property
    def message(self) -> str:
        """Why this is not a solution, in one line; empty if it is one."""
        return ": ".join(filter(None, [_MESSAGES[self.status], self.detail]))
