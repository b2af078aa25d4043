"""Acceptance: a run against the limits of its suite."""

from collections.abc import Iterator
from dataclasses import dataclass

import pandas as pd

from bench.errors import UserError
from bench.suite import Limits, Suite

#: Columns of the leaderboard that limits are on; times are compared apart.
_COLUMNS = {
    "cosine_error": "cosine_error_median",
    "identifiable_cosine_error": "identifiable_cosine_error_median",
    "position_error": "position_error_median",
    "limit_ratio": "limit_ratio",
    "failures": "failures",
    "published_failures": "published_failures",
}


@dataclass(frozen=True)
class Check:
    """One limit in one scenario and view.

    Attributes:
        estimator: its label.
        scenario: label of the scenario.
        view: name of the view.
        limit: what is limited, as in ``Limits``.
        value: what the run has; not a number where it does not say.
        bound: what it may be at most.
    """

    estimator: str
    scenario: str
    view: str
    limit: str
    value: float
    bound: float

    @property
    def passed(self) -> bool:
        """Whether the limit is kept; what is not known does not keep it."""
        return self.value <= self.bound


def check_limits(table: pd.DataFrame, gate: dict[str, Limits]) -> list[Check]:
    """Check every limit.

    Args:
        table: a leaderboard.
        gate: limits by estimator label.

    Raises:
        UserError: where the run has nothing that a limit is about, so nothing passes unseen.
    """
    return [
        check for estimator, limits in gate.items() for check in _checks(table, estimator, limits)
    ]


def missing_trials(table: pd.DataFrame, suite: Suite) -> list[str]:
    """What a run has not done of what the gate is about, in words: a part may not pass for all.

    Args:
        table: a leaderboard.
        suite: the run's own.
    """
    counts = table.set_index(["estimator", "scenario", "view"])[["trials", "skipped"]].sum(axis=1)
    found = []
    for estimator in suite.estimators:
        limits = suite.gate.get(estimator.label)
        if limits is None:
            continue
        labels = [s.label for s in suite.scenarios]
        for scenario in limits.scenarios or estimator.scenarios or labels:
            for view in limits.views or suite.views:
                whole = len(suite.sigmas) * min(estimator.seeds or suite.seeds, suite.seeds)
                done = int(counts.get((estimator.label, scenario, view), 0))
                if done < whole:
                    found.append(
                        f"{estimator.label}, {scenario}, {view}: {done} of {whole} trials are done"
                    )
    return found


def _checks(table: pd.DataFrame, estimator: str, limits: Limits) -> Iterator[Check]:
    _require("estimator", [estimator], table["estimator"])
    _require("scenario", limits.scenarios, table["scenario"])
    _require("view", limits.views, table["view"])
    rows = table[table["estimator"] == estimator]
    for what, names in (("scenario", limits.scenarios), ("view", limits.views)):
        rows = rows[rows[what].isin(names)] if names else rows
    tried = rows[rows["trials"] > 0]
    if tried.empty:
        raise UserError(f"[gate.{estimator}]: the run has no trial that its limits are about")
    for row in tried.to_dict("records"):
        for limit, bound in limits.bounds.items():
            if limit == "time_ratio":
                value = row["solve_seconds_median"] / _time(table, row, limits.time_reference)
            else:
                value = row[_COLUMNS[limit]]
            yield Check(estimator, row["scenario"], row["view"], limit, float(value), bound)


def _time(table: pd.DataFrame, row: dict, reference: str) -> float:
    _require("time_reference", [reference], table["estimator"])
    same = (table["scenario"] == row["scenario"]) & (table["view"] == row["view"])
    found = table.loc[same & (table["estimator"] == reference), "solve_seconds_median"]
    return float(found.iloc[0]) if len(found) else float("nan")


def _require(what: str, names: list[str] | tuple[str, ...], known: pd.Series) -> None:
    for name in names:
        if name not in set(known):
            choice = ", ".join(sorted(set(known)))
            raise UserError(
                f"the gate names {what} {name!r}, of which the run has none; it has: {choice}"
            )
