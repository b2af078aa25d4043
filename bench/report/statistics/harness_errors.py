"""Errors of the harness, which are not attempts of estimators and are counted separately."""

import pandas as pd

_GROUP = ["scenario", "sensor", "estimator", "message"]


def harness_errors(trials: pd.DataFrame) -> pd.DataFrame:
    """Columns ``scenario, sensor, estimator, message, trials``, the most frequent error first."""
    spoilt = trials[trials["status"] == "harness_error"]
    if spoilt.empty:
        return pd.DataFrame(columns=[*_GROUP, "trials"])
    counted = spoilt.fillna({"message": ""}).groupby(_GROUP).size().rename("trials").reset_index()
    return most_frequent_first(counted)


def most_frequent_first(table: pd.DataFrame) -> pd.DataFrame:
    """``harness_errors`` in their order, such as those of several scenarios."""
    order = ["trials", *_GROUP]
    return table.sort_values(order, ascending=[False, *[True] * 4], ignore_index=True)


def in_words(table: pd.DataFrame, most: int = 5) -> list[str]:
    """The first rows of ``harness_errors`` as lines, and the number of further trials."""
    lines = [
        f"{row.trials} x {row.estimator} on {row.scenario}, {row.sensor}: {row.message}"
        for row in table.head(most).itertuples(index=False)
    ]
    rest = int(table["trials"][most:].sum())
    return [*lines, f"and {rest} more"] if rest else lines
