"""Figures of a study, drawn from its table of trials.

One module per kind of figure. Each has ``draw(trials) -> Figure | None``, given the trials of one
scenario; None means that the trials hold nothing for it to show.
"""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from olne_bench.bench.report.figures import errors, failures, landscape, style, trajectories
from olne_bench.bench.report.figures.style import FORMATS, USUAL_FORMATS

__all__ = ["FORMATS", "USUAL_FORMATS", "draw_figures"]

_KINDS = {
    "errors": errors.draw,
    "failures": failures.draw,
    "trajectories": trajectories.draw,
    "landscape": landscape.draw,
}


def draw_figures(
    trials: pd.DataFrame, directory: Path, formats: Sequence[str] = USUAL_FORMATS
) -> list[Path]:
    """Draw every figure that the trials allow, for each scenario on its own.

    Args:
        trials: one row per trial, with the columns ``scenario, view, sigma, seed, estimator,
            status, cosine_error, position_error, observation_error, count, weights``. Any part of
            a study will do.
        directory: where ``<kind>_<scenario>.png`` and so on go; made if absent.
        formats: some of ``FORMATS``.

    Returns:
        The files written. The same trials give the same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written = []
    with style.applied():
        for scenario in sorted(trials["scenario"].unique()):
            rows = trials[trials["scenario"] == scenario]
            for kind, draw in _KINDS.items():
                figure = draw(rows)
                if figure is not None:
                    written += style.save(figure, directory / f"{kind}_{scenario}", formats)
    return written
