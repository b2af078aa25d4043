"""All tables of a run, computed once."""

from dataclasses import dataclass

import pandas as pd

from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.statistics.calibration import calibration_table
from olne_bench.bench.report.statistics.estimator_comparison import compare_estimators
from olne_bench.bench.report.statistics.harness_errors import harness_errors
from olne_bench.bench.report.statistics.identifiability import (
    bound_ratios,
    identifiability_table,
    identifiable_errors,
    unknown_truths,
)
from olne_bench.bench.report.statistics.noise_identifiability import identifiability_by_noise
from olne_bench.bench.report.statistics.recognition import (
    confusion_table,
    drivers,
    temperament_table,
)
from olne_bench.bench.report.study import USUAL, Study


@dataclass(frozen=True)
class RunTables:
    """Tables of a run; their columns are described at the functions that make them.

    Attributes:
        leaderboard: one row per scenario, sensor and estimator.
        comparisons: comparisons of estimators, in pairs.
        identifiability: identifiability of each weight in each scenario and sensor.
        identifiability_by_noise: the same at each noise level of the trials.
        bound_ratios: each estimator's error over the Cramer-Rao bound, weight by weight.
        calibration: how often regions of several levels hold the truth.
        temperaments: errors, and who is recognised, by the temperament of drivers.
        confusions: who is mistaken for whom.
        harness_errors: errors of the harness.
        notes: what could not be computed, and why.
    """

    leaderboard: pd.DataFrame
    comparisons: pd.DataFrame
    identifiability: pd.DataFrame
    identifiability_by_noise: pd.DataFrame
    bound_ratios: pd.DataFrame
    calibration: pd.DataFrame
    temperaments: pd.DataFrame
    confusions: pd.DataFrame
    harness_errors: pd.DataFrame
    notes: tuple[str, ...] = ()

    def by_name(self) -> dict[str, pd.DataFrame]:
        """The tables that are written to the run folder, by name."""
        usual = {
            "leaderboard": self.leaderboard,
            "comparisons": self.comparisons,
            "identifiability": self.identifiability,
            "identifiability_by_noise": self.identifiability_by_noise,
            "bound_ratios": self.bound_ratios,
            "calibration": self.calibration,
        }
        tempered = {"temperaments": self.temperaments, "confusions": self.confusions}
        return usual | {name: table for name, table in tempered.items() if len(table)}


def tabulate(trials: pd.DataFrame, study: Study = USUAL) -> RunTables:
    """Compute all tables from a run's trials."""
    # The weights of a million trials are slow to copy, and most tables do not need them.
    plain = trials.drop(columns=["weights", "weight_levels"], errors="ignore")
    comparisons = compare_estimators(plain, study)
    seen = drivers(trials, study)
    known = plain.assign(identifiable_cosine_error=identifiable_errors(trials, study))
    return RunTables(
        leaderboard=leaderboard(known, comparisons, study),
        comparisons=comparisons,
        identifiability=identifiability_table(trials, study),
        identifiability_by_noise=identifiability_by_noise(plain, study),
        bound_ratios=bound_ratios(trials, study),
        calibration=calibration_table(trials),
        temperaments=temperament_table(seen),
        confusions=confusion_table(seen),
        harness_errors=harness_errors(plain),
        notes=tuple(unknown_truths(trials, study)),
    )
