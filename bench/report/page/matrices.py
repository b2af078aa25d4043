"""Rows of the page's matrices: draws won, and recognised temperaments."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from olne_bench.bench.report.statistics.recognition import NOBODY
from olne_bench.bench.report.statistics.wins import ALL
from olne_bench.envs.roads.temperaments import TEMPERAMENTS

_PLACE = ["scenario", "sensor", "estimator"]


@dataclass(frozen=True)
class Win:
    """A share of draws won, with its 95 % interval, and its adjusted p-value."""

    wins: float
    low: float
    high: float
    p_holm: float
    draws: int


@dataclass(frozen=True)
class WinRow:
    """The shares that one estimator wins against each other one; None for itself.

    Attributes:
        scenario: its label; empty for all scenarios together.
        error: name of the error.
        estimator: label of the estimator.
        cells: one for each estimator of the page.
    """

    scenario: str
    error: str
    estimator: str
    cells: tuple[Win | None, ...]


@dataclass(frozen=True)
class Drivers:
    """Drivers of one temperament.

    Attributes:
        name: their temperament.
        error: median cosine error of their weights.
        seen: shares recognised as each temperament, and as none, in the order of ``SEEN``.
    """

    name: str
    error: float
    seen: tuple[float, ...]


@dataclass(frozen=True)
class DriverRow:
    """Who is recognised by an estimator, temperament by temperament, over all noise levels."""

    scenario: str
    sensor: str
    estimator: str
    drivers: tuple[Drivers | None, ...]


#: What a driver can be recognised as.
SEEN = (*TEMPERAMENTS, NOBODY)


def win_rows(wins: pd.DataFrame, estimators: Sequence[str]) -> list[WinRow]:
    """Rows of the matrices of draws won, those of all scenarios first.

    Args:
        wins: from ``statistics.wins.win_table``.
        estimators: labels in the order of the columns.
    """
    rows = []
    for (error, scenario), told in wins.groupby(["error", "scenario"], sort=False):
        found: dict[tuple[str, str], Win] = {}
        for row in told.to_dict("records"):
            share, low, high = row["wins"], row["wins_low"], row["wins_high"]
            p, draws = row["p_holm"], row["draws"]
            found[row["estimator"], row["other"]] = Win(share, low, high, p, draws)
            found[row["other"], row["estimator"]] = Win(1 - share, 1 - high, 1 - low, p, draws)
        place = "" if scenario == ALL else str(scenario)
        for name in estimators:
            cells = tuple(found.get((name, other)) for other in estimators)
            if any(cells):
                rows.append(WinRow(place, str(error), name, cells))
    return rows


def driver_rows(temperaments: pd.DataFrame, confusions: pd.DataFrame) -> list[DriverRow]:
    """Rows of the table of temperaments.

    Args:
        temperaments: from ``statistics.recognition.temperament_table``.
        confusions: from ``statistics.recognition.confusion_table``.
    """
    whole = temperaments[temperaments["sigma"].isna()]
    medians = whole.set_index([*_PLACE, "temperament"])["cosine_error_median"].to_dict()
    key = [*_PLACE, "temperament"]
    counts = confusions.pivot_table("drivers", key, "recognised", aggfunc="sum", fill_value=0)
    seen = counts.reindex(columns=list(SEEN), fill_value=0)
    shares = seen.div(seen.sum(axis=1), axis=0)
    told = {
        key: Drivers(key[-1], medians[key], tuple(row))
        for key, row in zip(shares.index, shares.to_numpy().tolist(), strict=True)
    }
    places = dict.fromkeys((key[0], key[1], key[2]) for key in told)
    return [
        DriverRow(*place, tuple(told.get((*place, own)) for own in TEMPERAMENTS))
        for place in places
    ]
