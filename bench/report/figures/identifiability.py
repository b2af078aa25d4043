"""What the data tell about each weight, over the noise of the trials."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullLocator, PercentFormatter

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.series import sensors_in
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.noise_identifiability import identifiability_by_noise
from olne_bench.bench.report.study import USUAL, Study

_SIZE = 3.6  # of a panel [inch]
_TICKS = 5  # at most


def draw(trials: pd.DataFrame, study: Study = USUAL) -> Figure:
    """Share of the prior variance that is left of each weight, one panel per sensor.

    A colour is a weight, and a line one player's, or an unknown parameter's. At 100 % the data tell
    nothing. In a family, the mean over some draws is drawn.

    Raises:
        NotDrawnError: if there is no noise, or no truth can be played here.
    """
    table = identifiability_by_noise(trials, study)
    if table.empty:
        raise NotDrawnError("there is no noise, or no truth that can be played here")
    sensors = sensors_in(table)
    colours = {name: f"C{k % 10}" for k, name in enumerate(dict.fromkeys(table["weight"]))}
    figure = Figure(figsize=(max(2, len(sensors)) * _SIZE, _SIZE))
    panels = figure.subplots(1, len(sensors), sharex=True, sharey=True, squeeze=False)[0]
    for axes, sensor in zip(panels, sensors, strict=True):
        own = table[table["sensor"] == sensor]
        for (_, name), rows in own.groupby(["player", "weight"], sort=False):
            axes.plot(
                rows["sigma"],
                rows["left"],
                color=colours[name],
                marker="o",
                markersize=3,
                linewidth=1.1,
                alpha=0.85,
            )
        _abscissa(axes, sorted(own["sigma"].unique()))
        axes.set_title(style.printable(sensor))
    panels[0].yaxis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))
    panels[0].set(ylim=(-0.02, 1.02), ylabel="Left of the prior variance")
    draws = int(table["draws"].max())
    of = f", mean of {draws} draws" if draws > 1 else ""
    figure.suptitle(f"{trials['scenario'].iloc[0]}: what noise leaves unknown of each weight{of}")
    entries = [
        (Line2D([], [], color=colour, marker="o", markersize=3), style.printable(name))
        for name, colour in colours.items()
    ]
    style.legend_below(figure, entries)
    return figure


def _abscissa(axes: Axes, levels: list[float]) -> None:
    step = -(-len(levels) // _TICKS)
    axes.set_xscale("log")
    axes.set_xticks(levels[::-step])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.set_xlabel("Noise σ [m]")
