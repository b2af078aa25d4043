"""Shares of draws won by each estimator against each other one, with intervals."""

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE
from olne_bench.bench.report.statistics.wins import ALL
from olne_bench.bench.report.study import USUAL, Study

_ROW, _MARGIN = 0.21, 0.95  # [inch] of a pair, and for title and axis
_PANEL, _NAMES = 2.9, 2.4  # [inch] of a panel, and for the names
_SCENARIO = "#9A9A9A"


def draw(table: pd.DataFrame, study: Study = USUAL) -> Figure:
    """A row for each pair of estimators and a panel for each error.

    A pair is turned so that the first has won more draws, over all scenarios and by the first
    error. Pairs follow the shares of draws that the first, then the second, wins in the mean.

    Args:
        table: from ``statistics.wins.win_table``.
        study: study of the run, for the names of errors.

    Raises:
        NotDrawnError: if there are no two estimators to compare.
    """
    if table.empty:
        raise NotDrawnError("it takes two estimators to compare")
    both = _both_ways(table)
    errors = list(dict.fromkeys(table["error"]))
    pairs = _pairs(_whole(both[both["error"] == errors[0]]))
    figure = Figure(figsize=(_NAMES + _PANEL * len(errors), _MARGIN + _ROW * len(pairs)))
    panels = figure.subplots(1, len(errors), squeeze=False, sharey=True)[0]
    for axes, error in zip(panels, errors, strict=True):
        _panel(axes, both[both["error"] == error], pairs)
        axes.set_title(next((m.label for m in study.metrics if m.name == error), error))
    names = [f"{style.printable(a)} over {style.printable(b)}" for a, b in pairs]
    panels[0].set_yticks(range(len(pairs)), names)
    panels[0].set_ylim(len(pairs) - 0.4, -0.6)
    number = table["scenario"].nunique() - (ALL in set(table["scenario"]))
    where = f"{number} scenarios" if number > 1 else str(table["scenario"].iloc[0])
    figure.suptitle(f"{where}: share of draws that the first of two estimators wins")
    style.legend_below(figure, _entries(number))
    return figure


def _both_ways(table: pd.DataFrame) -> pd.DataFrame:
    """The table with each pair both ways round."""
    turned = table.rename(columns={"estimator": "other", "other": "estimator"})
    mirrored = {"wins": "wins", "wins_low": "wins_high", "wins_high": "wins_low"}
    turned = turned.assign(**{name: 1 - table[source] for name, source in mirrored.items()})
    return pd.concat([table, turned], ignore_index=True)


def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows over all scenarios; of the only one, where there are no others."""
    return rows[rows["scenario"] == ALL] if (rows["scenario"] == ALL).any() else rows


def _pairs(whole: pd.DataFrame) -> list[tuple[str, str]]:
    """Pairs of estimators, the one that wins more first, in the order of their mean shares."""
    mean = whole.groupby("estimator")["wins"].mean().sort_values(ascending=False, kind="stable")
    place = {name: number for number, name in enumerate(mean.index)}
    first = whole["wins"] > 0.5
    first |= (whole["wins"] == 0.5) & (whole["estimator"].map(place) < whole["other"].map(place))
    found = whole.loc[first, ["estimator", "other"]].itertuples(index=False, name=None)
    return sorted(found, key=lambda pair: (place[pair[0]], place[pair[1]]))


def _panel(axes: Axes, rows: pd.DataFrame, pairs: list[tuple[str, str]]) -> None:
    """Intervals over all scenarios, and dots of the single ones."""
    row = {pair: number for number, pair in enumerate(pairs)}
    places = [row.get(p, -1) for p in zip(rows["estimator"], rows["other"], strict=True)]
    rows = rows.assign(row=places)
    rows = rows[rows["row"] >= 0]
    whole = _whole(rows)
    single = rows.drop(whole.index)
    axes.plot(100 * single["wins"], single["row"], "|", color=_SCENARIO, markersize=6, zorder=4)
    axes.axvline(50, color="black", linewidth=0.8, zorder=1)
    for told in whole.to_dict("records"):
        colour = style.estimator_colours(told["estimator"])[0]
        axes.plot(
            [100 * told["wins_low"], 100 * told["wins_high"]], [told["row"]] * 2, color=colour
        )
        face = colour if told["p_holm"] < SIGNIFICANCE else "white"
        dot = axes.plot(100 * told["wins"], told["row"], "o", color=colour, markersize=5, zorder=5)
        dot[0].set_markerfacecolor(face)
    axes.set(xlim=(-3, 103), xlabel="draws won [%]", xticks=np.arange(0, 101, 25))


def _entries(number: int) -> list[tuple[Artist, str]]:
    def dot(face: str) -> Line2D:
        return Line2D([], [], color="black", marker="o", markerfacecolor=face, markersize=5)

    entries: list[tuple[Artist, str]] = [
        (dot("black"), "significant (Holm), 95 % interval"),
        (dot("white"), "not significant"),
    ]
    mark = Line2D([], [], color=_SCENARIO, marker="|", linestyle="none", markersize=6)
    return [*entries, (mark, "one scenario")] if number > 1 else entries
