"""Compare two runs of a suite on different draws: the same ranks, and medians within intervals?

    olne-bench run roads --out runs/roads
    olne-bench run roads --salt again --out runs/again
    python scripts/same_ranks.py runs/roads runs/again

A cell is a scenario and a sensor. Differences that are not significant are ties. So ranks agree
up to ties where no two estimators that a run tells apart change places. Rank numbers are compared,
too: they depend on which others are significantly better, and may change places among ties.
Medians at a noise level differ where their 95 % intervals do not meet. Of equal medians, each is
within the other's interval in some 79 % of cases, as both are of draws; that share is printed, too.
Prints shares and what does not agree, and where one run's significant win is the other's loss.
"""

from collections import defaultdict
from itertools import combinations
from pathlib import Path

import shared
import pandas as pd

from olne_bench.bench.report.statistics.estimator_comparison import significant_wins

CELL = ["scenario", "sensor"]
LEVEL = [*CELL, "sigma", "estimator"]
ERRORS = ("position_error", "cosine_error")
NEGLIGIBLE = 1e-7  # errors below it are rounding


def main(runs: tuple[Path, ...]) -> None:
    """Command line."""
    folders = runs
    boards = [pd.read_csv(folder / "leaderboard.csv") for folder in folders]
    levels = [pd.read_csv(folder / "errors_by_noise.csv") for folder in folders]
    tests = [pd.read_csv(folder / "comparisons.csv") for folder in folders]
    for error in ERRORS:
        changed = _changed_places(boards, error)
        wins = [_wins(run, error) for run in tests]
        ties = {
            cell: not pairs & {frozenset(pair) for won in wins for pair in won[cell]}
            for cell, pairs in changed.items()
        }
        numbers = {cell: not pairs for cell, pairs in changed.items()}
        _say(f"{error}: same ranks up to ties in", pd.Series(ties))
        _say(f"{error}: no rank numbers change places in", pd.Series(numbers))
        agreed = {cell: not _reversed(wins[0][cell], wins[1][cell]) for cell in changed}
        _say(f"{error}: no pair is significant one way and the other in", pd.Series(agreed))
        both = _both_levels(levels, error)
        within = _reaches(both, "median", "median").mean()
        print(f"{error}: each median within the other's interval in {within:.1%} of {len(both)}")
        _say(f"{error}: intervals meet in", _reaches(both, "low", "high"))


def _say(what: str, agrees: pd.Series) -> None:
    print(f"{what} {agrees.mean():.1%} of {len(agrees)}")
    for place in agrees.index[~agrees]:
        print(f"  not in {', '.join(map(str, place))}")


def _changed_places(boards: list[pd.DataFrame], error: str) -> dict[tuple, set[frozenset]]:
    """Pairs whose ranks are in one order in one run and in the other in the other, by cell."""
    both = boards[0].merge(boards[1], on=[*CELL, "estimator"], suffixes=("_1", "_2"))
    ranks = both.set_index([*CELL, "estimator"])[[f"{error}_rank_1", f"{error}_rank_2"]].dropna()
    return {
        cell: {
            frozenset((one[0], other[0]))
            for one, other in combinations(own.droplevel([0, 1]).to_records().tolist(), 2)
            if (one[1] - other[1]) * (one[2] - other[2]) < 0
        }
        for cell, own in ranks.groupby(CELL)
    }


def _wins(tests: pd.DataFrame, error: str) -> defaultdict[tuple, set[tuple[str, str]]]:
    """Significant wins of one run, as pairs of winner and loser, by cell."""
    found: defaultdict[tuple, set[tuple[str, str]]] = defaultdict(set)
    for row in significant_wins(tests, error).itertuples():
        found[row.scenario, row.sensor].add((str(row.winner), str(row.loser)))
    return found


def _reversed(one: set[tuple[str, str]], other: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Wins of one run that the other run gives to the loser."""
    return one & {(loser, winner) for winner, loser in other}


def _both_levels(levels: list[pd.DataFrame], error: str) -> pd.DataFrame:
    """Medians and intervals of both runs, by cell, level and estimator."""
    both = levels[0].merge(levels[1], on=LEVEL, suffixes=("_1", "_2")).set_index(LEVEL)
    found = both.filter(regex=f"^{error}_(median|low|high)_[12]$").dropna()
    return found.rename(columns=lambda name: name.removeprefix(f"{error}_"))


def _reaches(both: pd.DataFrame, least: str, most: str) -> pd.Series:
    """Whether each run's numbers reach into the interval of the other."""
    agrees = [
        (both[f"{least}_{own}"] <= both[f"high_{other}"] + NEGLIGIBLE)
        & (both[f"{most}_{own}"] >= both[f"low_{other}"] - NEGLIGIBLE)
        for own, other in ((1, 2), (2, 1))
    ]
    return pd.Series(agrees[0] & agrees[1], index=both.index)


if __name__ == "__main__":
    shared.command(main)
