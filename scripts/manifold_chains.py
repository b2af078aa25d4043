"""Long Markov chains on a density of errors, as a reference for faster samplers.

Every step of the chains has three parts. F and its derivative J are those at a place
(``posterior_density``), G = J' J; a point without a game has a density of zero.

1. The simplified manifold Metropolis-adjusted Langevin algorithm (Girolami and Calderhead 2011):
   x' ~ N(x - h^2/2 G^-1 J' F, h^2 G^-1), with log-normal lengths h, as bends need short steps and
   tails long ones. The scale of h is adapted in the first half, which is not kept.
2. Differential evolution (ter Braak 2006), against bent and second modes: x' = x + length (a - b) +
   noise, where a and b are two chains of the other half. One in ten steps has the length 1, which
   leads from one mode to another.
3. Against narrow valleys that bend, a step in coordinates in which they are straight: with the Q of
   J = QR at an anchor, xi = Q' F(x) has the density pi(x) / |det Q' J(x)|, nearly a normal one
   (Bardsley et al. 2014), which xi' = sqrt(1 - s^2) xi + s N(0, I) leaves as it is (Cotter et al.
   2013). Newton's method finds x'. Anchors are the peaks and places of the first half.
"""

from contextlib import suppress
from dataclasses import fields

import numpy as np
from tqdm import tqdm

from olne_bench.estimators.shared.perturbed_fits import Peak, counts_of
from olne_bench.estimators.shared.posterior_density import Density, Places

#: Of differential evolution: the length, over the root of twice the number of coordinates, which is
#: best for a normal density; the share of steps of length 1; and the noise, as a share of the
#: population's deviations.
_BEST_LENGTH, _WHOLE, _NOISE = 2.38, 0.1, 1e-3

#: Of straightened steps: the first s and the longest, the wanted share of accepted ones, the
#: standard deviation of the logarithms of s, the number of anchors besides the peaks, and of
#: Newton's method the steps at most and the error of xi at its end.
_TURN, _MOST_TURN, _TURNED, _TURN_SPREAD, _ANCHORS = 0.5, 0.95, 0.4, 0.8, 10
_NEWTON, _SOLVED = 8, 1e-4

#: Wanted share of accepted steps, the first length, how fast the length follows the share, and the
#: standard deviation of the logarithms of lengths.
_ACCEPTED, _LENGTH, _RATE, _SPREAD = 0.5, 0.8, 0.1, 1.0


def run_chains(
    density: Density, peaks: list[Peak], rng: np.random.Generator, count: int, steps: int, thin: int
) -> tuple[np.ndarray, float]:
    """Chains that start around all peaks, by Laplace's approximation.

    Args:
        density: of what is sampled.
        peaks: where chains start.
        rng: the source of randomness.
        count: number of chains.
        steps: of each chain; the first half is not kept.
        thin: one of so many points is kept.

    Returns:
        Points (C, S, d) of the second half, and the share of accepted straightened steps.
    """
    places, length, turn = _starts(density, peaks, count, rng), _LENGTH, _TURN
    anchors, half, kept, accepted = list(peaks), steps // 2, [], []
    for step in tqdm(range(steps), leave=False, disable=None):
        share = _step(density, places, length, rng)
        _evolve(density, places, rng)
        turned = _straightened(density, anchors[rng.integers(len(anchors))], places, turn, rng)
        if step < half:
            length *= np.exp(_RATE * (share - _ACCEPTED))
            turn = min(_MOST_TURN, turn * np.exp(_RATE * (turned - _TURNED)))
            if step % max(1, half // _ANCHORS) == 0:
                anchors += _anchor(places, rng)
        else:
            accepted.append(turned)
            if step % thin == 0:
                kept.append(places.points.copy())
    return np.stack(kept, axis=1), float(np.mean(accepted))


def _anchor(places: Places, rng: np.random.Generator) -> list[Peak]:
    """One of the places; none if a direction changes nothing there."""
    with suppress(np.linalg.LinAlgError):
        return [Peak.at(places.at(rng.choice(len(places), 1)))]
    return []


def _starts(density: Density, peaks: list[Peak], count: int, rng: np.random.Generator) -> Places:
    """Points around the peaks; the peak itself where there is no game."""
    found = []
    for peak, number in zip(peaks, counts_of(peaks, count), strict=True):
        places = peak.place.at(np.zeros(number, dtype=int))
        offsets = np.linalg.solve(peak.triangle, rng.standard_normal((peak.size, number))).T
        trial = density.reach(places.points + offsets, places)
        places.put(trial.possible, trial.at(trial.possible))
        found.append(places)
    names = [field.name for field in fields(Places)]
    return Places(*(np.concatenate([getattr(one, name) for one in found]) for name in names))


def _step(density: Density, places: Places, length: float, rng: np.random.Generator) -> float:
    """One Langevin step of all chains, in place; the share that is accepted."""
    lengths = length * np.exp(_SPREAD * rng.standard_normal(len(places)))
    means, roots = _proposal(places, lengths)
    noise = rng.standard_normal(places.points.shape)
    upper = np.swapaxes(roots, 1, 2)
    trial = density.reach(means + np.linalg.solve(upper, noise[..., None])[..., 0], places)
    good = trial.possible.copy()
    if good.any():
        back = _proposal(trial.at(good), lengths[good])
        gain = trial.log_density[good] - places.log_density[good]
        gain += _log_normal(*back, places.points[good])
        gain -= _log_normal(means, roots, trial.points)[good]
        good[good] = np.log(rng.random(int(good.sum()))) < gain
        places.put(good, trial.at(good))
    return float(good.mean())


def _proposal(places: Places, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where chains go: means (B, d), and roots L (B, d, d) of the precisions L L'."""
    rows = np.stack(list(places.rows))
    metric = np.swapaxes(rows, 1, 2) @ rows
    slope = np.einsum("bod,bo->bd", rows, places.errors)
    drift = np.linalg.solve(metric, slope[..., None])[..., 0]
    means = places.points - lengths[:, None] ** 2 / 2 * drift
    return means, np.linalg.cholesky(metric) / lengths[:, None, None]


def _log_normal(means: np.ndarray, roots: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Log density (B,), less a constant, of points (B, d)."""
    away = np.einsum("bij,bi->bj", roots, points - means)
    volumes = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(volumes - np.sum(away**2, axis=1) / 2)


def _evolve(density: Density, places: Places, rng: np.random.Generator) -> None:
    """One step of differential evolution of all chains, in place, half of them at a time."""
    order = rng.permutation(len(places))
    for movers, others in (np.array_split(order, 2), np.array_split(order, 2)[::-1]):
        pairs = np.array([rng.choice(others, 2, replace=False) for _ in movers])
        away = places.points[pairs[:, 0]] - places.points[pairs[:, 1]]
        usual = _BEST_LENGTH / np.sqrt(2 * away.shape[1])
        lengths = usual * np.exp(_SPREAD * rng.standard_normal(len(movers)))
        lengths[rng.random(len(movers)) < _WHOLE] = 1.0
        noise = _NOISE * places.points.std(axis=0) * rng.standard_normal(away.shape)
        here = places.at(movers)
        trial = density.reach(here.points + lengths[:, None] * away + noise, here)
        good = trial.possible.copy()
        gain = trial.log_density[good] - here.log_density[good]
        good[good] = np.log(rng.random(int(good.sum()))) < gain
        chosen = np.zeros(len(places), dtype=bool)
        chosen[movers[good]] = True
        # In the order of the places, as they are put.
        ranked = np.flatnonzero(good)[np.argsort(movers[good])]
        places.put(chosen, trial.at(ranked))


def _straightened(
    density: Density, anchor: Peak, places: Places, turn: float, rng: np.random.Generator
) -> float:
    """One step of all chains in straight coordinates, in place; the share that is accepted."""
    offsets, before = anchor.offsets(places), _straight_density(anchor, places)
    turns = np.minimum(_MOST_TURN, turn * np.exp(_TURN_SPREAD * rng.standard_normal(len(places))))
    wanted = np.sqrt(1 - turns[:, None] ** 2) * offsets
    wanted += turns[:, None] * rng.standard_normal(offsets.shape)
    found, solved = _followed(density, anchor, places, wanted)
    gain = np.where(np.isfinite(before) & solved, _straight_density(anchor, found), -np.inf)
    good = np.log(rng.random(len(places))) < gain - np.where(np.isfinite(before), before, 0.0)
    places.put(good, found.at(good))
    return float(good.mean())


def _straight_density(anchor: Peak, places: Places) -> np.ndarray:
    """Log of pi(x) / |det Q' J(x)| over the normal density of xi (B,), less a constant."""
    known = anchor.log_density(places)
    reached = np.isfinite(known)
    return np.where(reached, places.log_density - np.where(reached, known, 0.0), -np.inf)


def _followed(
    density: Density, anchor: Peak, places: Places, wanted: np.ndarray
) -> tuple[Places, np.ndarray]:
    """The places where xi is what is wanted (B, d), from these, and which are found (B,)."""
    found, solved = places.at(np.arange(len(places))), np.zeros(len(places), dtype=bool)
    left = np.arange(len(places))
    for _ in range(_NEWTON):
        here = found.at(left)
        slopes = anchor.slopes(here)
        away = (anchor.offsets(here) - wanted[left])[..., None]
        trial = density.reach(here.points - np.linalg.solve(slopes, away)[..., 0], here)
        left, trial = left[trial.possible], trial.at(trial.possible)
        found.put(left, trial)
        ended = np.linalg.norm(anchor.offsets(trial) - wanted[left], axis=1) <= _SOLVED
        solved[left[ended]] = True
        left = left[~ended]
        if not left.size:
            break
    return found, solved
