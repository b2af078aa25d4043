"""Tables of online studies."""

import numpy as np
import pandas as pd

from olne_bench.bench.judge.online import ERROR_COLUMNS
from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.report.statistics.attempts import attempts_of

#: What a line of the tables is about.
GROUP = ["scenario", "sensor", "sigma", "estimator"]
_MOTION = [*GROUP, "seed"]


def summary_table(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each scenario, sensor, noise level and estimator.

    Columns: motions; updates; ``failed`` and ``late``, shares of updates; ``latency_50``, ``_95``
    and ``_99`` [ms], percentiles; ``half_time`` [s], the median time until the cosine error is half
    of that of uniform weights, missing where most motions do not get there; medians over updates of
    the cosine error and of the errors of predictions [m].

    Args:
        rows: rows of updates, as ``run.online`` makes them.
    """
    judged = attempts_of(rows)
    lines = []
    for key, part in judged.groupby(GROUP, sort=False):
        latency = part["latency"].dropna() * 1e3
        line = dict(zip(GROUP, key, strict=True)) | {
            "motions": part["seed"].nunique(),
            "updates": len(part),
            "failed": part["status"].isin(FAILURES).mean(),
            "late": part["late"].astype(bool).mean(),
        }
        for level in (50, 95, 99):
            line[f"latency_{level}"] = np.percentile(latency, level) if len(latency) else np.nan
        line["half_time"] = _half_time(part)
        line |= {name: part[name].median() for name in ("cosine_error", *ERROR_COLUMNS)}
        lines.append(line)
    return pd.DataFrame(lines)


def over_time_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Medians of the errors at each time since the start, by scenario, noise and estimator."""
    judged = attempts_of(rows)
    columns = ["cosine_error", *ERROR_COLUMNS]
    return judged.groupby([*GROUP, "time"], sort=False)[columns].median().reset_index()


def _half_time(part: pd.DataFrame) -> float:
    """The median over motions of the time until the prior's error is halved, or NaN."""
    halved = part[part["cosine_error"] <= part["prior_error"] / 2]
    first = halved.groupby(_MOTION)["time"].min()
    times = np.full(part["seed"].nunique(), np.inf)
    times[: len(first)] = first
    median = float(np.median(times))
    return median if np.isfinite(median) else float("nan")
