"""A small, fast open-loop game of cars that follow reference points, for receding horizons.

Everything that changes between plans (references, weights, other vehicles) is a parameter, and many
games are solved at once by Newton's method on the players' stacked gradients dJ^i/du^i = 0, the
first-order conditions of the OLNE (Peters et al. 2021, eqn. forward_kkt_conditions) after
elimination of states and costates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import casadi as ca
import numpy as np

from olne_bench.games.model.costs import CarProximity, ControlEffort, Stage
from olne_bench.games.model.dynamics import Dynamics, bicycle
from olne_bench.games.solve.reference_derivatives import NU, CarDerivatives, Linearisation

#: Columns of ``weights``.
WEIGHT_NAMES = ("proximity", "speed", "acceleration", "turning", "lane")


@dataclass(frozen=True)
class Units:
    """Units of a driver's cost terms, which make its weights comparable."""

    length: float = 6.0  # unit of distance ahead and behind [m]
    width: float = 2.2  # unit of distance to the sides [m]
    speed: float = 3.0  # deviation from the reference speed [m/s] that costs 1
    acceleration: float = 2.0  # acceleration [m/s^2] that costs 1
    turning: float = 3.0  # lateral acceleration [m/s^2] that costs 1
    steering: float = 1.0  # steering angle [rad] that costs 1, in addition; it matters at low speed
    lane: float = 0.8  # lateral deviation [m] that costs 1
    heading: float = 0.15  # heading error [rad] that costs 1


@dataclass(frozen=True)
class Situation:
    """The parameters of a game at one moment; T-1 steps, N players."""

    initial_state: np.ndarray  # (N, 4) px, py, heading, speed
    weights: np.ndarray  # (N, 5), see ``WEIGHT_NAMES``
    #: (N, T-1, 4) point px, py, direction [rad], speed [m/s] to follow at each step.
    references: np.ndarray
    #: (N, M, T-1, 2) predicted positions of what each player has to avoid besides the other
    #: players; M is fixed by the game, unused entries are far away.
    others: np.ndarray


@dataclass(frozen=True)
class Plan:
    """A solution, or the last iterate of a failed attempt."""

    states: np.ndarray  # (T, N, 4)
    controls: np.ndarray  # (T-1, N, 2)
    residual: float  # largest entry of the players' gradients, where they were last evaluated
    iterations: int  # Newton steps taken
    #: Whether the residual or the last step is small enough and every player's own Hessian is
    #: positive definite, so that its plan is a strict local best response.
    converged: bool


@dataclass(frozen=True)
class ReferenceGame:
    """The compiled game."""

    steps: int  # T-1
    dt: float  # step [s]
    max_players: int  # largest number of players of a game
    num_others: int  # M, predicted positions per player
    rear_axle: float = 2.5  # distance from the bicycle's centre to its rear axle [m]
    sub_steps: int = 2  # Euler steps of the bicycle per step
    units: Units = field(default_factory=Units)  # units of the cost terms

    @property
    def dynamics(self) -> Dynamics:
        """The bicycle."""
        return bicycle(self.rear_axle, self.sub_steps)

    def solve_all(
        self,
        situations: Sequence[Situation],
        controls: Sequence[np.ndarray],
        *,
        tolerance: float = 1e-4,
        small_change: tuple[float, float] = (0.0, 0.0),
        max_iterations: int = 12,
        max_change: tuple[float, float] = (0.2, 3.0),
    ) -> list[Plan]:
        """Newton's method on independent games at once, much faster than one after the other.

        Controls (T-1, N, 2) are starts, such as the previous plan shifted by one step.
        ``small_change`` and ``max_change`` are of steering [rad] and acceleration [m/s^2]: a Newton
        step within the first is the last (the remaining error is of the order of its square), none
        is larger than the second.
        """
        games = _Games.of(situations, self.max_players)
        unknowns = np.concatenate([start.swapaxes(0, 1) for start in controls]).astype(float)
        with np.errstate(invalid="ignore", over="ignore"):  # failures show in the residuals
            search = _Search(self, games, unknowns, tolerance, np.array(small_change))
            for _ in range(max_iterations):
                if not search.open.any():
                    break
                search.advance(np.array(max_change))
        return search.plans()

    def newton_step(self, games: "_Games", at: Linearisation) -> np.ndarray:
        """Changes (N, T-1, 2) of the controls; NaN in games whose system is singular."""
        size = NU * self.steps
        own = _convexified(at.own_hessians)
        # (N, S, 2S, 2P): how a player's gradient reacts to the positions of its partners.
        towards = at.sensitivities.swapaxes(2, 3) @ at.cross
        towards = towards.reshape(len(own), self.steps, size, -1, NU).transpose(0, 3, 2, 1, 4)
        player, slot = np.nonzero(games.partners < len(own))
        partner = games.partners[player, slot]
        positions = at.sensitivities[:, :, :NU].reshape(len(own), -1, size)
        blocks = towards[player, slot].reshape(-1, size, size) @ positions[partner]
        places = (len(games), self.max_players, size, self.max_players, size)
        systems = np.zeros(places)
        systems[games.game, games.place, :, games.place] = own
        systems[games.game[player], games.place[player], :, games.place[partner]] = blocks
        change = np.empty((len(own), size))
        for index, (first, count) in enumerate(zip(games.offsets, games.counts, strict=True)):
            mine, rows = slice(first, first + count), count * size
            system = systems[index, :count, :, :count].reshape(rows, rows)
            try:
                step = np.linalg.solve(system, -at.gradients[mine].ravel())
            except np.linalg.LinAlgError:  # singular, or an undefined point
                step = np.full(rows, np.nan)
            change[mine] = step.reshape(count, size)
        return change.reshape(-1, self.steps, NU)

    def evaluate(self, games: "_Games", unknowns: np.ndarray) -> Linearisation:
        """Motion and derivatives at controls (N, T-1, 2)."""
        derivatives = self._derivatives
        states = derivatives.states(games.initial_state, unknowns)
        nowhere = np.full((1, self.steps, NU), FAR_AWAY)
        positions = np.concatenate([states[..., :NU], nowhere])
        return derivatives.linearise(
            games.initial_state,
            unknowns,
            states,
            games.weights,
            games.references,
            positions[games.partners],
            games.others,
        )

    def states(self, initial_state: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """States (N, T-1, 4) after each step of controls (N, T-1, 2)."""
        return self._derivatives.states(initial_state, controls)

    @cached_property
    def _derivatives(self) -> CarDerivatives:
        return CarDerivatives(
            self.dynamics,
            partial(_step_cost, self),
            num_weights=len(WEIGHT_NAMES),
            dt=self.dt,
            steps=self.steps,
            num_partners=self.max_players - 1,
            num_others=self.num_others,
        )


#: Coordinate [m] of unused entries, farther than any car gets; no cost depends on them.
FAR_AWAY = 1e7


@dataclass(frozen=True)
class _Games:
    """A batch of games: N players in total, those of one game in consecutive rows.

    Of G games, ``counts`` (G,) holds the numbers of players; ``partners`` (N, P) the other players
    of a player's game, N in unused entries.
    """

    initial_state: np.ndarray
    weights: np.ndarray
    references: np.ndarray
    others: np.ndarray
    counts: np.ndarray
    partners: np.ndarray

    @classmethod
    def of(cls, situations: Sequence[Situation], max_players: int) -> "_Games":
        counts = np.array([len(situation.initial_state) for situation in situations])
        total = int(counts.sum())
        partners = np.full((total, max_players - 1), total)
        for first, count in zip(np.cumsum(counts) - counts, counts, strict=True):
            for place in range(count):
                others = [first + k for k in range(count) if k != place]
                partners[first + place, : count - 1] = others
        return cls(
            np.concatenate([situation.initial_state for situation in situations]),
            np.concatenate([situation.weights for situation in situations]),
            np.concatenate([situation.references for situation in situations]),
            np.concatenate([situation.others for situation in situations]),
            counts,
            partners,
        )

    def __len__(self) -> int:
        return len(self.counts)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(G,) first player of each game."""
        return np.asarray(np.cumsum(self.counts) - self.counts)

    @cached_property
    def game(self) -> np.ndarray:
        """(N,) the game of each player."""
        return np.repeat(np.arange(len(self)), self.counts)

    @cached_property
    def place(self) -> np.ndarray:
        """(N,) the place of each player in its game."""
        return np.asarray(np.arange(len(self.game)) - self.offsets[self.game])

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values (G,) of games, repeated for their players: (N, 1, 1)."""
        return np.asarray(values[self.game][:, None, None])

    def largest(self, at: Linearisation) -> np.ndarray:
        """(G,) the largest entry of each game's gradients."""
        return np.maximum.reduceat(np.abs(at.gradients).max(axis=1), self.offsets)

    def norms(self, at: Linearisation) -> np.ndarray:
        """(G,) the norm of each game's gradients."""
        return np.sqrt(np.add.reduceat((at.gradients**2).sum(axis=1), self.offsets))

    def subset(self, which: np.ndarray) -> tuple["_Games", np.ndarray]:
        """The games of a mask (G,), and the indices of their players."""
        if which.all():
            return self, np.arange(len(self.game))
        players = np.flatnonzero(which[self.game])
        renumbered = np.full(len(self.game) + 1, len(players))
        renumbered[players] = np.arange(len(players))
        return _Games(
            self.initial_state[players],
            self.weights[players],
            self.references[players],
            self.others[players],
            self.counts[which],
            renumbered[self.partners[players]],
        ), players


class _Search:
    """Newton's method on a batch of games; ``open`` (G,) masks those that are not finished."""

    def __init__(
        self,
        game: ReferenceGame,
        games: _Games,
        unknowns: np.ndarray,
        tolerance: float,
        small_change: np.ndarray,
    ) -> None:
        self._game, self._games, self._unknowns = game, games, unknowns
        self._tolerance, self._small_change = tolerance, small_change
        self._at = game.evaluate(games, unknowns)
        self._iterations = np.zeros(len(games), dtype=int)
        self._solved = games.largest(self._at) < tolerance
        self.open = ~self._solved

    def advance(self, max_change: np.ndarray) -> None:
        """Take one Newton step in every open game."""
        indices = np.flatnonzero(self.open)
        games, players = self._games.subset(self.open)
        at = self._at.take(players)
        change = self._game.newton_step(games, at)
        size = np.abs(change).max(axis=1)
        small = np.logical_and.reduceat((size <= self._small_change).all(axis=1), games.offsets)
        scale = np.maximum.reduceat((size / max_change).max(axis=1), games.offsets)
        change /= games.spread(np.fmax(1.0, scale))
        self._finish(indices[small], players, change, small[games.game])
        rest, rows = games.subset(~small)
        if len(rest):
            self._descend(rest, players[rows], at.take(rows), change[rows], indices[~small])

    def _finish(
        self, indices: np.ndarray, players: np.ndarray, change: np.ndarray, rows: np.ndarray
    ) -> None:
        """Take the last step of some games; ``rows`` is the mask of their players."""
        which = players[rows]
        self._unknowns[which] += change[rows]
        if len(which):
            states = self._game.states(self._games.initial_state[which], self._unknowns[which])
            self._at.states[which] = states
        self._iterations[indices] += 1
        self._solved[indices] = True
        self.open[indices] = False

    def _descend(
        self,
        games: _Games,
        players: np.ndarray,
        at: Linearisation,
        change: np.ndarray,
        indices: np.ndarray,
    ) -> None:
        """Take steps, each shortened until the gradients of its game shrink."""
        start, before = self._unknowns[players], games.norms(at)
        length = np.ones(len(games))
        trial = self._game.evaluate(games, start + change)
        while (worse := ~(games.norms(trial) < before) & (length > 0.1)).any():
            length[worse] /= 2
            few, rows = games.subset(worse)
            shorter = start[rows] + (games.spread(length) * change)[rows]
            trial.put(rows, self._game.evaluate(few, shorter))
        # The last, short step is taken even uphill: a local rise is better than a standstill.
        moved = np.isfinite(games.norms(trial))
        rows = np.flatnonzero(moved[games.game])
        self._at.put(players[rows], trial.take(rows))
        self._unknowns[players[rows]] += (games.spread(length) * change)[rows]
        self._iterations[indices[moved]] += 1
        solved = moved & (games.largest(trial) < self._tolerance)
        self._solved[indices] = solved
        self.open[indices] = moved & ~solved

    def plans(self) -> list[Plan]:
        """The plan of each game."""
        games = self._games
        states = np.concatenate([games.initial_state[:, None], self._at.states], axis=1)
        states, controls = states.swapaxes(0, 1), self._unknowns.swapaxes(0, 1)
        residuals, convex = games.largest(self._at), _are_convex(self._at.own_hessians)
        ends = games.offsets + games.counts
        return [
            Plan(
                states=states[:, first:end],
                controls=controls[:, first:end],
                residual=float(residuals[index]),
                iterations=int(self._iterations[index]),
                converged=bool(self._solved[index] and convex[first:end].all()),
            )
            for index, (first, end) in enumerate(zip(games.offsets, ends, strict=True))
        ]


def _are_convex(hessians: np.ndarray) -> np.ndarray:
    """Mask (N,) of the Hessians (N, n, n) that are positive definite."""
    try:
        np.linalg.cholesky(hessians)
    except np.linalg.LinAlgError:
        finite = np.isfinite(hessians).all(axis=(1, 2))
        mask = np.zeros(len(hessians), dtype=bool)
        mask[finite] = np.linalg.eigvalsh(hessians[finite])[:, 0] > 0
        return mask
    return np.ones(len(hessians), dtype=bool)


def _convexified(hessians: np.ndarray) -> np.ndarray:
    """Hessians (N, n, n) with the signs of negative eigenvalues changed."""
    rows = np.flatnonzero(~_are_convex(hessians) & np.isfinite(hessians).all(axis=(1, 2)))
    if len(rows) == 0:
        return hessians
    values, vectors = np.linalg.eigh(hessians[rows])
    values = np.maximum(np.abs(values), 1e-3)
    result = hessians.copy()
    result[rows] = (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2)
    return result


def _step_cost(
    game: ReferenceGame,
    state: ca.SX,
    control: ca.SX,
    near: list[ca.SX],
    reference: ca.SX,
    weights: ca.SX,
) -> ca.SX:
    units = game.units
    stage = Stage(0, (state,), control, game.dynamics, game.dt)
    px, py, direction, speed = ca.vertsplit(reference)
    beside = (state[1] - py) * ca.cos(direction) - (state[0] - px) * ca.sin(direction)
    terms = (
        sum((_proximity(game, state, point) for point in near), ca.SX(0)),
        ((state[3] - speed) / units.speed) ** 2,
        ControlEffort("acceleration", (game.dt * units.acceleration) ** -2).running_cost(stage),
        _turning(game, state, control),
        (beside / units.lane) ** 2 + 2 * (1 - ca.cos(state[2] - direction)) / units.heading**2,
    )
    return ca.dot(weights, ca.vertcat(*terms))


def _proximity(game: ReferenceGame, state: ca.SX, point: ca.SX) -> ca.SX:
    """Cost of one nearby point; zero, by a mask, for an unused entry, which would turn the car."""
    stage = Stage(0, (state, point), None, game.dynamics, game.dt)
    cost = CarProximity(game.units.length, game.units.width).running_cost(stage)
    return ca.if_else(point[0] < FAR_AWAY / 2, cost, 0.0)


def _turning(game: ReferenceGame, state: ca.SX, control: ca.SX) -> ca.SX:
    """Cost of lateral acceleration, speed times yaw rate; steering keeps it convex at rest."""
    steering = control[0]
    yaw_rate = state[3] * ca.sin(ca.atan(ca.tan(steering) / 2)) / game.rear_axle
    effort = (steering / game.units.steering) ** 2
    return (state[3] * yaw_rate / game.units.turning) ** 2 + effort
