"""What a wrong model costs, and what a user can notice of it (``envs.changes``)."""

import json

import pandas as pd

from olne_bench.bench.report.study import Study

#: What a row is compared at: the same draws in the true world.
_SAME = ["world", "sensor", "estimator"]
_ABOUT = ["of", "change", "kind", "dial", "sensor", "estimator", "trials", "failures"]
_MEDIAN = "_median"
#: Medians that are no errors.
_NOT_ERRORS = ("solve_seconds", "region_width")


def damage_table(board: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Rows of a leaderboard of changed worlds, over those of the same draws in the true world.

    A true world is one whose dial is 0, or the scenario itself. Columns: ``of`` (name of the
    scenario), ``change``, its ``kind`` and ``dial``; ``sensor, estimator, trials, failures``; of
    each error the ratio of its median to that in the true world, as ``<error>_ratio``; shares of
    regions that hold the truth, and those of the true world, ``<share>_true``; ``noticed`` (share
    of the trials whose fit test refutes the model) and ``false_alarms`` (the same where the model
    is true). Without a true world there is no row.
    """
    told = worlds(study)
    if board.empty or told["change"].eq("").all():
        return pd.DataFrame(columns=_ABOUT)
    rows = board.merge(told, on="scenario")
    changed, true = rows[rows["change"] != ""], rows[rows["change"] == ""]
    both = changed.merge(true.drop_duplicates(_SAME), on=_SAME, suffixes=("", "_true"))
    found = both[_ABOUT].copy()
    for column in map(str, board):
        name = column.removesuffix(_MEDIAN)
        if column.endswith(_MEDIAN) and name not in _NOT_ERRORS:
            found[f"{name}_ratio"] = both[column] / both[f"{column}_true"]
        elif column.endswith("_share"):
            found[column], found[f"{name}_true"] = both[column], both[f"{column}_true"]
    found["noticed"], found["false_alarms"] = both["refuted"], both["refuted_true"]
    return found.sort_values(_ABOUT[:6], ignore_index=True)


def worlds(study: Study) -> pd.DataFrame:
    """Of each ``scenario``, by label: what is changed, and how; a true world has no ``change``."""
    rows = []
    for label, entry in study.scenarios.items():
        of, options, change, kind, dial = entry.name, dict(entry.options), "", "", 0.0
        if entry.name == "changed":
            from olne_bench.envs.changes import CHANGES  # takes a second
            from olne_bench.envs.scenarios.changed import Changed

            world = Changed(**entry.options)
            of, options = world.of, dict(world.options)
            if world.dial:
                change, dial = world.change, float(world.dial)
                kind = CHANGES[change].__module__.rpartition(".")[2].replace("_", " ")
        same = json.dumps([of, options, entry.sigmas], sort_keys=True)
        rows.append((label, same, of, change, kind, dial))
    return pd.DataFrame(rows, columns=["scenario", "world", "of", "change", "kind", "dial"])
