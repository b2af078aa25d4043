"""Errors of the estimates over the noise: the paper's main figure.

A study with many noise levels and trials gets rolling medians over the observation error, as in the
paper. A smaller study gets its trials, medians and quartiles level by level.
"""

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.curves import draw_curves
from olne_bench.bench.report.figures.level_panels import draw_level_panels
from olne_bench.bench.report.figures.levels import has_curve
from olne_bench.bench.report.figures.series import split
from olne_bench.bench.report.measures import in_table
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.study import USUAL, Study


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """A figure with a panel for each metric that has values in the trials of one scenario.

    Raises:
        NotDrawnError: if there are no attempts or no metrics.
    """
    series = split(trials, study)
    known = [metric for metric in study.metrics if metric.drawn]
    metrics = in_table(known, pd.concat([s.trials for s in series]))
    if not metrics:
        raise NotDrawnError("no metric has a value")
    draw_panels = draw_curves if has_curve(series) else draw_level_panels
    figure, entries = draw_panels(series, metrics)
    figure.suptitle(f"{trials['scenario'].iloc[0]}: error of the estimates")
    style.legend_below(figure, entries)
    return figure
