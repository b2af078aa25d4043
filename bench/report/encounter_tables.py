"""Tables of encounters: planners by the value of information, and the contrasts that are tested."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from olne_bench.bench.plan.kinds import ORACLE
from olne_bench.bench.report.drive_tables import (
    collision_share,
    paired_differences,
    regret_of,
    tested,
)
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.pairs import holm
from olne_bench.envs.drive.starts import QUARTERS

_ALL = "all"
_FAMILY = ["road", "sigma"]
_MEANS = ("value", "collision_speed", "progress", "jerk", "cycle_50", "cycle_99", "late")
_TESTED = ("cost", "collision")
#: Sign changes of a test: its smallest p-value is 1e-6.
_SIGN_CHANGES = 999_999


def by_quarter(rows: pd.DataFrame) -> pd.DataFrame:
    """Attempts of an ``episode_table`` with their ``quarter`` by value: 1 to 4 of each road.

    Drives without a value of information are left out.
    """
    known = attempts_of(rows)
    known = known[known["value"].notna()]
    draws = known.drop_duplicates([*_FAMILY, "seed"])
    ranks = draws.groupby(_FAMILY)["value"].rank(method="first", pct=True)
    quarter = np.ceil(QUARTERS * ranks).astype(int)
    named = draws[[*_FAMILY, "seed"]].assign(quarter=quarter)
    return _placed(known.merge(named, on=[*_FAMILY, "seed"]))


def _placed(rows: pd.DataFrame) -> pd.DataFrame:
    """Statistics pair the drives of a place, whatever lines they are counted in."""
    return rows.assign(where=rows["road"])


def quarter_table(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each quarter, or all, and planner: over all roads.

    Columns: ``quarter, planner, drives``; collisions and regret as of ``drive_table``; means of the
    value of information, the speed of collisions [m/s], progress [m], jerk [m/s^3], percentiles of
    cycles [ms], and the share of late estimates.
    """
    lines = []
    for quarter, part in _parts(by_quarter(rows)):
        planners = dict(list(part.groupby("planner", sort=False)))
        oracle = planners.get(ORACLE, part.iloc[:0])
        for planner, own in planners.items():
            line = {"quarter": quarter, "planner": planner, "drives": len(own)}
            line |= collision_share(own) | regret_of(own, oracle)
            lines.append(line | {name: own[name].mean() for name in _MEANS})
    return pd.DataFrame(lines)


def contrast_table(rows: pd.DataFrame, contrasts: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """Paired tests of the contrasts, and of no others, over all and in each quarter by value.

    Columns: ``column``, what is compared; ``quarter, planner, other, pairs``; ``difference``, the
    mean of the planner less the other; ``p`` of a paired permutation test, exact for collisions and
    for few pairs; ``p_holm``, adjusted after Holm for all lines.
    """
    lines = []
    for quarter, part in _parts(by_quarter(rows)) or [(_ALL, _placed(attempts_of(rows)))]:
        planners = dict(list(part.groupby("planner", sort=False)))
        for planner, other in contrasts:
            for column in _TESTED if planner in planners and other in planners else ():
                pairs = paired_differences(planners[planner], planners[other], column)
                named = {"column": column, "quarter": quarter, "planner": planner, "other": other}
                if len(pairs):
                    lines.append(named | tested(pairs, _SIGN_CHANGES))
    names = ["column", "quarter", "planner", "other", "pairs", "difference", "p"]
    table = pd.DataFrame(lines, columns=names)
    known = table["p"].notna()
    table["p_holm"] = np.nan
    table.loc[known, "p_holm"] = holm(table.loc[known, "p"].to_numpy(float))
    return table


def _parts(rows: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """All rows, and those of each quarter."""
    quarters = [(str(number), part) for number, part in rows.groupby("quarter")]
    return [(_ALL, rows), *quarters] if len(rows) else []
