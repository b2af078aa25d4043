"""Who is recognised, and who is mistaken for whom: temperaments of drivers."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.recognition import NOBODY
from olne_bench.envs.roads.temperaments import TEMPERAMENTS

_SIZE = 2.6, 2.4  # of a panel [inch]
_DARK = 0.55  # shares above it have white numbers


def draw(table: pd.DataFrame) -> Figure:
    """Shares of drivers by true and recognised temperament, a panel per estimator.

    All noise levels and sensors count together, and six estimators at most. Each row of a panel
    sums to 100 %. The last column are drivers for whom there is no estimate. The table has the rows
    of ``confusion_table`` of one scenario, at least one.
    """
    names = [*TEMPERAMENTS, NOBODY]
    estimators = style.estimator_order(table["estimator"].tolist())
    if len(estimators) > style.MOST_PANELS:
        estimators = [name for name in estimators if name != FLOOR]
    figure, axes = style.grid(estimators, _SIZE)
    for panel, estimator in zip(axes, estimators, strict=False):
        own = table[table["estimator"] == estimator]
        wide = own.pivot_table("drivers", "temperament", "recognised", aggfunc="sum")
        wide = wide.reindex(index=list(TEMPERAMENTS), columns=names)
        shares_panel(panel, wide.div(wide.sum(axis=1), axis=0).fillna(0.0).to_numpy(float))
        panel.set_xticks(range(len(names)), names, rotation=60)
        panel.set_yticks(range(len(TEMPERAMENTS)), list(TEMPERAMENTS))
    style.entitle(figure, f"{table['scenario'].iloc[0]}: share of the drivers of each row [%]")
    figure.supylabel("True temperament", fontsize=9)
    figure.supxlabel("Recognised temperament", fontsize=9)
    return figure


def shares_panel(axes: Axes, shares: np.ndarray) -> None:
    """Show shares (R, C) from 0 to 1 as numbers in per cent on blue."""
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    axes.grid(visible=False)
    for (i, j), share in np.ndenumerate(shares):
        if share > 0:
            colour = "white" if share > _DARK else "black"
            axes.text(j, i, f"{100 * share:.0f}", ha="center", va="center", color=colour, size=7)
