"""Methods that are fitted to other recorded cars, and the spread of everybody's errors there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from olne_bench.bench.people.cases import HORIZONS, IMPERFECT, Case
from olne_bench.bench.people.driver_model import fitted_idm, fitted_manners, idm, mobil
from olne_bench.estimators.shared.population import fitted_population
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

#: Penalties of linear and kernel regression, and the length of the kernel in standard deviations.
_RIDGE, _KERNEL, _LENGTH = 1.0, 1.0, 3.0
_FARTHEST = 80.0  # [m] of a gap that counts
POPULATION = "population"  # method of a prior that is fitted to others
_INPUTS = 8  # of regressions
#: Cars of a road from which its own spread is known.
_ENOUGH = 30
_FINEST = 0.01  # [m] of a spread

#: Places (H, 2) along the way of a case and to its left [m].
Places = Callable[[Case], np.ndarray]


@dataclass(frozen=True)
class Rivals:
    """What was learnt from other cars."""

    methods: dict[str, Places]
    prior: WeightPrior | None
    spreads: dict[tuple[str, str], np.ndarray]  # (H, 2) mean errors [m] by method and road

    def predicted(self, case: Case) -> dict[str, np.ndarray]:
        """(H, 2) of all methods; a car without samples of its weights has equal ones."""
        found = {name: of(case) for name, of in self.methods.items()} | case.predicted
        if self.prior is not None:
            shares = self.shares(POPULATION, case)
            game = case.predicted["game"]
            found[POPULATION] = game if shares is None else np.tensordot(shares, case.sampled, 1)
        return found

    def shares(self, method: str, case: Case) -> np.ndarray | None:
        """(M,) probabilities of a case's samples by a method that has them; else None."""
        if not len(case.samples):
            return None
        if method == POPULATION and self.prior is not None:
            return shares_of(case, self.prior)
        count = len(case.samples)
        return np.full(count, 1 / count) if method == IMPERFECT else None

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
    logs = fitted_idm(others)
    manners = fitted_manners(others, logs)
    methods: dict[str, Places] = {
        "idm": lambda case: _in_lane(idm(case, logs)),
        "mobil": lambda case: mobil(case, logs, manners),
        "ridge": _ridge_of(others),
        "kernel": _kernel_of(others),
    }
    drawn = [case.samples[:, :1] for case in others if len(case.samples)]
    prior = fitted_population(drawn, FLAT) if len(drawn) > 2 else None
    return Rivals(methods, prior, {})


def _in_lane(along: np.ndarray) -> np.ndarray:
    """Places (H, 2) of who keeps its place in the lane."""
    return np.column_stack([along, np.zeros(len(along))])


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


def _ridge_of(others: Sequence[Case]) -> Places:
    """Linear regression."""
    lines = []
    for at in range(len(HORIZONS)):
        inputs, beyond = _beyond(others, at)
        count = inputs.shape[1]
        normal = inputs.T @ inputs + _RIDGE * np.eye(count)
        lines.append(np.linalg.solve(normal, inputs.T @ beyond) if count else np.zeros(_INPUTS))

    def driven(case: Case) -> np.ndarray:
        more = [float(_inputs(case) @ line) for line in lines[: len(case.happened)]]
        return _in_lane(case.predicted["straight"][:, 0] + more)

    return driven


def _kernel_of(others: Sequence[Case]) -> Places:
    """Kernel regression on inputs of variance one."""
    fits = []
    for at in range(len(HORIZONS)):
        inputs, beyond = _beyond(others, at)
        spread = inputs.std(axis=0) + 1e-9 if len(inputs) else np.ones(_INPUTS)
        known = inputs.reshape(-1, len(spread)) / spread / _LENGTH
        gram = np.exp(-cdist(known, known, "sqeuclidean")) + _KERNEL * np.eye(len(known))
        fits.append((known, spread, np.linalg.solve(gram, beyond)))

    def driven(case: Case) -> np.ndarray:
        more = []
        for known, spread, factors in fits[: len(case.happened)]:
            own = (_inputs(case) / spread / _LENGTH)[None]
            more.append(float((np.exp(-cdist(own, known, "sqeuclidean")) @ factors)[0]))
        return _in_lane(case.predicted["straight"][:, 0] + more)

    return driven
