"""Independent points near a density pi(x) = exp(-|F(x)|^2 / 2): fits of perturbed errors.

Bardsley, Solonen, Haario and Laine (2014), "Randomize-then-optimize". With the derivative J = QR of
F at a peak, a point solves (P1) by Newton's method, and has the density (P2) if it is unique:

    (P1)  Q' F(x) = xi,    xi ~ N(0, I)
    (P2)  log q(x) = log |det Q' J(x)| - |Q' F(x)|^2 / 2.

If F is linear, q is pi. Points at which the determinant has another sign than at the peak belong to
another solution of (P1) and do not count.

Any place serves as a peak, and q is the mixture of all. What fits from one do not reach has a large
weight w = pi / q once a point is near it: while few points carry the weight, the next fits start at
a point that is drawn with the probability w^2 / sum w^2, its part in the loss of effective points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import logsumexp

from olne_bench.estimators.shared.posterior_density import Density, Places

#: Steps of Newton's method, the largest error of (P1) at its end, and the longest step, in widths
#: of the peak times the root of the number of dimensions.
_STEPS, _SOLVED, _LONGEST = 15, 0.02, 1.0

#: Each step is cut by the factor up to so many times, until the error falls.
_CUTS, _CUT = 4, 1 / 3

#: After this share of all fits, they end if the effective size, growing in proportion, would stay
#: below that share of what suffices.
_PATIENCE, _HOPEFUL = 0.375, 1 / 3

#: Least share of a peak.
_LEAST_SHARE = 0.05


@dataclass(frozen=True)
class Peak:
    """A place from which fits start, and the directions of (P1)."""

    place: Places  # one place
    directions: np.ndarray  # Q (O, d)
    triangle: np.ndarray  # R (d, d)
    sign: float  # of det Q' J there
    width: float  # root of the mean variance of the coordinates, by Laplace's approximation

    @classmethod
    def at(cls, place: Places) -> "Peak":
        """Fits from one place; LinAlgError if the errors do not depend on a direction there."""
        q, r = np.linalg.qr(place.rows[0])
        size = np.abs(np.diag(r))
        if not size.min() > 1e-12 * size.max():
            raise np.linalg.LinAlgError("a direction changes nothing")
        width = float(np.linalg.norm(np.linalg.inv(r)) / np.sqrt(len(r)))
        return cls(place, q, r, float(np.linalg.slogdet(q.T @ place.rows[0])[0]), width)

    @property
    def size(self) -> int:
        """D."""
        return len(self.triangle)

    @property
    def log_mass(self) -> float:
        """Laplace's approximation of log integral pi, without its constant."""
        volume = np.log(np.abs(np.diag(self.triangle))).sum()
        return float(self.place.log_density[0] - volume)

    def offsets(self, places: Places) -> np.ndarray:
        """Q' F (B, d)."""
        return np.asarray(places.errors @ self.directions)

    def slopes(self, places: Places) -> np.ndarray:
        """Q' J (B, d, d)."""
        slopes = [self.directions.T @ row for row in places.rows]
        return np.array(slopes).reshape(len(places), self.size, self.size)

    def log_density(self, places: Places) -> np.ndarray:
        """(P2) of places (B,)."""
        signs, volumes = np.linalg.slogdet(self.slopes(places))
        values = volumes - np.sum(self.offsets(places) ** 2, axis=1) / 2
        return np.where(places.possible & (signs == self.sign), values, -np.inf)


def counts_of(peaks: Sequence[Peak], total: int) -> list[int]:
    """How many fits start at each peak; those of little mass get more than their due."""
    masses = np.array([peak.log_mass for peak in peaks])
    shares = np.exp((masses - masses.max()) / 2).clip(_LEAST_SHARE)
    bounds = np.rint(np.cumsum([0.0, *(shares / shares.sum())]) * total).astype(int)
    return [int(count) for count in np.diff(bounds)]


@dataclass(frozen=True)
class Fits:
    """Points of the mixture of all peaks."""

    parts: Sequence[Places]  # places that solve (P1), those from one peak after the other; M in all
    log_weights: np.ndarray  # (M,) log pi / q, normalised: their exponentials sum to one
    asked: int  # number of fits that were begun
    tried: int  # points at which F was asked for

    @property
    def points(self) -> np.ndarray:
        """(M, d)."""
        return np.concatenate([part.points for part in self.parts])

    def place(self, number: int) -> Places:
        """One of the M places."""
        for part in self.parts:
            if number < len(part):
                return part.at(np.array([number]))
            number -= len(part)
        raise IndexError(number)

    @property
    def effective(self) -> float:
        """Effective sample size 1 / sum w^2 of the ``shares``."""
        return effective_sample_size(self._cut)

    @property
    def lost(self) -> float:
        """Share of the fits that have no solution of (P1)."""
        return 1 - int(np.isfinite(self.log_weights).sum()) / self.asked

    @property
    def shares(self) -> np.ndarray:
        """(M,) weights that sum to one, cut at their mean times sqrt(M) (Ionides 2008)."""
        return np.asarray(np.exp(self._cut))

    def tempered(self, enough: float) -> tuple[np.ndarray, float]:
        """As ``shares``, to the largest power up to one that leaves ``enough`` effective; and it.

        Weights of a power below one stand for a density between pi and q, which is wider than pi.
        """
        powers, power = tempered(self._cut, enough)
        return np.asarray(np.exp(powers - logsumexp(powers))), power

    @cached_property
    def _cut(self) -> np.ndarray:
        """Logarithms (M,) of ``shares``."""
        if not np.isfinite(self.log_weights).any():
            return self.log_weights
        cut = np.minimum(self.log_weights, -np.log(len(self.log_weights)) / 2)
        return np.asarray(cut - logsumexp(cut))

    @property
    def split_r_hat(self) -> float:
        """The largest R-hat, over coordinates, of four parts of the points."""
        points, shares = self.points, self.shares
        variance = shares @ (points - shares @ points) ** 2
        parts = [(points[k::4], shares[k::4]) for k in range(4)]
        if min(own.sum() for _, own in parts) == 0:
            return np.inf
        means = np.array([own @ some / own.sum() for some, own in parts])
        between = means.var(axis=0, ddof=1) / np.maximum(variance, np.finfo(float).tiny)
        return float(np.sqrt(1 + between.max()))


def resampled(shares: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices (count,) of equal weight, in random order, from weights (M,) that sum to one."""
    places = (rng.random() + np.arange(count)) / count
    chosen = np.searchsorted(np.cumsum(shares), places)
    return rng.permutation(chosen.clip(max=len(shares) - 1))


def tempered(log_weights: np.ndarray, enough: float) -> tuple[np.ndarray, float]:
    """Log weights times the largest factor up to one that leaves ``enough`` effective; and it."""
    some = np.isfinite(log_weights)

    def scaled(factor: float) -> np.ndarray:
        return np.where(some, factor * np.where(some, log_weights, 0.0), -np.inf)

    def excess(factor: float) -> float:
        return effective_sample_size(scaled(factor)) - enough

    if excess(1.0) >= 0:
        return log_weights, 1.0
    factor = float(brentq(excess, 0.0, 1.0, xtol=1e-12)) if excess(0.0) > 0 else 0.0
    return scaled(factor), factor


def effective_sample_size(log_weights: np.ndarray) -> float:
    """(sum w)^2 / sum w^2 of weights by their logarithms; zero if all weights are."""
    largest = log_weights.max(initial=-np.inf)
    if not np.isfinite(largest):
        return 0.0
    weights = np.exp(log_weights - largest)
    return float(weights.sum() ** 2 / (weights @ weights))


def perturbed_fits(
    density: Density,
    peaks: Sequence[Peak],
    rng: np.random.Generator,
    *,
    first: int,
    more: int,
    most: int,
    enough: float,
) -> Fits:
    """Points from all peaks with their weights, and from drawn points until they suffice.

    There are ``first`` fits from the peaks, ``more`` from every further place, and ``most`` in all;
    fewer if they would hardly suffice. An effective sample size of ``enough`` suffices.
    """
    pool = _Pool(density, rng)
    for peak, count in zip(peaks, counts_of(peaks, first), strict=True):
        pool.add(peak, count)
    while True:
        fits = pool.fits()
        if not 0 < fits.effective < enough or fits.asked + more > most:
            return fits
        if fits.asked >= _PATIENCE * most and _reachable(fits, most) < _HOPEFUL * enough:
            return fits
        squares = np.exp(2 * fits.log_weights)
        drawn = rng.choice(len(squares), size=1, p=squares / squares.sum())
        if not pool.add(Peak.at(fits.place(int(drawn[0]))), more):
            return pool.fits()


def _reachable(fits: Fits, most: int) -> float:
    """The effective size of all fits, if it grows in proportion to their number."""
    return fits.effective * most / fits.asked


class _Pool:
    """Fits from several places, and the density of each under all of them."""

    def __init__(self, density: Density, rng: np.random.Generator) -> None:
        self._density, self._rng = density, rng
        self._peaks: list[Peak] = []
        self._counts: list[int] = []
        self._places: list[Places] = []
        self._known: list[list[np.ndarray]] = []  # for each peak, (P2) of the places of each
        self._tried = 0

    def add(self, peak: Peak, count: int) -> bool:
        """Fits from one more place; False if none ended."""
        places, tried = _solved(self._density, peak, self._rng.standard_normal((count, peak.size)))
        self._peaks.append(peak)
        self._counts.append(count)
        self._places.append(places)
        self._tried += tried
        self._known.append([peak.log_density(own) for own in self._places[:-1]])
        for one, known in zip(self._peaks, self._known, strict=True):
            known.append(one.log_density(places))
        return len(places) > 0

    def fits(self) -> Fits:
        """All so far."""
        counts = np.array(self._counts)
        log_density = np.concatenate([own.log_density for own in self._places])
        known = np.array([np.concatenate(own) for own in self._known])
        reached = np.isfinite(known).any(axis=0)
        log_weights = np.full(len(log_density), -np.inf)
        if reached.any():
            shares = counts[:, None] / counts.sum()
            mixture = logsumexp(known[:, reached], axis=0, b=shares)
            log_weights[reached] = log_density[reached] - mixture
            log_weights -= logsumexp(log_weights)
        return Fits(tuple(self._places), log_weights, int(counts.sum()), self._tried)


def _solved(density: Density, peak: Peak, wanted: np.ndarray) -> tuple[Places, int]:
    """The places that solve (P1) for xi (B, d), and at how many points F was asked for."""
    places = peak.place.at(np.zeros(len(wanted), dtype=int))
    slopes = np.repeat(peak.slopes(peak.place), len(wanted), axis=0)
    left, tried = np.arange(len(wanted)), 0
    for _ in range(_STEPS):
        away = places.errors[left] @ peak.directions - wanted[left]
        left = left[np.linalg.norm(away, axis=1) > _SOLVED]
        if not left.size:
            break
        left, count = _improved(density, peak, places, slopes, left, wanted)
        tried += count
    errors = np.linalg.norm(peak.offsets(places) - wanted, axis=1)
    return places.at(errors <= _SOLVED), tried


def _improved(
    density: Density,
    peak: Peak,
    places: Places,
    slopes: np.ndarray,
    left: np.ndarray,
    wanted: np.ndarray,
) -> tuple[np.ndarray, int]:
    """One step of Newton's method from some places, in place: those that got better, its cost.

    ``slopes`` are Q' J of the places, and change with them.

    A step is better if the next one, with the same derivative, would be shorter (Deuflhard's
    natural test). Errors themselves grow where a long step leaves a narrow, bent valley. Beyond a
    change of the determinant's sign, only points that do not count would be found.
    """
    before = slopes[left]
    away = places.errors[left] @ peak.directions - wanted[left]
    steps = -np.linalg.solve(before, away[..., None])[..., 0]
    lengths, worse, tried = _lengths(peak, steps), np.arange(len(left)), 0
    steps /= np.maximum(1.0, lengths / (_LONGEST * np.sqrt(peak.size)))[:, None]
    for _ in range(_CUTS):
        own = left[worse]
        start = places.at(own)
        trial = density.reach(start.points + steps[worse], start)
        tried += len(own)
        after = (peak.offsets(trial) - wanted[own])[..., None]
        after = np.linalg.solve(before[worse], after)[..., 0]
        reached = peak.slopes(trial)
        signs = np.linalg.slogdet(reached)[0]
        good = trial.possible & (signs == peak.sign) & (_lengths(peak, after) < lengths[worse])
        places.put(own[good], trial.at(good))
        slopes[own[good]] = reached[good]
        worse = worse[~good]
        if not worse.size:
            break
        steps[worse] *= _CUT
    return np.delete(left, worse), tried


def _lengths(peak: Peak, steps: np.ndarray) -> np.ndarray:
    """Of steps (B, d), in widths of the peak; R'R misleads where a bent valley turns."""
    return np.asarray(np.linalg.norm(steps, axis=1) / peak.width)
