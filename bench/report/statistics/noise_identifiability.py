"""What the data tell about each weight at the noise of the trials themselves.

A weight that is identified at 0.01 m need not be at 0.5 m. In a family each draw has weights of its
own, and some show where others do not, so several draws count.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from olne_bench.bench.judge.scene import NoSceneError
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.identifiability import cells
from olne_bench.bench.report.study import USUAL, Study

#: Draws of a family that count, from the first on.
MOST_DRAWS = 10
_KEY = ["scenario", "sensor", "sigma", "player", "weight"]
_COLUMNS = [*_KEY, "draws", "bound", "left", "identified"]


def identifiability_by_noise(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """One row per scenario, sensor, noise level above 0, player and weight, or unknown parameter.

    Args:
        trials: one row per trial; only their labels and ``status`` count.
        study: study of the run.

    Returns:
        Columns ``scenario, sensor, sigma`` [m], ``player`` (from 1), ``weight``, ``draws`` (number
        of truths that count: one, or in a family up to ``MOST_DRAWS``), ``bound`` (median
        Cramer-Rao bound at this noise, as a standard deviation, infinite where it does not exist),
        ``left`` (mean share of the prior variance that the data leave) and ``identified`` (share of
        the draws in which the bound is below the standard deviation without data). Draws whose
        truth is not stored do not count.
    """
    attempts = attempts_of(trials)
    rows = [
        row
        for (scenario, sensor), group in attempts.groupby(_KEY[:2], sort=True)
        for row in _rows(str(scenario), str(sensor), group, study)
    ]
    if not rows:
        return pd.DataFrame(columns=_COLUMNS)
    return (
        pd.DataFrame(rows)
        .groupby(_KEY, sort=False)
        .agg(
            draws=("left", "size"),
            bound=("bound", "median"),
            left=("left", "mean"),
            identified=("identified", "mean"),
        )
        .reset_index()
    )


def _rows(
    scenario: str, sensor: str, group: pd.DataFrame, study: Study
) -> Iterator[dict[str, object]]:
    """A row per draw, noise level and weight."""
    levels = np.unique(group["sigma"].to_numpy(float))
    seeds = np.unique(group["seed"].to_numpy(int))
    for seed in seeds[: MOST_DRAWS if study.is_family(scenario) else 1]:
        try:
            truth = study.scenes.truth(scenario, int(seed), sensor)
        except NoSceneError:
            continue
        for sigma in levels[levels > 0]:
            for (i, weight), cell in cells(truth, truth.identified_at(float(sigma))):
                place = {"scenario": scenario, "sensor": sensor, "sigma": float(sigma)}
                yield place | {"player": i + 1, "weight": weight} | cell
