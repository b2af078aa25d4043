"""Compare two runs of a suite on different draws: the same ranks, and medians within intervals?

    olne-bench run roads --out runs/roads
    olne-bench run roads --salt again --out runs/again
    python scripts/same_ranks.py runs/roads runs/again

A cell is a scenario and a sensor. Ranks agree up to ties where no estimator that ranks before
another in one run ranks behind it in the other. Medians at a noise level differ where their 95 %
intervals do not meet. Of equal medians, each is within the other's interval in some 79 % of cases,
as both are of draws; that share is printed, too. Prints what does not agree.
"""

import argparse
from itertools import combinations
from pathlib import Path

import pandas as pd

CELL = ["scenario", "sensor"]
LEVEL = [*CELL, "sigma", "estimator"]
ERRORS = ("position_error", "cosine_error")
NEGLIGIBLE = 1e-7  # errors below it are rounding


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", type=Path, nargs=2, help="folders of two runs")
    folders = parser.parse_args().runs
    boards = [pd.read_csv(folder / "leaderboard.csv") for folder in folders]
    levels = [pd.read_csv(folder / "errors_by_noise.csv") for folder in folders]
    for error in ERRORS:
        _say(f"{error}: same ranks up to ties in", _ranks(boards, error))
        both = _both_levels(levels, error)
        within = _reaches(both, "median", "median").mean()
        print(f"{error}: each median within the other's interval in {within:.1%} of {len(both)}")
        _say(f"{error}: intervals meet in", _reaches(both, "low", "high"))


def _say(what: str, agrees: pd.Series) -> None:
    print(f"{what} {agrees.mean():.1%} of {len(agrees)}")
    for place in agrees.index[~agrees]:
        print(f"  not in {', '.join(map(str, place))}")


def _ranks(boards: list[pd.DataFrame], error: str) -> pd.Series:
    """Whether no two estimators change places, by cell."""
    both = boards[0].merge(boards[1], on=[*CELL, "estimator"], suffixes=("_1", "_2"))
    ranks = both.set_index(CELL)[[f"{error}_rank_1", f"{error}_rank_2"]].dropna()
    found = {
        cell: all(
            (one[0] - other[0]) * (one[1] - other[1]) >= 0
            for one, other in combinations(own.to_numpy(), 2)
        )
        for cell, own in ranks.groupby(CELL)
    }
    return pd.Series(found, dtype=bool)


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
    main()
