"""Which estimators rank where, and why others do not, who are shown and compared with nobody.

A plugin does not rank on published weights, which it may simply know, and no estimator in a
scenario and sensor where it has implausible rows, until fresh draws confirm them.
"""

from collections.abc import Iterable, Sequence

import pandas as pd

from olne_bench.bench.report.statistics.attempts import places_of
from olne_bench.bench.report.statistics.plausibility import implausible
from olne_bench.bench.report.study import Study

#: Standings of those who rank, and of plugins on published weights.
RANKS, PUBLISHED = "ranks", "published weights"
_UNCONFIRMED, _CONFIRMED = "implausible", "confirmed"
KEY = ["scenario", "sensor", "estimator"]
#: Columns of a leaderboard in which someone does not rank, or has implausible rows.
COLUMNS = ("implausible", "standing")


def standings(trials: pd.DataFrame, study: Study) -> pd.DataFrame:
    """The standing of every estimator in every scenario and sensor.

    Columns: ``scenario, sensor, estimator``, ``implausible`` (number of such rows) and
    ``standing``: ``ranks``, or ``confirmed`` with errors, or why the estimator does not rank.
    """
    marked = implausible(trials, study)
    known = {one.place: one for one in study.confirmations}
    rows = []
    for place, numbers in places_of(trials, KEY).items():
        own = numbers[marked[numbers]]
        standing = RANKS
        if study.is_published(place[0]) and study.is_foreign(place[2]):
            standing = PUBLISHED
        elif len(own):
            found = known.get(place)
            levels = set(trials["sigma"].iloc[own])
            about = found is not None and levels <= set(found.sigmas)
            standing = found.text if found is not None and about else _UNCONFIRMED
        rows.append((*place, len(own), standing))
    return pd.DataFrame(rows, columns=[*KEY, *COLUMNS])


def ranking(trials: pd.DataFrame, standing: pd.DataFrame) -> pd.DataFrame:
    """The rows of estimators that rank in their scenario and sensor; no copy if these are all."""
    return _without(trials, standing[~ranks_at(standing)])


def plausible(trials: pd.DataFrame, standing: pd.DataFrame) -> pd.DataFrame:
    """The rows where nothing is implausible, or fresh draws have confirmed it."""
    return _without(trials, standing[~ranks_at(standing) & (standing["implausible"] > 0)])


def _without(trials: pd.DataFrame, others: pd.DataFrame) -> pd.DataFrame:
    if others.empty:
        return trials
    left = pd.MultiIndex.from_frame(others[KEY])
    return trials[~pd.MultiIndex.from_frame(trials[KEY]).isin(left)]


def ranks_at(table: pd.DataFrame) -> pd.Series:
    """Which rows of a table with a column ``standing`` rank; all, if it has none."""
    if "standing" not in table:
        return pd.Series(True, table.index)
    return table["standing"].eq(RANKS) | table["standing"].str.startswith(_CONFIRMED)


def if_told(board: pd.DataFrame) -> pd.DataFrame:
    """A leaderboard, without these columns if everyone ranks and no row is implausible."""
    plain = board.empty or (board["standing"].eq(RANKS).all() and not board["implausible"].any())
    return board.drop(columns=[*COLUMNS], errors="ignore") if plain else board


def said_of_standing(board: pd.DataFrame) -> list[str]:
    """Sentences on who does not rank where, and on implausible rows; empty if all is usual."""
    if "standing" not in board:
        return []
    return [*_of_published(board), *_of_implausible(board[board["implausible"] > 0])]


def _of_published(board: pd.DataFrame) -> Iterable[str]:
    for name, rows in board[board["standing"] == PUBLISHED].groupby("estimator", sort=True):
        yield (
            f"{name} has no rank in {listed(sorted(rows['scenario'].unique()))}: the true weights "
            "are published constants there, which a plugin may know. Plugins rank where truths are "
            "drawn."
        )


def _of_implausible(board: pd.DataFrame) -> Iterable[str]:
    for row in board.sort_values(KEY).to_dict("records"):
        number, standing = row["implausible"], str(row["standing"])
        rows = "1 row is" if number == 1 else f"{number} rows are"
        start = (
            f"{row['estimator']} in {row['scenario']}, {row['sensor']}: {rows} implausible, with "
            "an error far below the statistical limit"
        )
        if standing == _UNCONFIRMED:
            yield f"{start}; no rank until 'olne-bench confirm' has run fresh draws."
        else:
            yield f"{start}; {standing}."


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
