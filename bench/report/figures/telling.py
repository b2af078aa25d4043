"""Choose the trial that a picture shows: one in which methods differ visibly."""

import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.attempts import FLOOR

#: A difference below this share of the largest one is not visible in the same picture.
_VISIBLE = 0.1


def telling_trial(trials: pd.DataFrame) -> tuple[float, int]:
    """Noise level and seed at which the position errors of methods differ most.

    Args:
        trials: attempts of one scenario.

    Returns:
        Among visible differences, one at which as many methods as possible have a prediction. If
        nothing differs, the largest noise level and the first seed.
    """
    return _best(trials, ["sigma", "seed"])


def telling_level(trials: pd.DataFrame) -> float:
    """The noise level at which the median position errors of methods differ most, as above."""
    return _best(trials, ["sigma"])[0]


def _best(trials: pd.DataFrame, place: list[str]) -> tuple[float, int]:
    contenders = trials[trials["estimator"] != FLOOR]
    rows = trials if contenders.empty else contenders
    last = float(rows["sigma"].max()), int(rows["seed"].min())
    drawn = rows[(rows["status"] == "ok") & ~rows["published_forward"].eq(0)]
    if drawn.empty or "position_error" not in drawn:
        return last
    series = [*place, "estimator", "sensor"]
    errors = drawn.groupby(series)["position_error"].median().dropna().groupby(place)
    found = pd.DataFrame({"methods": errors.size(), "largest": errors.max()})
    found["difference"] = np.where(found["methods"] > 1, found["largest"] - errors.min(), 0.0)
    visible = found["difference"] >= _VISIBLE * found["difference"].max()
    telling = found[visible & (found["largest"] > 0)]
    if telling.empty:
        return last
    order = ["methods", "difference", "largest", *place]
    best = telling.reset_index().sort_values(order).iloc[-1]
    return float(best["sigma"]), int(best.get("seed", last[1]))
