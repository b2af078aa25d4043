"""What the data tell about each weight, over the noise of the trials."""

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.report.figures import panels, style
from olne_bench.bench.report.not_drawn import NotDrawnError

_SIZE = 3.4, 2.9  # of a panel [inch]


def draw(table: pd.DataFrame) -> Figure:
    """Share of the prior variance that is left of each weight, one panel per sensor.

    A colour is a weight, and a line one player's, or an unknown parameter's. At 100 % the data tell
    nothing. In a family, the mean over some draws is drawn.

    Args:
        table: rows of ``statistics.identifiability.identifiability_by_noise`` of one scenario.

    Raises:
        NotDrawnError: if there are none.
    """
    if table.empty:
        raise NotDrawnError("there is no noise, or no truth that can be played here")
    sensors = style.sensor_order(table["sensor"].tolist())
    colours = {name: f"C{k % 10}" for k, name in enumerate(dict.fromkeys(table["weight"]))}
    levels = sorted(table["sigma"].unique())
    figure, axes = panels.grid(sensors, _SIZE)
    for panel, sensor in zip(axes, sensors, strict=False):
        panel.set(ylim=(-0.02, 1.02), ylabel="Left of the prior variance")
        panels.levels_axis(panel, levels)
        panels.percent(panel.yaxis)
        own = table[table["sensor"] == sensor].sort_values("sigma")
        for (_, name), rows in own.groupby(["player", "weight"], sort=False):
            x = [levels.index(sigma) for sigma in rows["sigma"]]
            panel.plot(x, rows["left"], "o-", color=colours[name], markersize=3, linewidth=1.1)
    draws = int(table["draws"].max())
    of = f", mean of {draws} draws" if draws > 1 else ""
    figure.suptitle(f"{table['scenario'].iloc[0]}: what noise leaves unknown of each weight{of}")
    keys = {name: Line2D([], [], color=colour, marker="o") for name, colour in colours.items()}
    style.legend_below(figure, [(key, style.printable(name)) for name, key in keys.items()])
    return figure
