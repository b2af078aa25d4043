"""Samples of the posterior where players leave the equilibrium, or the noise is not as told.

Each control leaves that of the equilibrium by a random, independent kick. Nobody answers a kick, so
that a player's samples move by S w, where S is their derivative in the player's own controls:

    (I1)  y - h(x(theta, x_1)) = S w + noise,    w_tj ~ N(0, q_j),

one variance q_j for each control j, shared by all steps and players. With all q at zero this is
the joint method, with its equilibrium as a hard condition; with large ones only what no kick
explains is left to learn from, as in the residual method.

What is not as told of the noise would be taken for kicks, but for its shape: it has f times the
deviation sigma that is told, and may have parts that last, b_1 with the correlation rho from one
sample to the next, and b_2 that stays. So the samples have the covariance

    (I2)  C = sigma^2 (f^2 I + b_1 R + b_2 B) + S q S'

where R has rho^|t - s| and B has 1 between samples s and t of the same player and component. The
errors of ``posterior_density`` are whitened by it:

    (I3)  log pi(z, x_1) = -|L^-1 (y - h(x))|^2 / 2 - |z|^2 / 2,    L L' = C.

The variances have the largest restricted likelihood at the peak of (I3), which counts what the fit
takes from the errors:

    (I4)  min  log |C| + r' C^-1 r - |M^-1 J' C^-1 r|^2 + 2 log |M| + (log f / tau)^2
               + 2 sqrt b_1 + 2 sqrt b_2,        M M' = J' C^-1 J + P

with residuals r, their derivative J and the prior's precision P; the noise has a prior around what
is told. Peak and variances are found in turn.

Who plans again and again does not stop planning at the last sample: at step t, its plan of T states
ends at t + T, in the mean half a recording later. So where kicks explain the samples far better
than none, the game is taken that ends by half of the recording later, unless the evidence for the
told end is very strong (Laplace's approximation of the integral of I3). Noise that lasts is taken
where its evidence is very strong.

Paper: none; restricted likelihood after Patterson and Thompson 1971.
Assumes: what ``posterior`` does, but for kicks and the noise.
Cost: up to twice that of ``posterior``, three times where a later end is tried.
Trust: its weights, where players act at random around an equilibrium, or plan again and again. It
    predicts as if no further kick came.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from olne_bench.estimators.posterior import Posterior, different_peaks
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.forward_model import SolvedGame
from olne_bench.estimators.shared.perturbed_fits import Fits, Peak
from olne_bench.estimators.shared.posterior_density import GameDensity, Places, climbed
from olne_bench.estimators.shared.sample_series import steps_apart, with_unseen
from olne_bench.estimators.shared.trajectory_fit import guess_controls
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.solve.root_following import from_independent_players

#: Rounds of peak and variances at most, and the change of coordinates that ends them.
_ROUNDS, _STILL = 4, 0.01
#: Logarithm of the mean variance that kicks add to a sample, over that of its noise: where the
#: search starts, and its ends.
_FIRST, _LEAST, _MOST = -2.0, -12.0, 8.0
#: Deviation tau of log f, how far log f goes, the correlation rho, and an f that is told.
_SPREAD, _FARTHEST, _LAG, _OFF = 0.5, 3.0, 0.8, 1.25
#: A relative change of (I4) that ends the search for variances.
_ENOUGH = 1e-5
#: Parts of the noise in (I2).
_NOISES = 3
#: Twice the gain of log likelihood from which on kicks are told.
_TOLD = 9.2
#: Difference of log evidence that is very strong (Kass and Raftery 1995).
_STRONG = 5.0


@dataclass(frozen=True)
class KickedDensity(GameDensity):
    """(I3)."""

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
    """What is known of kicks and noise.

    Attributes:
        deviations: (m,) standard deviation of each control.
        noise: (3,) deviations of white noise, of noise that lasts and of a bias, over sigma.
        whitening: (n, n) inverse of the root of the samples' covariance, over sigma.
        gain: twice the log likelihood that kicks gain.
        log_volume: what the log density has beside (I3): the noise's prior, the whitening's volume.
    """

    deviations: np.ndarray
    noise: np.ndarray
    whitening: np.ndarray
    gain: float
    log_volume: float

    @classmethod
    def most_likely(
        cls, place: Places, moved: np.ndarray, seen: np.ndarray, *, lasting: bool
    ) -> "Kicks":
        """(I4) at a place of the density without kicks.

        Args:
            place: what is most probable so far.
            moved: samples (n, m, kicks) over sigma, moved by kicks.
            seen: (T, N, d) which samples these are.
            lasting: whether noise may last.
        """
        n = len(moved)
        kicked = np.einsum("nmk,lmk->mnl", moved, moved)
        sizes = np.maximum(np.trace(kicked, axis1=1, axis2=2) / n, np.finfo(float).tiny)
        shapes = np.concatenate([_noises(seen), kicked / sizes[:, None, None]])
        errors, rows, prior = place.errors[0, :n], place.rows[0][:n], place.rows[0][n:]
        precision = prior.T @ prior

        def root_of(variances: np.ndarray) -> np.ndarray:
            return np.asarray(cholesky(np.tensordot(variances, shapes, 1), lower=True))

        def cost(variances: np.ndarray) -> float:
            root = root_of(variances)
            both = solve_triangular(root, np.column_stack([rows, errors]), lower=True)
            J, r = both[:, :-1], both[:, -1]
            M = cholesky(J.T @ J + precision, lower=True)
            fitted = solve_triangular(M, J.T @ r, lower=True)
            volumes = np.log(np.diag(root)).sum() + np.log(np.diag(M)).sum()
            return float(r @ r - fitted @ fitted + 2 * (volumes + _surprise(variances)))

        noises, kicks = list(range(_NOISES if lasting else 1)), list(range(_NOISES, len(shapes)))
        found, without = (_least(cost, len(shapes), noises + more) for more in (kicks, []))
        noise, variances = np.split(found, [_NOISES])
        whitening = solve_triangular(root_of(found), np.eye(n), lower=True)
        gain = cost(without) - cost(found)
        volume = float(np.log(np.diag(whitening)).sum() - _surprise(found))
        return cls(np.sqrt(variances / sizes), np.sqrt(noise), whitening, gain, volume)


def _surprise(variances: np.ndarray) -> float:
    """Less the log prior of the noise, whose variances are the first."""
    factor, *lasting = np.sqrt(variances[:_NOISES])
    return float((np.log(factor) / _SPREAD) ** 2 / 2 + sum(lasting))


#: A density and its peaks, the most probable first.
Kicked = tuple[KickedDensity, list[Peak]]


def _least(cost: Callable[[np.ndarray], float], count: int, used: Sequence[int]) -> np.ndarray:
    """So many variances with the least cost; those that are not used are zero, the first is f^2."""

    def of(logs: np.ndarray) -> np.ndarray:
        variances = np.zeros(count)
        variances[used] = np.exp(logs)
        return variances

    def of_logs(logs: np.ndarray) -> float:
        return cost(of(logs))

    others = len(used) - 1
    bounds = [(-2 * _FARTHEST, 2 * _FARTHEST)] + [(_LEAST, _MOST)] * others
    start = np.array([0.0] + [_FIRST] * others)
    return of(minimize(of_logs, start, method="L-BFGS-B", bounds=bounds, tol=_ENOUGH).x)


def _noises(seen: np.ndarray) -> np.ndarray:
    """I, R and B of (I2) between the samples that were seen."""
    apart, same = steps_apart(seen)
    return np.stack([same & (apart == 0), same * _LAG**apart, same]).astype(float)


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
        plain, places = self._plain(*known)
        found = _kicked(plain, places, lasting=False)
        if found is None:
            return plain, []
        best, half = found, problem.game.horizon // 2
        if found[0].kicks.gain >= _TOLD:
            later = self._plain(*known, half, found)
            best = _likelier(found, _kicked(*later, lasting=False, beyond=half), -_STRONG)
        return _likelier(best, _kicked(plain, places, lasting=True), _STRONG)

    def _plain(
        self,
        problem: Problem,
        observation: Observation,
        deadline: float,
        beyond: int = 0,
        near: Kicked | None = None,
    ) -> tuple[GameDensity, list[Places]]:
        """The density without kicks, of a game that ends so many steps later, and its peaks."""
        plain, peaks = super().peaks(*_going_on(problem, observation, beyond), deadline)
        places = [one.place for one in peaks]
        return plain, places + ([] if near is None else _same_weights(plain, *near))

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
        factor, lasting, bias = map(float, kicks.noise)
        extras |= {"noise_factor": factor, "noise_lasting": lasting, "noise_bias": bias}
        later = extras["plans_later"] = density.beyond * density.problem.game.dt
        said = [found.message]
        if kicks.gain >= _TOLD:
            told = ", ".join(f"{name} by {size:.2g}" for name, size in sizes.items())
            said.append(f"players leave the equilibrium: {told}")
        if lasting or bias:
            said.append("errors last, or there is a bias")
        elif max(factor, 1 / factor) > _OFF:
            said.append(f"noise is {factor:.2g} times as told")
        if density.beyond:
            said.append(f"players plan for {later:.2g} s behind the last sample")
        count = density.problem.game.horizon - density.beyond
        states = None if found.states is None else found.states[:count]
        return replace(found, states=states, message="; ".join(filter(None, said)), extras=extras)


def _kicked(
    plain: GameDensity, places: Sequence[Places], *, lasting: bool, beyond: int = 0
) -> Kicked | None:
    """(I3) of the largest mass among those of variances near each place; None without a peak."""
    every = []
    for place in places:
        kicks = _settled(plain, place, lasting=lasting)
        density = KickedDensity(**vars(plain), kicks=kicks, beyond=beyond)
        peaks = different_peaks(density, map(density.whitened, places))
        every += [(density, peaks)] if peaks else []
    return max(every, key=_log_mass, default=None)


def _likelier(one: Kicked, other: Kicked | None, least: float) -> Kicked:
    """The other, if its log mass is larger by so much at least."""
    return one if other is None or _log_mass(other) - _log_mass(one) < least else other


def _log_mass(found: Kicked) -> float:
    """Laplace's approximation of the log of an integral of (I3), with kicks and noise."""
    density, (peak, *_) = found
    return peak.log_mass + density.kicks.log_volume


def _settled(density: GameDensity, place: Places, *, lasting: bool) -> Kicks:
    """Kicks and the peak near a place, found in turn."""
    for _ in range(_ROUNDS):
        moved, seen = _moved(density, place), np.isfinite(density.observation.y)
        kicks = Kicks.most_likely(place, moved, seen, lasting=lasting)
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
    return replace(problem, game=game), Observation(with_unseen(observation.y, game.horizon))


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
