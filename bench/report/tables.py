"""All tables of a run, computed once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.leaderboard import ranked_rows, summaries
from olne_bench.bench.report.measures import IDENTIFIABLE
from olne_bench.bench.report.paragraphs import Paragraph, paragraphs
from olne_bench.bench.report.parts import Parts, joined, of_each, parts_of
from olne_bench.bench.report.statistics.calibration import calibration_table
from olne_bench.bench.report.statistics.estimator_comparison import adjusted, comparison_rows
from olne_bench.bench.report.statistics.harness_errors import harness_errors, most_frequent_first
from olne_bench.bench.report.statistics.identifiability import (
    bound_ratios,
    identifiability_table,
    identifiable_errors,
    unknown_truths,
)
from olne_bench.bench.report.statistics.noise_errors import errors_by_noise
from olne_bench.bench.report.statistics.noise_identifiability import identifiability_by_noise
from olne_bench.bench.report.statistics.recognition import (
    confusion_table,
    drivers,
    temperament_table,
)
from olne_bench.bench.report.statistics.standing import (
    if_told,
    ranking,
    standings,
    with_standing,
)
from olne_bench.bench.report.statistics.wins import win_counts, win_table
from olne_bench.bench.report.study import USUAL, Study


@dataclass(frozen=True)
class RunTables:
    """Tables of a run; their columns are described at the functions that make them.

    Attributes:
        leaderboard: one row per scenario, sensor and estimator.
        errors_by_noise: median errors at each noise level, with intervals.
        comparisons: comparisons of estimators, in pairs.
        wins: draws that each estimator wins against each other one.
        identifiability: identifiability of each weight in each scenario and sensor.
        identifiability_by_noise: the same at each noise level of the trials.
        bound_ratios: each estimator's error over the Cramer-Rao bound, weight by weight.
        calibration: how often regions of several levels hold the truth.
        temperaments: errors, and who is recognised, by the temperament of drivers.
        confusions: who is mistaken for whom.
        harness_errors: errors of the harness.
        paragraphs: a paragraph on each estimator.
        notes: what could not be computed, and why.
    """

    leaderboard: pd.DataFrame
    errors_by_noise: pd.DataFrame
    comparisons: pd.DataFrame
    wins: pd.DataFrame
    identifiability: pd.DataFrame
    identifiability_by_noise: pd.DataFrame
    bound_ratios: pd.DataFrame
    calibration: pd.DataFrame
    temperaments: pd.DataFrame
    confusions: pd.DataFrame
    harness_errors: pd.DataFrame
    paragraphs: tuple[Paragraph, ...] = ()
    notes: tuple[str, ...] = ()

    def by_name(self) -> dict[str, pd.DataFrame]:
        """The tables that are written to the run folder, by name."""
        usual = {
            "leaderboard": self.leaderboard,
            "errors_by_noise": self.errors_by_noise,
            "comparisons": self.comparisons,
            "wins": self.wins,
            "identifiability": self.identifiability,
            "identifiability_by_noise": self.identifiability_by_noise,
            "bound_ratios": self.bound_ratios,
            "calibration": self.calibration,
        }
        tempered = {"temperaments": self.temperaments, "confusions": self.confusions}
        return usual | {name: table for name, table in tempered.items() if len(table)}


def tabulate(trials: pd.DataFrame | Parts, study: Study = USUAL) -> RunTables:
    """Compute all tables from a run's trials, one scenario after the other."""
    parts = parts_of(trials)
    metrics = parts.outline.metrics(study.metrics)
    # Where all trials of a scenario failed, they alone cannot tell which metrics apply.
    applying = replace(study, metrics=tuple(metrics))
    found = of_each(parts, lambda _, own: _tabulated(own, applying))
    found = found or [_tabulated(parts.of(""), applying)]  # tables without rows have columns, too
    whole = {name: joined([part[name] for part in found]) for name in found[0]}
    comparisons = adjusted(_by_error(whole["comparisons"], metrics))
    wins = win_table(_by_error(whole["wins"], metrics))
    shown = [*metrics, *[IDENTIFIABLE] * (f"{IDENTIFIABLE.name}_median" in whole["leaderboard"])]
    board = if_told(ranked_rows(whole["leaderboard"], shown, comparisons))
    return RunTables(
        leaderboard=board,
        errors_by_noise=whole["errors_by_noise"],
        comparisons=comparisons,
        wins=wins,
        identifiability=whole["identifiability"],
        identifiability_by_noise=whole["identifiability_by_noise"],
        bound_ratios=whole["bound_ratios"],
        calibration=whole["calibration"],
        temperaments=whole["temperaments"],
        confusions=whole["confusions"],
        harness_errors=most_frequent_first(whole["harness_errors"]),
        paragraphs=tuple(paragraphs(board, wins, whole["errors_by_noise"], study)),
        notes=tuple(whole["notes"]["note"]),
    )


def _tabulated(trials: pd.DataFrame, study: Study) -> dict[str, pd.DataFrame]:
    """Tables of some scenarios, as far as they do not depend on others."""
    # The weights of a million trials are slow to copy, and most tables do not need them.
    plain = trials.drop(columns=["weights", "weight_levels"], errors="ignore")
    by_temperament = _driver_tables(trials, study)
    known = plain.assign(identifiable_cosine_error=identifiable_errors(trials, study))
    standing = standings(trials, study)
    contenders = ranking(plain, standing)
    return {
        "leaderboard": with_standing(summaries(known, study), standing),
        "errors_by_noise": errors_by_noise(plain, study),
        "comparisons": comparison_rows(contenders, study),
        "wins": win_counts(contenders, study),
        "identifiability": identifiability_table(trials, study),
        "identifiability_by_noise": identifiability_by_noise(plain, study),
        "bound_ratios": bound_ratios(trials, study),
        "calibration": calibration_table(trials),
        **by_temperament,
        "harness_errors": harness_errors(plain),
        "notes": pd.DataFrame({"note": unknown_truths(trials, study)}, dtype=object),
    }


def _driver_tables(trials: pd.DataFrame, study: Study) -> dict[str, pd.DataFrame]:
    """Tables of drivers, of whom there are several in each trial: not kept for longer."""
    found = drivers(trials, study)
    return {"temperaments": temperament_table(found), "confusions": confusion_table(found)}


def _by_error(table: pd.DataFrame, metrics: Sequence[MetricDeclaration]) -> pd.DataFrame:
    """Rows of several scenarios, error by error."""
    place = {metric.name: number for number, metric in enumerate(metrics)}
    order = table["error"].map(place).to_numpy(float).argsort(kind="stable")
    return table.iloc[order].reset_index(drop=True)
