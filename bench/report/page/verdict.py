"""The verdict of a run in one sentence, from its scores."""

import pandas as pd

from olne_bench.bench.report.statistics.score import (
    ALL,
    FEWEST_DRAWS,
    best_group,
    board_rows,
)
from olne_bench.bench.report.study import USUAL, Study

_NOTHING = "No estimator has a score: that takes noise, and an estimator that ranks."


def verdict(scores: pd.DataFrame, comparisons: pd.DataFrame, study: Study = USUAL) -> str:
    """Which estimator has the smallest errors, by how much, and who cannot be told from it.

    Args:
        scores: from ``statistics.score.score_table``.
        comparisons: from ``statistics.score.pair_table`` of the same trials.
        study: study of the run.
    """
    boards = board_rows(scores, study)
    error, board = next(iter(boards.items()), ("", pd.DataFrame()))
    ranked = board[board["ranked"].astype(bool)] if len(board) else board
    ranked = ranked[~ranked["estimator"].map(study.is_floor).astype(bool)] if len(board) else board
    if ranked.empty:
        return _NOTHING
    best, *others = ranked.to_dict("records")
    label = next((m.label for m in study.metrics if m.name == error), error)
    number = best["scenarios"]
    where = f"{best['trials']} trials with noise" + f" of {number} scenarios" * (number > 1)
    if not others:
        return f"{best['estimator']} is the only estimator that ranks, on {where}."
    names = [str(row["estimator"]) for row in (best, *others)]
    pairs = comparisons[(comparisons["error"] == error) & (comparisons["scenario"] == ALL)]
    _, *ties = best_group(pairs, names)
    said = f"On {where}, {names[0]} has the smallest {label}s"
    if best["estimator"] == best["reference"]:
        said += f"; those of {names[1]} are {_change(others[0]['score'])}"
    else:
        said += f": {_change(best['score'])} than those of {best['reference']}{_interval(best)}"
    if best["draws"] < FEWEST_DRAWS:
        said += f"; {best['draws']} draws are too few to tell estimators apart"
    elif ties:
        said += f"; {_joined(ties)} cannot be told apart from it"
    floors = board[board["estimator"].map(study.is_floor).astype(bool)]
    better = floors[floors["score"] < best["score"]]
    if len(better):
        said += f"; {better['estimator'].iloc[0]}, which ignores the data, has smaller ones"
    return f"{said}."


def _change(ratio: float) -> str:
    return (
        f"{100 * (1 - ratio):.0f} % smaller" if ratio <= 1 else f"{100 * (ratio - 1):.0f} % larger"
    )


def _interval(row: dict) -> str:
    if pd.isna(row["score_low"]):
        return ""
    ends = [100 * (1 - row[name]) for name in ("score_high", "score_low")]
    return f" (95 % interval {ends[0]:.0f} to {ends[1]:.0f} %)"


def _joined(parts: list[str]) -> str:
    *others, last = parts
    return f"{', '.join(others)} and {last}" if others else last
