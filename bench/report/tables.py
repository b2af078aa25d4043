"""All tables of a run, computed once."""

from dataclasses import dataclass, replace

import pandas as pd

from olne_bench.bench.report.leaderboard import errors_by_noise, scored_rows, summaries
from olne_bench.bench.report.parts import Parts, joined, of_each, parts_of
from olne_bench.bench.report.statistics import attempts, identifiability, recognition
from olne_bench.bench.report.statistics.calibration import calibration_table
from olne_bench.bench.report.statistics.conformal import conformal_table, distances
from olne_bench.bench.report.statistics.damage import damage_table
from olne_bench.bench.report.statistics.score import log_errors, pair_table, score_table
from olne_bench.bench.report.statistics.standing import KEY, if_told, ranking, standings
from olne_bench.bench.report.study import IDENTIFIABLE, USUAL, Study


@dataclass(frozen=True)
class RunTables:
    """Tables of a run; their columns are described at the functions that make them."""

    leaderboard: pd.DataFrame
    scores: pd.DataFrame
    comparisons: pd.DataFrame
    errors_by_noise: pd.DataFrame
    identifiability: pd.DataFrame
    identifiability_by_noise: pd.DataFrame
    bound_ratios: pd.DataFrame
    calibration: pd.DataFrame
    temperaments: pd.DataFrame
    confusions: pd.DataFrame
    damage: pd.DataFrame
    conformal: pd.DataFrame
    harness_errors: pd.DataFrame
    failures: pd.DataFrame
    notes: tuple[str, ...] = ()  # what could not be computed, and why

    def by_name(self) -> dict[str, pd.DataFrame]:
        """The tables that are written to the run folder, by name."""
        left = {"harness_errors", "failures", "notes"}  # which terminal and page tell in words
        left |= set() if len(self.temperaments) else {"temperaments", "confusions"}
        sometimes = {"damage": self.damage, "conformal": self.conformal}
        left |= {name for name, table in sometimes.items() if table.empty}
        return {name: table for name, table in vars(self).items() if name not in left}


def tabulate(trials: pd.DataFrame | Parts, study: Study = USUAL) -> RunTables:
    """Compute all tables from a run's trials, one scenario after the other."""
    parts = parts_of(trials)
    metrics = parts.outline.metrics(study.metrics)
    # Where all trials of a scenario failed, they alone cannot tell which metrics apply.
    applying = replace(study, metrics=tuple(metrics))
    found = of_each(parts, lambda _, own: _tabulated(own, applying))
    found = found or [_tabulated(parts.of(""), applying)]  # tables without rows have columns, too
    whole = {name: joined([part[name] for part in found]) for name in found[0]}
    logs = whole.pop("logs")
    scores, notes = score_table(logs, study), tuple(whole.pop("notes")["note"])
    shown = [*metrics, *[IDENTIFIABLE] * (f"{IDENTIFIABLE.name}_median" in whole["leaderboard"])]
    whole["leaderboard"] = if_told(scored_rows(whole["leaderboard"], shown, scores, study))
    whole["damage"] = damage_table(whole["leaderboard"], study)
    whole["conformal"] = conformal_table(whole.pop("distances"), study)
    for name in ("harness_errors", "failures"):
        whole[name] = attempts.most_frequent_first(whole[name])
    return RunTables(scores=scores, comparisons=pair_table(logs, study), notes=notes, **whole)


def _tabulated(trials: pd.DataFrame, study: Study) -> dict[str, pd.DataFrame]:
    """Tables of some scenarios, as far as they do not depend on others."""
    # The weights of a million trials are slow to copy, and most tables do not need them.
    plain = trials.drop(columns=["weights", "weight_levels"], errors="ignore")
    drivers = recognition.drivers(trials, study)
    temperaments = recognition.temperament_table(drivers)
    confusions = recognition.confusion_table(drivers)
    del drivers  # several in each trial
    errors = identifiability.identifiable_errors(trials, study)
    board = summaries(plain.assign(identifiable_cosine_error=errors), study)
    standing, unknown = standings(trials, study), identifiability.unknown_truths(trials, study)
    return {
        "leaderboard": board if board.empty else board.merge(standing, on=KEY, how="left"),
        "errors_by_noise": errors_by_noise(plain, study),
        "distances": distances(plain, study),
        "logs": log_errors(ranking(plain, standing), study),
        "identifiability": identifiability.identifiability_table(trials, study),
        "identifiability_by_noise": identifiability.identifiability_by_noise(plain, study),
        "bound_ratios": identifiability.bound_ratios(trials, study),
        "calibration": calibration_table(trials),
        "temperaments": temperaments,
        "confusions": confusions,
        "harness_errors": attempts.harness_errors(plain),
        "failures": attempts.failures(plain),
        "notes": pd.DataFrame({"note": unknown}, dtype=object),
    }
