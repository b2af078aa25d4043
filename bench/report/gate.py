"""Acceptance: a run against the limits of its suite."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from olne_bench.bench.plan.limits import GateLimits
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.statistics.attempts import is_family_label
from olne_bench.bench.run.provenance import Provenance
from olne_bench.errors import UserError

_KEY = ["estimator", "scenario", "view", "sigma", "seed"]

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
class Plan:
    """What a run set out to do.

    Attributes:
        suite: the part of its suite that was asked for.
        seeds: the first so many noise draws.
    """

    suite: Suite
    seeds: int


def plan_of(run: Provenance) -> Plan:
    """What a stored run was asked to do."""
    return Plan(select(read_suite_json(run.suite), run.selection), run.seeds)


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


def check_limits(table: pd.DataFrame, gate: dict[str, GateLimits]) -> list[Check]:
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


def missing_trials(trials: pd.DataFrame, plans: Iterable[Plan]) -> list[str]:
    """What has not been done of what was set out to be done, in words.

    Args:
        trials: rows of a run.
        plans: of all that wrote to it; what they share counts once.
    """
    planned = {key for plan in plans for key in _keys(plan)}
    done = set(trials[_KEY].itertuples(index=False, name=None))
    whole = Counter(key[:3] for key in planned)
    missing = Counter(key[:3] for key in planned - done)
    return [
        f"{', '.join(place)}: {whole[place] - number} of {whole[place]} trials are done"
        for place, number in sorted(missing.items())
    ]


def _keys(plan: Plan) -> Iterator[tuple[str, str, str, float, int]]:
    """The trials of a plan, as ``plan.trial.expand`` has them; unknown names are no error."""
    suite = plan.suite
    for scenario, estimator in suite.pairs():
        seeds = range(min(plan.seeds, suite.seeds_of(scenario, estimator)))
        fixed = not is_family_label(scenario.label)
        for view, sigma in product(suite.views, suite.sigmas_of(scenario)):
            for seed in seeds[:1] if fixed and sigma == 0 else seeds:
                yield estimator.label, scenario.label, view, sigma, seed


def _checks(table: pd.DataFrame, estimator: str, limits: GateLimits) -> Iterator[Check]:
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
    # More than half of the reference's attempts without an end are no measure of anything.
    return float(found.iloc[0]) if len(found) and np.isfinite(found.iloc[0]) else float("nan")


def _require(what: str, names: list[str] | tuple[str, ...], known: pd.Series) -> None:
    for name in names:
        if name not in set(known):
            choice = ", ".join(sorted(set(known)))
            raise UserError(
                f"the gate names {what} {name!r}, of which the run has none; it has: {choice}"
            )
