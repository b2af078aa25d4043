"""Methods that are fitted to other recorded cars, and the spread of everybody's errors there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from olne_bench.bench.people.cases import HORIZONS, Case
from olne_bench.envs.tracks.prediction import STEP
from olne_bench.estimators.shared.population import fitted_population
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

CAR_LENGTH = 4.5  # [m]
#: Penalties of linear and kernel regression, and the length of the kernel in standard deviations.
_RIDGE, _KERNEL, _LENGTH = 1.0, 1.0, 3.0
_FARTHEST = 80.0  # [m] of a gap that counts
_INPUTS = 8  # of regressions
#: Cars of a road from which its own spread is known.
_ENOUGH = 30
_FINEST = 0.01  # [m] of a spread
_IDM_START = (1.0, 1.5, 1.2, 2.0)  # [m/s^2], [m/s^2], [s], [m]
_IDM_STEPS = 60  # of its fit

#: Metres (H,) along the way of a case.
Along = Callable[[Case], np.ndarray]


@dataclass(frozen=True)
class Rivals:
    """What was learnt from other cars."""

    methods: dict[str, Along]
    prior: WeightPrior | None
    spreads: dict[tuple[str, str], np.ndarray]  # (H, 2) mean errors [m] by method and road

    def predicted(self, case: Case) -> dict[str, np.ndarray]:
        """(H, 2) of all methods; those that are fitted keep the place in the lane."""
        zeros = np.zeros(len(case.happened))
        found = {name: np.column_stack([of(case), zeros]) for name, of in self.methods.items()}
        found |= case.predicted
        if self.prior is not None and len(case.samples):
            shares = shares_of(case, self.prior)
            found["population"] = np.einsum("m,mhi->hi", shares, case.sampled)
        return found

    def spread(self, method: str, road: str) -> np.ndarray:
        """(H, 2) mean errors [m] of a method on a road, or on all roads."""
        return self.spreads.get((method, road), self.spreads[method, ""])


def shares_of(case: Case, prior: WeightPrior) -> np.ndarray:
    """(M,) probabilities of samples that were drawn with a flat prior, with another one."""
    logs = (prior.log_density(case.samples) - FLAT.log_density(case.samples)).sum(axis=1)
    shares = np.exp(logs - logs.max())
    return np.asarray(shares / shares.sum())


def fitted_to(others: Sequence[Case]) -> Rivals:
    """Fit to other cars; spreads are those of each half of their pieces by the other half.

    A single piece has no other half, so its spreads are a little small.
    """
    pieces = sorted({case.piece for case in others})
    halves = [[c for c in others if pieces.index(c.piece) % 2 == k] for k in (0, 1)]
    errors: dict[tuple[str, str], list[np.ndarray]] = {}
    for own, other in (halves, halves[::-1]):
        rivals = _fitted(other or own)
        for case in own:
            for method, places in rivals.predicted(case).items():
                off = np.full((len(HORIZONS), 2), np.nan)
                off[: len(places)] = np.abs(places - case.happened)
                errors.setdefault((method, case.road), []).append(off)
                errors.setdefault((method, ""), []).append(off)
    spreads = {k: _mean(v) for k, v in errors.items() if len(v) >= _ENOUGH or not k[1]}
    whole = _fitted(others)
    return Rivals(whole.methods, whole.prior, spreads)


def _mean(errors: Sequence[np.ndarray]) -> np.ndarray:
    """(H, 2) mean errors [m], NaN where there are none."""
    known = np.isfinite(errors).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.asarray((np.nansum(errors, axis=0) / known).clip(min=_FINEST))


def _fitted(others: Sequence[Case]) -> Rivals:
    """Without spreads."""
    methods = {"idm": _idm_of(others), "ridge": _ridge_of(others), "kernel": _kernel_of(others)}
    drawn = [case.samples[:, :1] for case in others if len(case.samples)]
    prior = fitted_population(drawn, FLAT) if len(drawn) > 2 else None
    return Rivals(methods, prior, {})


def _idm_of(others: Sequence[Case]) -> Along:
    """The intelligent driver model, fitted to errors after 3 s."""
    three = HORIZONS.index(3.0)

    def error(logs: np.ndarray) -> float:
        return float(np.mean([abs((idm(c, logs) - c.happened[:, 0])[three]) for c in others]))

    start = np.log(_IDM_START)
    found = minimize(error, start, method="Nelder-Mead", options={"maxiter": _IDM_STEPS}).x
    return lambda case: idm(case, found)


def idm(case: Case, parameters: np.ndarray) -> np.ndarray:
    """(H,) metres that a car drives by Treiber's model, as all ahead of it but the first."""
    acceleration, comfort, headway, distance = np.exp(parameters)
    speeds, places = case.speeds.copy(), np.concatenate([[0.0], np.cumsum(case.gaps)])
    driven = [0.0]
    for _ in range(round(HORIZONS[len(case.happened) - 1] / STEP)):
        gap = np.maximum(np.diff(places) - CAR_LENGTH, 0.5)
        own, ahead = speeds[:-1], speeds[1:]
        closing = own * (own - ahead) / (2 * np.sqrt(acceleration * comfort))
        wanted = distance + np.maximum(0.0, own * headway + closing)
        free = (own / np.maximum(case.speeds[:-1] * 1.3, 5.0)) ** 4
        change = acceleration * (1 - free - (wanted / gap) ** 2)
        change = np.append(change.clip(-8, acceleration), 0.0)
        places = places + np.maximum(speeds * STEP + change * STEP**2 / 2, 0.0)
        speeds = np.maximum(speeds + change * STEP, 0.0)
        driven.append(float(places[0]))
    return np.array([driven[round(h / STEP)] for h in HORIZONS[: len(case.happened)]])


def _inputs(case: Case) -> np.ndarray:
    """What regressions predict from."""
    speeds, slopes = (
        np.append(values[:3], [last] * max(0, 3 - len(values)))
        for values, last in ((case.speeds, case.speeds[-1]), (case.slopes, 0.0))
    )
    gap = min(case.gaps[0], _FARTHEST)
    return np.array([1.0, *(speeds[1:] - speeds[0]), speeds[0], gap, *slopes])


def _beyond(others: Sequence[Case], at: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and metres beyond driving straight on, of those who are recorded so far."""
    known = [case for case in others if len(case.happened) > at]
    inputs = np.array([_inputs(case) for case in known]).reshape(len(known), -1)
    beyond = [case.happened[at, 0] - case.predicted["straight"][at, 0] for case in known]
    return inputs, np.array(beyond)


def _ridge_of(others: Sequence[Case]) -> Along:
    """Linear regression."""
    lines = []
    for at in range(len(HORIZONS)):
        inputs, beyond = _beyond(others, at)
        count = inputs.shape[1]
        normal = inputs.T @ inputs + _RIDGE * np.eye(count)
        lines.append(np.linalg.solve(normal, inputs.T @ beyond) if count else np.zeros(_INPUTS))

    def along(case: Case) -> np.ndarray:
        more = [float(_inputs(case) @ line) for line in lines[: len(case.happened)]]
        return np.asarray(case.predicted["straight"][:, 0] + more)

    return along


def _kernel_of(others: Sequence[Case]) -> Along:
    """Kernel regression on inputs of variance one."""
    fits = []
    for at in range(len(HORIZONS)):
        inputs, beyond = _beyond(others, at)
        spread = inputs.std(axis=0) + 1e-9 if len(inputs) else np.ones(_INPUTS)
        known = inputs.reshape(-1, len(spread)) / spread / _LENGTH
        gram = np.exp(-cdist(known, known, "sqeuclidean")) + _KERNEL * np.eye(len(known))
        fits.append((known, spread, np.linalg.solve(gram, beyond)))

    def along(case: Case) -> np.ndarray:
        more = []
        for known, spread, factors in fits[: len(case.happened)]:
            own = (_inputs(case) / spread / _LENGTH)[None]
            more.append(float((np.exp(-cdist(own, known, "sqeuclidean")) @ factors)[0]))
        return np.asarray(case.predicted["straight"][:, 0] + more)

    return along
