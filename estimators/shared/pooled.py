"""Several motions of unlike cars: their drivers share weights, all else is their own.

Each player of a motion is one of D drivers, who has the same weights in every motion. Games may
differ in their players, roads, lengths, unknowns, sensors and noise; they need the same weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import SolvedGame, game_of_point, sample_sensitivity
from olne_bench.estimators.shared.joint_problem import JointSolution, SeenMotion
from olne_bench.estimators.shared.posterior_density import GameDensity, Places
from olne_bench.estimators.shared.white_noise import assumed_sigma, with_white_noise
from olne_bench.games.model.simplex import simplex_tangent, sum_free
from olne_bench.games.model.unknowns import Parameters
from olne_bench.games.solve.information import inverse_on_tangent, of_seen


@dataclass(frozen=True)
class Recorded:
    """One of several motions."""

    problem: Problem  # what is known of it
    observation: Observation  # what was seen
    drivers: tuple[int, ...]  # (N,) who each player is, from 0 on


@dataclass(frozen=True)
class Together:
    """What several motions say about the weights of their drivers."""

    weights: np.ndarray  # (D, K), rows sum to one
    #: (T, N, n) of each motion; None where there is no solution.
    states: tuple[np.ndarray | None, ...]
    #: (N, U) of the unknowns of each motion, in their units; None where it has none.
    parameters: tuple[np.ndarray | None, ...]
    covariance: np.ndarray | None  # (D*K, D*K) of the weights, or None
    converged: bool  # whether the method itself considers the result valid
    message: str  # one line that explains a failure
    objective: float  # squared errors in units of the first motion's noise scales
    samples: np.ndarray | None = None  # (M, D, K) of equal probability, or None


def checked(motions: Sequence[Recorded]) -> list[Recorded]:
    """Motions with white noise; ValueError on none, misfits, or an unknown noise level."""
    if not motions:
        raise ValueError("at least one motion is needed, got none")
    names, known = motions[0].problem.weight_names, set[int]()
    found = []
    for k, one in enumerate(motions):
        game = one.problem.game
        if game.weight_names != names:
            raise ValueError(
                f"motion {k} has the weights {', '.join(game.weight_names)}, motion 0 has "
                f"{', '.join(names)}: drivers can share only the same ones"
            )
        own = set(one.drivers)
        if len(own) != game.num_players or len(one.drivers) != game.num_players or min(own) < 0:
            raise ValueError(
                f"drivers of motion {k} must be {game.num_players} different numbers of at least "
                f"0, got {one.drivers}"
            )
        if one.problem.sigma_spread:
            raise ValueError(f"the noise level of motion {k} must be known")
        known |= own
        problem, (seen,) = with_white_noise(one.problem, one.observation)
        found.append(Recorded(problem, seen, one.drivers))
    if known != set(range(len(known))):
        raise ValueError(f"drivers must be numbered 0 to {len(known) - 1}, got {sorted(known)}")
    return found


def seen_motions(motions: Sequence[Recorded]) -> list[SeenMotion]:
    """As the solver takes them; noise scales are relative to the first motion's noise level."""
    level = assumed_sigma(motions[0].problem)
    found = []
    for one in motions:
        problem = one.problem
        scale = np.array(problem.noise_scale) * assumed_sigma(problem) / level
        found.append(
            SeenMotion(problem.game, problem.view, one.observation.y, tuple(scale), one.drivers)
        )
    return found


def games_of(solution: JointSolution) -> list[SolvedGame]:
    """The game of each motion."""
    return [game_of_point(point) for point in solution.points]


def shared_covariance(
    motions: Sequence[Recorded], games: Sequence[SolvedGame], precision: np.ndarray | None
) -> np.ndarray | None:
    """Covariance (D*K, D*K) of the weights at an optimum: the inverse of all information.

    Initial states and unknowns are each motion's own. With ``precision`` (D, K) of a prior of the
    weights, unknowns have theirs too. None where weights are not identifiable, without noise, or at
    a fold of equilibria.
    """
    if any(one.problem.sigma == 0 for one in motions):
        return None
    drivers = 1 + max(max(one.drivers) for one in motions)
    count = motions[0].problem.game.num_weights
    tangent = simplex_tangent(drivers, count)
    information = np.zeros((tangent.shape[1], tangent.shape[1]))
    if precision is not None:
        information += tangent.T @ (precision.ravel()[:, None] * tangent)
    try:
        for one, game in zip(motions, games, strict=True):
            own = _own_information(one, game, prior=precision is not None)
            places = np.array(one.drivers)[:, None] * (count - 1) + np.arange(count - 1)
            information[np.ix_(places.ravel(), places.ravel())] += own
    except ValueError:
        return None
    return inverse_on_tangent(information, tangent)


def _own_information(one: Recorded, game: SolvedGame, *, prior: bool) -> np.ndarray:
    """Information of one motion on the tangent of its players' weights, all else being unknown."""
    problem = one.problem
    sensitivity = of_seen(sample_sensitivity(problem, game), one.observation.y) / problem.sigma
    players, count = problem.game.num_players, problem.game.num_weights
    used = problem.game.parameters.used
    by_theta, by_start = np.split(sensitivity, [players * (count + used.shape[1])], axis=1)
    by_theta = by_theta.reshape(len(by_theta), players, -1)
    weights = by_theta[..., :count] @ sum_free(count)
    weights = weights.reshape(len(weights), -1)
    unknowns = by_theta[..., count:][:, used]
    nuisance = np.hstack([unknowns, by_start])
    if prior:  # of standardised unknowns
        rows = np.eye(unknowns.shape[1], nuisance.shape[1])
        nuisance = np.vstack([nuisance, rows])
        weights = np.vstack([weights, np.zeros((len(rows), weights.shape[1]))])
    base, _ = np.linalg.qr(nuisance)
    weights = weights - base @ (base.T @ weights)
    return np.asarray(weights.T @ weights)


class SharedDensity:
    """The posterior of the weights of drivers, and of unknowns and initial states of all motions.

    A point holds the coordinates of all weights, and then those of each motion's own unknowns and
    initial state. ``Density`` of ``posterior_density`` says what it is for.
    """

    def __init__(self, parts: Sequence[GameDensity], drivers: Sequence[tuple[int, ...]]) -> None:
        """From the density of each motion, and who its players are."""
        self.parts = parts
        first = parts[0].chart
        count = 1 + max(map(max, drivers))
        self.chart = NormalChart(
            count, first.num_weights, first.floor, first.prior, Parameters(((),) * count)
        )
        self._columns, end = [], self.chart.size
        for part, own in zip(parts, drivers, strict=True):
            weights = np.array(own)[:, None] * (first.num_weights - 1)
            weights = (weights + np.arange(first.num_weights - 1)).ravel()
            rest = (
                part.chart.size - part.chart.free + int(np.prod(part.problem.game.state_shape[1:]))
            )
            self._columns.append(np.concatenate([weights, end + np.arange(rest)]))
            end += rest
        self.size = end

    def place(self, games: Sequence[SolvedGame]) -> Places:
        """The place of known games of all motions, which have one weight of each driver."""
        return self._joined(
            [part.place(game) for part, game in zip(self.parts, games, strict=True)]
        )

    def reach(self, points: np.ndarray, near: Places) -> Places:
        """As of ``Density``."""
        found = []
        for k, (part, columns) in enumerate(zip(self.parts, self._columns, strict=True)):
            old = [one[k] for one in near.roots]
            found.append(part.reach(points[:, columns], _stacked(old)))
        return self._joined(found, points)

    @property
    def late(self) -> bool:
        """Whether the deadline has passed."""
        return self.parts[0].late

    def _joined(self, found: list[Places], points: np.ndarray | None = None) -> Places:
        """Places of all motions as one; their errors count the prior of weights once."""
        count = len(found[0])
        if points is None:
            points = np.zeros((count, self.size))
            for own, columns in zip(found, self._columns, strict=True):
                points[:, columns] = own.points
        free = self.chart.size
        errors, rows = [points[:, :free]], [[np.eye(free, self.size)] for _ in range(count)]
        for part, own, columns in zip(self.parts, found, self._columns, strict=True):
            seen = int(np.isfinite(part.observation.y).sum())
            kept = np.r_[:seen, seen + part.chart.free : own.errors.shape[1]]
            errors.append(own.errors[:, kept])
            for row, derivative in zip(rows, own.rows, strict=True):
                wide = np.zeros((len(kept), self.size))
                wide[:, columns] = derivative[kept]
                row.append(wide)
        joined, roots = (np.empty(count, dtype=object) for _ in range(2))
        for k in range(count):
            joined[k] = np.vstack(rows[k])
            roots[k] = tuple(own.at(np.array([k])) for own in found)
        possible = np.all([own.possible for own in found], axis=0)
        whole = np.hstack(errors)
        whole[~possible] = 0.0
        tilts = self.chart.tilt(points[:, :free])
        return Places(points, whole, joined, possible, roots, tilts)


def _stacked(places: Sequence[Places]) -> Places:
    """Single places as one."""
    fields = vars(places[0])
    return Places(*(np.concatenate([getattr(one, name) for one in places]) for name in fields))
