"""The leaderboard: one row per scenario, view and estimator, over all attempts.

A failure has no error, so it ranks worse than any: quantiles are taken over all attempts with
failures at infinity, and a median of ``inf`` says that more than half of the attempts failed.
"""

import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.attempts import (
    WORST,
    attempts_of,
    errors_of,
    lacks_held_out,
    quantile,
)
from olne_bench.bench.report.statistics.estimator_comparison import ranks
from olne_bench.bench.report.statistics.intervals import mean_by_seed

#: Noise up to which errors are compared with the statistical limit, which is a small-noise
#: expansion. Where a study has none so small, the least that it has is taken.
LIMIT_SIGMA = 0.01

_KEY = ["scenario", "view", "estimator"]


def leaderboard(trials: pd.DataFrame, comparisons: pd.DataFrame | None = None) -> pd.DataFrame:
    """Summarise trials.

    Args:
        trials: rows as in ``trials.parquet``; ``identifiable_cosine_error`` may be among them, of
            which only rows that have one count.
        comparisons: from ``bench.report.statistics.estimator_comparison``, for ranks.

    Returns:
        One row per (scenario, view, estimator): ``trials``, ``failures`` and
        ``published_failures`` (rows counted with their ``count``; skipped ones apart), of each
        error the median, quartiles and mean with its 95 % interval over seeds, ``coverage``
        (share of 95 % ellipsoids that hold the truth, among the ``coverage_trials`` estimates with
        one), ``limit_ratio`` (mean cosine error over its statistical limit for small noise), the
        median time, infinite for attempts that never came to an end, and ranks with ties. In means,
        a failure has the largest error there is: 1 for angles, infinity for positions. The best
        median position error comes first within a scenario and view.
    """
    if "held_out_error" in trials:
        lacks = lacks_held_out(trials)
        trials = (
            trials.assign(lacks_held_out=lacks)
            if trials["held_out_error"].notna().any()
            else trials.drop(columns="held_out_error")  # not measured, which is nobody's failure
        )
    groups = trials.groupby(_KEY, sort=True)
    rows = [dict(zip(_KEY, key, strict=True)) | _summary(group) for key, group in groups]
    columns = list(rows[0]) if rows else []
    table = pd.DataFrame(rows, columns=columns)
    if table.empty:
        return table
    if comparisons is not None:
        for error in ("position_error", "cosine_error"):
            table[f"{error}_rank"] = ranks(comparisons, table, error)
    order = ["scenario", "view", "position_error_median", "failures", "cosine_error_median"]
    return table.sort_values([*order, "estimator"], ignore_index=True)


def _summary(group: pd.DataFrame) -> dict[str, float | int]:
    attempts = attempts_of(group)
    count, seeds = attempts["count"].to_numpy(), attempts["seed"].to_numpy()
    failed = (attempts["status"] != "ok").to_numpy()
    summary: dict[str, float | int] = {
        "trials": int(count.sum()),
        "failures": int(count[failed].sum()),
        "published_failures": int(count[published_failures(attempts)].sum()),
        "skipped": int(group["count"].sum() - count.sum()),
    }
    for error, worst in WORST.items():
        if error not in attempts:
            continue
        known = np.full(len(attempts), True)
        if error == "identifiable_cosine_error":
            values = attempts[error].to_numpy(float)
            known = ~np.isnan(values)
        else:
            values = errors_of(attempts, error)
        if error == "held_out_error":
            known = ~attempts["lacks_held_out"].to_numpy(bool)
        for name, share in (("median", 0.5), ("q25", 0.25), ("q75", 0.75)):
            summary[f"{error}_{name}"] = quantile(values[known], count[known], share)
        mean = mean_by_seed(np.minimum(values, worst)[known], seeds[known], count[known])
        summary[f"{error}_mean"] = mean.estimate
        summary[f"{error}_mean_low"] = mean.low
        summary[f"{error}_mean_high"] = float(np.minimum(mean.high, worst))
    summary["coverage"], summary["coverage_trials"] = _coverage(attempts)
    summary["limit_ratio"] = _limit_ratio(attempts)
    summary["solve_seconds_median"] = quantile(_times(attempts), count, 0.5)
    return summary


def published_failures(attempts: pd.DataFrame) -> np.ndarray:
    """Which rows the published study would count as failed.

    Either the estimator fails, or the study's one solve for the forward game does not converge,
    be there a root or not.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _times(attempts: pd.DataFrame) -> np.ndarray:
    """Times [s]; infinite for attempts that were stopped or broke off, as they never got there."""
    return attempts["solve_seconds"].fillna(np.inf).to_numpy(float)


def _coverage(attempts: pd.DataFrame) -> tuple[float, int]:
    """Share of ellipsoids that hold the truth, and how many ellipsoids there are."""
    if "covered" not in attempts or not attempts["covered"].notna().any():
        return float("nan"), 0
    told = attempts[attempts["covered"].notna()]
    share = np.average(told["covered"].to_numpy(float), weights=told["count"])
    return float(share), int(told["count"].sum())


def _limit_ratio(attempts: pd.DataFrame) -> float:
    sigma = attempts["sigma"]
    most = max(LIMIT_SIGMA, sigma[sigma > 0].min())
    small = attempts[(sigma > 0) & (sigma <= most)]
    errors = np.minimum(errors_of(small, "cosine_error"), WORST["cosine_error"])
    limits = small["cosine_limit"].to_numpy(float)
    known = np.isfinite(limits) & (limits > 0)
    if not known.any():
        return float("nan")
    return float(np.average((errors[known] / limits[known]), weights=small["count"][known]))
