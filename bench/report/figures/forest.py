"""The board's picture: the score of each estimator, with its interval."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.statistics.score import ALL, board_rows
from olne_bench.bench.report.study import USUAL, Study

_PANEL, _NAMES, _ROW, _MARGIN = 2.5, 1.8, 0.28, 1.2  # [inch]
_MOST = 4  # panels


def draw(scores: pd.DataFrame, study: Study = USUAL) -> Figure:
    """A row for each estimator, the best first and floors last, and a panel for each error.

    Where all true weights are fixed, a guess may be right by chance, and there are no floors.
    """
    boards = board_rows(scores, study)
    fixed = all(map(study.is_published, set(scores["scenario"]) - {ALL}))
    if fixed:
        kept = {error: board[~board["floor"]] for error, board in boards.items()}
        boards = {error: board for error, board in kept.items() if len(board)}
    if not boards:
        raise NotDrawnError("no estimator has a score")
    first = next(iter(boards.values()))
    names = [*first["estimator"]]
    errors = list(boards)[:_MOST]
    figure = Figure(figsize=(_NAMES + _PANEL * len(errors), _MARGIN + _ROW * len(names)))
    axes = figure.subplots(1, len(errors), squeeze=False, sharey=True)[0]
    labels = {metric.name: metric.label for metric in study.metrics}
    for panel, error in zip(axes, errors, strict=True):
        _panel(panel, boards[error], names)
        panel.set_title(labels.get(error, error))
    shown = [f"{style.printable(n)}{' *' * study.knows_prior(n)}" for n in names]
    axes[0].set_yticks(range(len(names)), shown)
    axes[0].set_ylim(len(names) - 0.5, -0.5)
    number = int(first["scenarios"].iloc[0])
    where = f"{number} scenarios" if number > 1 else str(scores["scenario"].iloc[-1])
    note = "geometric mean, 95 % bootstrap interval; hollow: unranked"
    if any(map(study.knows_prior, names)):
        note += "; *: knows how truths are drawn"
    note += "; no guesses, as true weights are fixed" * fixed
    head = f"{where}: errors relative to {first['reference'].iloc[0]}, with noise"
    style.entitle(figure, head, note)
    return figure


def _panel(axes: Axes, board: pd.DataFrame, names: list[str]) -> None:
    axes.set_xscale("log")
    axes.axvline(1, color="black", linewidth=0.8, zorder=1)
    for row in board.to_dict("records"):
        if row["estimator"] not in names:
            continue
        place = names.index(row["estimator"])
        colour = style.estimator_colours(row["estimator"])[0]
        axes.plot([row["score_low"], row["score_high"]], [place] * 2, color=colour)
        face = colour if row["ranked"] else "white"
        axes.plot(row["score"], place, "o", color=colour, markerfacecolor=face, markersize=5)
    low, high = np.log10(axes.get_xlim())
    steps = (1, 2, 5) if high - low < 2.5 else (1,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(style.plain)
