"""Models of drivers that are fitted to other recorded cars: IDM, and MOBIL for changes of lanes.

A driver of MOBIL (Kesting, Treiber & Helbing 2007) takes a lane beside its own if nobody behind has
to brake hard there, and if it gains more acceleration than a threshold, what a car behind loses
counted by its politeness. It then follows who drives in that lane.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from olne_bench.bench.people.beside import Neighbour
from olne_bench.bench.people.cases import HORIZONS, Case
from olne_bench.envs.tracks.prediction import STEP

CAR_LENGTH = 4.5  # [m]
_START = (1.0, 1.5, 1.2, 2.0)  # [m/s^2], [m/s^2], [s], [m]
_STEPS = 60  # of the fit of IDM
_THREE = HORIZONS.index(3.0)  # where fits have least errors
_SHORTEST = 0.5  # [m] of a gap
#: Of MOBIL: seconds of a change of lanes; nobody is made to brake harder [m/s^2].
_TAKES, _SAFE = 4.0, 4.0
#: Among these the fit chooses; nobody changes lanes at the last threshold [m/s^2].
_POLITENESS, _THRESHOLDS = (0.0, 0.3), (0.1, 0.2, 0.5, 1.0, 2.0, np.inf)
_FREE = 1e3  # [m] of a gap to nobody


@dataclass(frozen=True)
class Manners:
    """What a driver minds in changing lanes."""

    politeness: float
    threshold: float  # [m/s^2]


def fitted_idm(others: Sequence[Case]) -> np.ndarray:
    """Logarithms of the parameters (4,) of IDM with the least errors after 3 s."""

    def error(logs: np.ndarray) -> float:
        return float(np.mean([abs((idm(c, logs) - c.happened[:, 0])[_THREE]) for c in others]))

    found = minimize(error, np.log(_START), method="Nelder-Mead", options={"maxiter": _STEPS})
    return np.asarray(found.x)


def idm(case: Case, logs: np.ndarray) -> np.ndarray:
    """(H,) metres that a car drives by Treiber's model, as all ahead of it but the first."""
    speeds, where = case.speeds.copy(), np.concatenate([[0.0], np.cumsum(case.gaps)])
    driven = [0.0]
    for _ in range(round(HORIZONS[len(case.happened) - 1] / STEP)):
        change = _acceleration(logs, speeds[:-1], speeds[1:], np.diff(where), case.speeds[:-1])
        change = np.append(change.clip(min=-8), 0.0)
        where = where + np.maximum(speeds * STEP + change * STEP**2 / 2, 0.0)
        speeds = np.maximum(speeds + change * STEP, 0.0)
        driven.append(float(where[0]))
    return np.array([driven[round(h / STEP)] for h in HORIZONS[: len(case.happened)]])


def _acceleration(
    logs: np.ndarray, own: np.ndarray, ahead: np.ndarray, apart: np.ndarray, usual: np.ndarray
) -> np.ndarray:
    """Accelerations at a distance of centres, of drivers who want a little more than usual."""
    acceleration, comfort, headway, distance = np.exp(logs)
    gap = np.maximum(apart - CAR_LENGTH, _SHORTEST)
    closing = own * (own - ahead) / (2 * np.sqrt(acceleration * comfort))
    wanted = distance + np.maximum(0.0, own * headway + closing)
    free = (own / np.maximum(usual * 1.3, 5.0)) ** 4
    return np.asarray((acceleration * (1 - free - (wanted / gap) ** 2)).clip(max=acceleration))


def fitted_manners(others: Sequence[Case], logs: np.ndarray) -> Manners:
    """The manners whose places after 3 s are nearest to those recorded, with a driver of IDM."""

    def error(manners: Manners) -> float:
        off = [(mobil(case, logs, manners) - case.happened)[_THREE] for case in others]
        return float(np.mean(np.linalg.norm(off, axis=1)))

    choices = [Manners(*one) for one in product(_POLITENESS, reversed(_THRESHOLDS))]
    return min(choices, key=error)


def mobil(case: Case, logs: np.ndarray, manners: Manners) -> np.ndarray:
    """(H, 2) places along the way and to its left of a driver who may change lanes."""
    own = case.speeds[0]
    here = _wish(logs, own, Neighbour(case.gaps[0], case.speeds[1]))
    best, chosen = manners.threshold, None
    for lane in case.beside:
        gain = _wish(logs, own, lane.ahead) - here
        if lane.behind is not None:
            behind = lane.behind
            after = _wish(logs, behind.speed, Neighbour(behind.gap, own))
            before = _wish(logs, behind.speed, _seen_over(behind, lane.ahead))
            gain += manners.politeness * (after - before)
            if after < -_SAFE:
                continue
        if gain > best:
            best, chosen = gain, lane
    times = np.array(HORIZONS[: len(case.happened)])
    if chosen is None:
        return np.column_stack([idm(case, logs), 0 * times])
    ahead = chosen.ahead or Neighbour(_FREE, own)
    there = replace(case, gaps=np.array([ahead.gap]), speeds=np.array([own, ahead.speed]))
    return np.column_stack([idm(there, logs), chosen.left * (times / _TAKES).clip(max=1)])


def _seen_over(behind: Neighbour, ahead: Neighbour | None) -> Neighbour | None:
    """Who is ahead of a car behind, as long as nobody cuts in."""
    return None if ahead is None else Neighbour(behind.gap + ahead.gap, ahead.speed)


def _wish(logs: np.ndarray, speed: float, ahead: Neighbour | None) -> float:
    """Acceleration [m/s^2] behind a car, or behind nobody."""
    ahead = ahead or Neighbour(_FREE, speed)
    own, other, gap = (np.array([number]) for number in (speed, ahead.speed, ahead.gap))
    return float(_acceleration(logs, own, other, gap, own)[0])
