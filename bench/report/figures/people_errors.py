"""Errors of predicted drivers, over the time ahead."""

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import style

_SHOWN = ("game", "imperfect", "own weights", "alone", "idm", "ridge", "kernel")
_PANELS = 2


def errors_over_time(table: pd.DataFrame) -> Figure:
    """Errors over those of driving straight on, on the two roads with most cars.

    ``table`` is the summary of a study of people; of both halves where both are open.
    """
    part = table[(table["kind"] == "all") & (table["half"] == table["half"].iloc[-1])]
    roads = part.groupby("road")["cars"].max().nlargest(_PANELS).index
    figure = Figure(figsize=(4 * len(roads), 3.4), layout="constrained")
    panels = figure.subplots(1, len(roads), sharey=True, squeeze=False)[0]
    methods = [method for method in _SHOWN if method in set(part["method"])]
    for axes, road in zip(panels, roads, strict=True):
        own = part[part["road"] == road]
        for k, method in enumerate(methods):
            line = own[own["method"] == method]
            middle = line["over_straight"]
            ends = [middle - line["over_straight_low"], line["over_straight_high"] - middle]
            at = line["ahead"] + 0.06 * (k - len(methods) / 2)
            axes.errorbar(at, middle, ends, label=method, marker="o", markersize=4, capsize=2)
        axes.axhline(1, color="black", linewidth=1)
        place = f"{style.printable(str(road))}: {own['cars'].max()} cars"
        axes.set(title=place, xlabel="seconds ahead")
    panels[0].set_ylabel("error along the lane / straight on")
    style.legend_below(figure, [*zip(*panels[0].get_legend_handles_labels(), strict=True)])
    return figure
