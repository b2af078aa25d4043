"""Fit HighwayEnv's stock drivers to a recording: what a user without games would do to predict."""

from dataclasses import astuple, dataclass, fields

import numpy as np
from scipy.optimize import least_squares

from olne_bench.envs.roads.stock_drivers import StockDriver, drive_among, drive_stock
from olne_bench.games.model.game import Game

#: Least and largest values of a driver's parameters, in the order of ``StockDriver``.
_LOW, _HIGH = (0.1, 0.1, 5.5, 0.3, 0.5), (45.0, 4.0, 30.0, 8.0, 12.0)
#: How far parameters are from HighwayEnv's before that weighs as much as an error of the noise's
#: size: a short window does not determine all of them.
_DEVIATIONS = (10.0, 1.5, 5.0, 2.0, 4.0)
#: Finite differences, relative to these deviations; MOBIL's decisions make smaller ones rough.
_STEP = 1e-2
#: Evaluations of the residuals at most; those for derivatives are not counted.
_MOST_EVALUATIONS = 15


@dataclass(frozen=True)
class StockFit:
    """A fitted driver, and the player's states (n, 4) as it drove them."""

    driver: StockDriver
    states: np.ndarray


def fit_stock(
    name: str, game: Game, player: int, seen: np.ndarray, deviations: np.ndarray
) -> StockFit:
    """Fit one player's driver and first state to a window, the others moving as recorded.

    Args:
        name: name of the road.
        game: says which lanes each player keeps.
        player: index of the player.
        seen: (n, N, 4) noisy states.
        deviations: (4,) standard deviations of their noise.
    """
    first, usual = seen[0, player], np.array(astuple(StockDriver(float(seen[0, player, 3]))))
    scale = np.concatenate([_DEVIATIONS, deviations])
    low = np.concatenate([_LOW, first - 4 * deviations])
    high = np.concatenate([_HIGH, first + 4 * deviations])
    centre = np.concatenate([usual.clip(_LOW, _HIGH), first])
    # SciPy's steps are relative to the variables, so these start at one.
    origin = centre - scale

    def drive(point: np.ndarray) -> np.ndarray:
        driver = StockDriver(*map(float, point[: len(usual)]))
        return drive_among(name, game, player, point[len(usual) :], driver, seen)

    def residuals(x: np.ndarray) -> np.ndarray:
        errors = (drive(origin + scale * x) - seen[:, player]) / deviations
        return np.concatenate([errors.ravel(), x[: len(usual)] - 1])

    found = least_squares(
        residuals,
        np.ones(len(scale)),
        bounds=((low - origin) / scale, (high - origin) / scale + 1e-9),
        diff_step=np.full(len(scale), _STEP),
        max_nfev=_MOST_EVALUATIONS,
    )
    point = origin + scale * found.x
    values = dict(zip((f.name for f in fields(StockDriver)), map(float, point), strict=False))
    return StockFit(StockDriver(**values), drive(point))


def predict_by_fit(
    name: str, game: Game, seen: np.ndarray, deviations: np.ndarray, steps: int
) -> np.ndarray:
    """Fit all players' drivers to a window and let them drive on together from its last states.

    Args:
        name: name of the road.
        game: says which lanes each player keeps.
        seen: (n, N, 4) noisy states.
        deviations: (4,) standard deviations of their noise.
        steps: number of steps to predict.

    Returns:
        States (steps + 1, N, 4), the window's last ones first.
    """
    fits = [fit_stock(name, game, player, seen, deviations) for player in range(seen.shape[1])]
    return drive_stock(name, game, seen[-1], [fit.driver for fit in fits], steps)
