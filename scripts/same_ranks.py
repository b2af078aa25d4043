"""Compare two runs of a suite on different draws: the same scores, and medians within intervals?

    olne-bench run roads --out runs/roads
    olne-bench run roads --salt again --out runs/again
    python scripts/same_ranks.py runs/roads runs/again

Scores of a scenario and sensor differ where their 95 % intervals do not meet, and so do medians at
a noise level. Of equal medians, each is within the other's interval in some 79 % of cases, as both
are of draws; that share is printed, too. Prints shares and what does not agree, and where one run's
significant win in a scenario is the other's loss.
"""

from pathlib import Path

import shared
import pandas as pd

from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE

CELL = ["scenario", "sensor", "estimator"]
LEVEL = ["scenario", "sensor", "sigma", "estimator"]
PAIR = ["scenario", "estimator", "other"]
ERRORS = ("position_error", "cosine_error")
NEGLIGIBLE = 1e-7  # errors below it are rounding


def main(runs: tuple[Path, ...]) -> None:
    """Command line."""
    boards = [pd.read_csv(folder / "leaderboard.csv") for folder in runs]
    levels = [pd.read_csv(folder / "errors_by_noise.csv") for folder in runs]
    tests = [pd.read_csv(folder / "comparisons.csv") for folder in runs]
    for error in ERRORS:
        scores = _both(boards, CELL, f"{error}_score_")
        _say(f"{error}: intervals of scores meet in", _reaches(scores, "low", "high"))
        _say(f"{error}: no pair is significant one way and the other in", _agreed(tests, error))
        both = _both(levels, LEVEL, f"{error}_")
        within = _reaches(both, "median", "median").mean()
        print(f"{error}: each median within the other's interval in {within:.1%} of {len(both)}")
        _say(f"{error}: intervals of medians meet in", _reaches(both, "low", "high"))


def _say(what: str, agrees: pd.Series) -> None:
    print(f"{what} {agrees.mean():.1%} of {len(agrees)}")
    for place in agrees.index[~agrees]:
        print(f"  not in {', '.join(map(str, place))}")


def _agreed(tests: list[pd.DataFrame], error: str) -> pd.Series:
    """Whether no run's significant win is a significant loss in the other, by pair."""
    told = [table[table["error"] == error].set_index(PAIR) for table in tests]
    both = told[0].join(told[1], lsuffix="_1", rsuffix="_2", how="inner")
    clear = (both["p_holm_1"] < SIGNIFICANCE) & (both["p_holm_2"] < SIGNIFICANCE)
    return ~(clear & ((both["ratio_1"] < 1) != (both["ratio_2"] < 1)))


def _both(tables: list[pd.DataFrame], key: list[str], prefix: str) -> pd.DataFrame:
    """Numbers and intervals of both runs, by what they are about."""
    both = tables[0].merge(tables[1], on=key, suffixes=("_1", "_2")).set_index(key)
    found = both.filter(regex=f"^{prefix}(median|low|high)_[12]$").dropna()
    return found.rename(columns=lambda name: name.removeprefix(prefix))


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
