"""Samples of the posterior where players leave the equilibrium: soft first-order conditions.

Each control leaves that of the equilibrium by a random, independent kick. Nobody answers a kick, so
that a player's samples move by S w, where S is their derivative in the player's own controls:

    (I1)  y - h(x(theta, x_1)) = S w + noise,    w_tj ~ N(0, q_j),

one variance q_j for each control j, shared by all steps and players. With all q at zero this is
the joint method, with its equilibrium as a hard condition; with large ones only what no kick
explains is left to learn from, as in the residual method. Kicks move cars smoothly and noise does
not, so that they can be told apart; the noise has f times the deviation that is told, or else more
noise than told would be taken for kicks. The samples have the covariance
C = f^2 sigma^2 + S q S', so the errors of ``posterior_density`` are whitened by it:

    (I2)  log pi(z, x_1) = -|L^-1 (y - h(x))|^2 / 2 - |z|^2 / 2,    L L' = C.

The variances have the largest restricted likelihood at the peak of (I2), which counts what the fit
takes from the errors:

    (I3)  min over q, f of  log |C| + r' C^-1 r - |M^-1 J' C^-1 r|^2 + 2 log |M| + (log f / tau)^2,
          M M' = J' C^-1 J + P

with residuals r, their derivative J and the prior's precision P. Peak and variances are found in
turn.

Who plans again and again does not stop planning at the last sample: at step t, its plan of T states
ends at t + T, in the mean half a recording later. So where kicks explain the samples far better
than none, the game is taken that ends by half of the recording later, unless the evidence for the
told end is very strong (Laplace's approximation of the integral of I2).

Paper: none; restricted likelihood after Patterson and Thompson 1971.
Assumes: what ``posterior`` does, but for kicks.
Cost: that of ``posterior`` and a half, twice as much where games of other ends are tried.
Trust: its weights, where players act at random around an equilibrium, or plan again and again. It
    predicts as if no further kick came.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import OptimizeResult, minimize

from olne_bench.estimators.posterior import Posterior, different_peaks
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.perturbed_fits import Fits, Peak
from olne_bench.estimators.shared.posterior_density import GameDensity, Places, climbed
from olne_bench.estimators.shared.trajectory_fit import guess_controls
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.solve.root_following import from_independent_players

#: Rounds of peak and variances at most, and the change of coordinates that ends them.
_ROUNDS, _STILL = 4, 0.01
#: Logarithm of the mean variance that kicks add to a sample, over that of its noise: where the
#: search starts, its ends, and where there are none.
_FIRST, _LEAST, _MOST, _NONE = -2.0, -12.0, 8.0, -50.0
#: Deviation tau of log f, and how far log f goes.
_SPREAD, _FARTHEST = 0.5, 3.0
#: A factor f this far from 1 is told.
_OFF = 1.25
#: Twice the gain of log likelihood from which on kicks are told.
_TOLD = 9.2
#: Difference of log evidence that is very strong (Kass and Raftery 1995).
_STRONG = 5.0


@dataclass(frozen=True)
class KickedDensity(GameDensity):
    """(I2)."""

    kicks: "Kicks" = field(kw_only=True)
    beyond: int = 0  # steps of the game behind the last sample

    def whitened(self, places: Places) -> Places:
        """Places of the density without kicks as those of this one."""
        whitening = self.kicks.whitening
        n = len(whitening)
        errors, rows = places.errors.copy(), np.empty(len(places), dtype=object)
        errors[:, :n] = errors[:, :n] @ whitening.T
        for k, row in enumerate(places.rows):
            rows[k] = np.concatenate([whitening @ row[:n], row[n:]])
        return replace(places, errors=errors, rows=rows)

    def _places(self, *known: np.ndarray) -> Places:
        return self.whitened(super()._places(*known))


@dataclass(frozen=True)
class Kicks:
    """What is known of kicks.

    Attributes:
        deviations: (m,) standard deviation of each control.
        noise_factor: standard deviation of the noise over the one that is told.
        whitening: (n, n) inverse of the root of the samples' covariance, over sigma.
        gain: twice the log likelihood that kicks gain.
    """

    deviations: np.ndarray
    noise_factor: float
    whitening: np.ndarray
    gain: float

    @classmethod
    def most_likely(cls, place: Places, moved: np.ndarray) -> "Kicks":
        """(I3) at a place of the density without kicks, samples moved (n, m, kicks) over sigma."""
        n = len(moved)
        errors, prior = place.errors[0, :n], place.rows[0][n:]
        shapes = np.einsum("nmk,lmk->mnl", moved, moved)
        sizes = np.maximum(np.trace(shapes, axis1=1, axis2=2) / n, np.finfo(float).tiny)
        shapes /= sizes[:, None, None]
        precision, rows = prior.T @ prior, place.rows[0][:n]

        def root_of(logs: np.ndarray) -> np.ndarray:
            kicked = np.tensordot(np.exp(logs[1:]), shapes, 1)
            return np.asarray(cholesky(np.exp(logs[0]) * np.eye(n) + kicked, lower=True))

        def cost(logs: np.ndarray) -> float:
            root = root_of(logs)
            both = solve_triangular(root, np.column_stack([rows, errors]), lower=True)
            J, r = both[:, :-1], both[:, -1]
            M = cholesky(J.T @ J + precision, lower=True)
            fitted = solve_triangular(M, J.T @ r, lower=True)
            volumes = np.log(np.diag(root)).sum() + np.log(np.diag(M)).sum()
            told = (logs[0] / 2 / _SPREAD) ** 2
            return float(r @ r - fitted @ fitted + 2 * volumes + told)

        def least(first: float, ends: tuple[float, float]) -> OptimizeResult:
            """The least cost with variances of kicks from so much on and between ends."""
            start = np.array([0.0] + [first] * len(shapes))
            bounds = [(-2 * _FARTHEST, 2 * _FARTHEST)] + [ends] * len(shapes)
            return minimize(cost, start, method="L-BFGS-B", bounds=bounds)

        found, without = least(_FIRST, (_LEAST, _MOST)), least(_NONE, (_NONE, _NONE))
        whitening = solve_triangular(root_of(found.x), np.eye(n), lower=True)
        factor, *sizes_found = np.exp(found.x / 2)
        deviations = np.array(sizes_found) / np.sqrt(sizes)
        return cls(deviations, float(factor), whitening, float(without.fun - found.fun))


@dataclass(frozen=True)
class Imperfect(Posterior):
    """Samples of weights, unknowns and initial state of players whose controls are kicked.

    Parameters are as of ``posterior``.
    """

    name: ClassVar[str] = "imperfect"
    #: Kicks are those of one motion.
    together: ClassVar[None] = None  # type: ignore[assignment]

    def peaks(
        self, problem: Problem, observation: Observation, deadline: float
    ) -> tuple[GameDensity, list[Peak]]:
        known = problem, observation, deadline
        found = self._kicked(*known)
        if found is None:
            return self.density(*known), []
        if found[0].kicks.gain < _TOLD:
            return found
        later = self._kicked(*known, problem.game.horizon // 2, found)
        if later is None or _log_mass(found) - _log_mass(later) > _STRONG:
            return found
        return later

    def _kicked(
        self,
        problem: Problem,
        observation: Observation,
        deadline: float,
        beyond: int = 0,
        near: tuple[KickedDensity, list[Peak]] | None = None,
    ) -> tuple[KickedDensity, list[Peak]] | None:
        """(I2) of a game that ends so many steps behind the last sample; None without a peak."""
        known = _going_on(problem, observation, beyond)
        plain, peaks = super().peaks(*known, deadline)
        places = [one.place for one in peaks]
        if near is not None:
            places += _same_weights(plain, *near)
        every = []
        for place in places:
            kicks = _settled(plain, place)
            density = KickedDensity(**vars(plain), kicks=kicks, beyond=beyond)
            kicked = different_peaks(density, map(density.whitened, places))
            every += [(density, kicked)] if kicked else []
        return max(every, key=_log_mass, default=None)

    def _estimate(
        self,
        density: GameDensity,
        peaks: Sequence[Peak],
        fits: Fits,
        rng: np.random.Generator,
    ) -> Estimate:
        found = super()._estimate(density, peaks, fits, rng)
        assert isinstance(density, KickedDensity)
        kicks, names = density.kicks, density.problem.game.dynamics.control_names
        sizes = dict(zip(names, map(float, kicks.deviations), strict=True))
        extras = {**found.extras, **{f"kick_{name}": size for name, size in sizes.items()}}
        extras["noise_factor"] = kicks.noise_factor
        later = extras["plans_later"] = density.beyond * density.problem.game.dt
        said = [found.message]
        if kicks.gain >= _TOLD:
            told = ", ".join(f"{name} by {size:.2g}" for name, size in sizes.items())
            said.append(f"players leave the equilibrium: {told}")
        if max(kicks.noise_factor, 1 / kicks.noise_factor) > _OFF:
            said.append(f"noise is {kicks.noise_factor:.2g} times as told")
        if density.beyond:
            said.append(f"players plan for {later:.2g} s behind the last sample")
        count = density.problem.game.horizon - density.beyond
        states = None if found.states is None else found.states[:count]
        return replace(found, states=states, message="; ".join(filter(None, said)), extras=extras)


def _log_mass(found: tuple[KickedDensity, list[Peak]]) -> float:
    """Laplace's approximation of log integral of (I2), with the volume of its whitening."""
    density, (peak, *_) = found
    return peak.log_mass + float(np.log(np.diag(density.kicks.whitening)).sum())


def _settled(density: GameDensity, place: Places) -> Kicks:
    """Kicks and the peak near a place, found in turn."""
    for _ in range(_ROUNDS):
        kicks = Kicks.most_likely(place, _moved(density, place))
        kicked = KickedDensity(**vars(density), kicks=kicks)
        before, found = place.points, climbed(kicked, kicked.whitened(place))
        place = density.reach(found.points, place)
        if not place.possible[0] or np.abs(place.points - before).max() < _STILL:
            break
    return kicks


def _same_weights(
    density: GameDensity, other: KickedDensity, peaks: Sequence[Peak]
) -> list[Places]:
    """The place of the weights and the start of another density's peak, if there is a game."""
    theta, starts = (part[0] for part in other.split(peaks[0].place.points))
    game, count = density.problem.game, density.problem.game.num_weights
    root = from_independent_players(game, starts, np.zeros(game.control_shape), theta)
    if root is None:
        return []
    unknown = theta[:, count:] if game.parameters.count else None
    place = density.place(SolvedGame(root, theta[:, :count], unknown))
    return [place] if place.possible[0] else []


def _going_on(
    problem: Problem, observation: Observation, beyond: int
) -> tuple[Problem, Observation]:
    """The same of a game that ends so many steps later, of which no more is seen."""
    game = replace(problem.game, horizon=problem.game.horizon + beyond)
    unseen = np.full((beyond, *observation.y.shape[1:]), np.nan)
    return replace(problem, game=game), Observation(np.concatenate([observation.y, unseen]))


def _moved(density: GameDensity, place: Places) -> np.ndarray:
    """S (n, m, (T-1)*N) over sigma, of the samples that were seen, at a place."""
    game, (states, samples) = density.problem.game, density.seen_at(place)
    controls, size = guess_controls(game, states), game.dynamics.state_size
    steps, players, m = controls.shape
    inputs = np.concatenate([states[:-1], controls], axis=2)
    slopes = _step_slopes(game.dynamics, game.dt)(inputs.reshape(-1, size + m))
    slopes = slopes.reshape(steps, players, size + m, size).swapaxes(2, 3)
    change = np.zeros((players, size, m, steps))
    moved = np.zeros((*samples.shape[:3], m, steps, players))
    for t in range(steps):
        change = np.einsum("iab,ibmk->iamk", slopes[t, :, :, :size], change)
        change[..., t] += slopes[t, :, :, size:]
        for i in range(players):
            moved[t + 1, i, :, :, :, i] = np.tensordot(samples[t + 1, i], change[i], 1)
    seen = np.isfinite(density.observation.y)
    return np.asarray(moved[seen].reshape(int(seen.sum()), m, -1))


@lru_cache(maxsize=16)
def _step_slopes(dynamics: Dynamics, dt: float) -> RowFunction:
    """State and control (n + m,) -> derivative (n, n + m) of the next state, column by column."""
    both = ca.SX.sym("xu", dynamics.state_size + dynamics.control_size)
    state, control = both[: dynamics.state_size], both[dynamics.state_size :]
    slopes = ca.densify(ca.jacobian(dynamics.step(state, control, dt), both))
    return RowFunction(ca.Function("slopes", [both], [slopes]), None)
