"""The leaderboard: one row per scenario, view and estimator, over all attempts.

A failure has no error, so it ranks worse than any: quantiles are taken over all attempts with
failures at infinity, and a median of ``inf`` says that more than half of the attempts failed.
"""

import numpy as np
import pandas as pd

#: Noise levels up to which errors are compared with the statistical limit, which is a
#: small-noise expansion.
LIMIT_SIGMAS = (0.0, 0.01)


def leaderboard(trials: pd.DataFrame) -> pd.DataFrame:
    """Summarise trials.

    Args:
        trials: rows as in ``trials.parquet``.

    Returns:
        One row per (scenario, view, estimator): ``trials``, ``failures`` and
        ``published_failures`` (rows counted with their ``count``; skipped ones apart), median
        and quartiles of the errors, ``coverage`` (share of 95% ellipsoids that hold the truth,
        among estimates with a covariance), ``limit_ratio`` (mean cosine error over its statistical
        limit for small noise) and the median time. The best median position error comes first
        within a scenario and view.
    """
    groups = trials.groupby(["scenario", "view", "estimator"], sort=True)
    rows = [
        dict(zip(("scenario", "view", "estimator"), key, strict=True)) | _summary(group)
        for key, group in groups
    ]
    columns = list(rows[0]) if rows else []
    table = pd.DataFrame(rows, columns=columns)
    if table.empty:
        return table
    order = ["scenario", "view", "position_error_median", "failures", "cosine_error_median"]
    return table.sort_values([*order, "estimator"], ignore_index=True)


def _summary(group: pd.DataFrame) -> dict[str, float | int]:
    attempts = group[group["status"] != "skipped"]
    count = attempts["count"].to_numpy()
    failed = (attempts["status"] != "ok").to_numpy()
    summary: dict[str, float | int] = {
        "trials": int(count.sum()),
        "failures": int(count[failed].sum()),
        "published_failures": int(count[published_failures(attempts)].sum()),
        "skipped": int(group["count"].sum() - count.sum()),
    }
    for error in ("cosine_error", "position_error", "held_out_error"):
        values = attempts[error].to_numpy(dtype=float)
        values = np.where(np.isnan(values), np.inf, values)
        for name, share in (("median", 0.5), ("q25", 0.25), ("q75", 0.75)):
            summary[f"{error}_{name}"] = _quantile(values, count, share)
    told = attempts["covered"].notna()
    summary["coverage"] = float(
        np.average(attempts["covered"][told].astype(float), weights=count[told])
        if told.any()
        else np.nan
    )
    summary["limit_ratio"] = _limit_ratio(attempts)
    summary["solve_seconds_median"] = float(attempts["solve_seconds"].median())
    return summary


def published_failures(attempts: pd.DataFrame) -> np.ndarray:
    """Which rows the published study would count as failed.

    Either the estimator fails, or the study's one solve for the forward game does not converge,
    be there a root or not.
    """
    failed = attempts["status"].ne("ok") | attempts["published_forward"].eq(0)
    return failed.to_numpy(bool)


def _quantile(values: np.ndarray, count: np.ndarray, share: float) -> float:
    """Interpolated quantile of values repeated ``count`` times; infinite values rank last."""
    if not len(values):
        return float("nan")
    ordered = np.sort(np.repeat(values, count))
    position = share * (len(ordered) - 1)
    low, high = ordered[int(np.floor(position))], ordered[int(np.ceil(position))]
    # inf - inf is undefined, so no interpolation between equal values.
    return float(low if low == high else low + (high - low) * (position % 1))


def _limit_ratio(attempts: pd.DataFrame) -> float:
    small = attempts[attempts["sigma"].between(*LIMIT_SIGMAS, inclusive="right")]
    ratio = small["cosine_error"] / small["cosine_limit"]
    return float(np.average(ratio, weights=small["count"])) if len(ratio) else float("nan")
