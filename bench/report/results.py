"""All that a report says of a run: every table, made once."""

from dataclasses import dataclass, fields

import pandas as pd

from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.statistics.estimator_comparison import compare_estimators
from olne_bench.bench.report.statistics.identifiability import (
    bound_ratios,
    identifiability_table,
    identifiable_errors,
)


@dataclass(frozen=True)
class Findings:
    """Tables of a run; their columns are described where they are made.

    Attributes:
        leaderboard: one row per scenario, view and estimator.
        comparisons: of estimators, in pairs.
        identifiability: of each weight in each scenario and view.
        bound_ratios: each estimator's error over the Cramer-Rao bound, weight by weight.
    """

    leaderboard: pd.DataFrame
    comparisons: pd.DataFrame
    identifiability: pd.DataFrame
    bound_ratios: pd.DataFrame

    def tables(self) -> dict[str, pd.DataFrame]:
        """All of them, by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def find(trials: pd.DataFrame) -> Findings:
    """Work out all tables from a run's trials."""
    # Of a million trials the weights take longest to copy, and most tables do without.
    plain = trials.drop(columns="weights")
    comparisons = compare_estimators(plain)
    measured = plain.assign(identifiable_cosine_error=identifiable_errors(trials))
    return Findings(
        leaderboard=leaderboard(measured, comparisons),
        comparisons=comparisons,
        identifiability=identifiability_table(trials),
        bound_ratios=bound_ratios(trials),
    )
