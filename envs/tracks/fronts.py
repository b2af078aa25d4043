"""Centres of cars from the centres of their fronts."""

import numpy as np
import pandas as pd

_WINDOW = 1.0  # [s] over which a car's direction of travel is seen
_LEAST = 1.0  # [m] that it moves meanwhile, or in all; less is noise
_NEARLY = 0.9  # share of a car's samples
_ALONG = np.deg2rad(30)  # largest angle from the x axis of a car that keeps along the road


def travel(table: pd.DataFrame) -> pd.Series:
    """Each row's direction of travel [rad], from positions; NaN if a car never moves.

    While a car hardly moves, it is that between the times when it does.
    """
    found = pd.Series(np.nan, table.index)
    for _, rows in table.dropna(subset=["time", "x", "y"]).groupby("player", sort=False):
        rows = rows.sort_values("time")
        time, places = rows["time"].to_numpy(), rows[["x", "y"]].to_numpy()
        ahead, behind = (
            np.column_stack([np.interp(time + lag, time, values) for values in places.T])
            for lag in (_WINDOW / 2, -_WINDOW / 2)
        )
        step = ahead - behind
        if not (np.hypot(*step.T) > _LEAST).any():  # it creeps at most
            step = np.broadcast_to(places[-1] - places[0], step.shape)
        far = np.hypot(*step.T) > _LEAST
        if far.any():
            angles = np.unwrap(np.arctan2(step[far, 1], step[far, 0]))
            found[rows.index] = np.interp(time, time[far], angles)
    return found


def along_road(headings: pd.Series, players: pd.Series) -> pd.Series:
    """Headings, exactly those of the x axis or against it for players who nearly always keep it."""
    off = np.arcsin(np.abs(np.sin(headings)))
    keeps = players.map(off.groupby(players).quantile(_NEARLY)) < _ALONG
    return headings.mask(keeps, np.where(np.cos(headings) < 0, np.pi, 0.0))


def centred(table: pd.DataFrame, headings: pd.Series, ahead: pd.Series) -> pd.DataFrame:
    """The table with positions moved back by ``ahead`` [m]; an unknown heading is 0."""
    known = headings.fillna(0.0)
    return table.assign(x=table["x"] - ahead * np.cos(known), y=table["y"] - ahead * np.sin(known))
