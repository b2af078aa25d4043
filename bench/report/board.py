"""The board of a study of trials: the verdict in a sentence, and a row for each estimator."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.statistics import score
from olne_bench.bench.report.statistics.standing import listed
from olne_bench.bench.report.study import USUAL, Study, in_leaderboard, primary
from olne_bench.bench.report.tables import RunTables

_SCORED = ["ranked", "reference", "score", "score_low", "score_high"]
_SCORED += ["median", "trials", "failures"]
#: Ratios from here on are told as such, smaller ones in per cent.
_TIMES = 2.0
_HELD = "held_out_error"


def verdict(scores: pd.DataFrame, comparisons: pd.DataFrame, study: Study = USUAL) -> str:
    """Which estimator has the smallest errors, by how much, and who cannot be told from it.

    ``scores`` is a ``score_table``, and ``comparisons`` the ``pair_table`` of the same trials.
    """
    boards = score.board_rows(scores, study)
    error, table = next(iter(boards.items()), ("", pd.DataFrame()))
    rows = table.to_dict("records")
    floors = [row for row in rows if study.is_floor(row["estimator"])]
    ranked = [row for row in rows if row["ranked"] and not study.is_floor(row["estimator"])]
    if not ranked:
        return "No estimator has a score: that takes noise, and an estimator that ranks."
    best, *others = ranked
    label = next((m.label for m in study.metrics if m.name == error), error)
    number = best["scenarios"]
    where = f"{best['trials']} trials with noise" + f" of {number} scenarios" * (number > 1)
    if not others:
        return f"{best['estimator']} is the only estimator that ranks, on {where}."
    names = [str(row["estimator"]) for row in (best, *others)]
    pairs = comparisons[(comparisons["error"] == error) & (comparisons["scenario"] == score.ALL)]
    _, *ties = score.best_group(pairs, names)
    said = f"On {where}, {names[0]} has the smallest {label}s"
    if best["estimator"] == best["reference"]:
        said += f"; those of {names[1]} are {_change(others[0]['score'])}"
    else:
        said += f": {_change(best['score'])} than those of {best['reference']}{_interval(best)}"
    if best["draws"] < score.FEWEST_DRAWS:
        few = "one draw is" if best["draws"] == 1 else f"{best['draws']} draws are"
        said += f"; {few} too few to tell estimators apart"
    elif ties:
        said += f"; allowing for all pairs, {listed(ties)} cannot be told apart from it"
    better = [row["estimator"] for row in floors if row["score"] < best["score"]]
    if better:
        own = scores[(scores["error"] == error) & (scores["sensor"] == score.ALL)]
        said += f"; {_lucky(better[0], own, names[0], study)}"
    return f"{said}."


def _lucky(floor: str, scores: pd.DataFrame, best: str, study: Study) -> str:
    """Where a floor beats the best estimator, from the scores by scenario, and what that means."""
    told = scores[scores["sigma"].isna() & (scores["scenario"] != score.ALL)]
    table = told.pivot_table(index="scenario", columns="estimator", values="score")
    where = [str(name) for name in table.index[table[floor] < table[best]]]
    if where and all(map(study.is_published, where)):
        of = "the fixed true weights of " + listed(where)
        return f"{floor} ignores the data and wins where {of} are near its guess"
    return f"{floor}, which ignores the data, has smaller ones"


def _change(ratio: float) -> str:
    if ratio >= _TIMES:
        return f"{ratio:.2g} times as large"
    return f"{100 * abs(ratio - 1):.0f} % {'smaller' if ratio <= 1 else 'larger'}"


def _interval(row: Mapping[Any, Any]) -> str:
    if pd.isna(row["score_low"]):
        return ""
    ends = [100 * (1 - row[name]) for name in ("score_high", "score_low")]
    return f" (95 % interval {ends[0]:.0f} to {ends[1]:.0f} %)"


def board_table(tables: RunTables, study: Study = USUAL) -> pd.DataFrame:
    """A row for each estimator, over all scenarios, in the order of the board.

    Columns: ``estimator, score, score_low, score_high, reference``; medians of ``errors_of_board``
    over the trials of the score, or of all cells if there is none; ``failures`` of ``trials``;
    ``milliseconds``; ``ranked, floor, unranked``.
    """
    boards, table = score.board_rows(tables.scores, study), tables.leaderboard
    errors = list(errors_of_board(tables, study))
    kinds = {name: (f"{name}_median", "median") for name in errors}
    rows = table.groupby("estimator").agg(
        all_failures=("failures", "sum"),
        all_trials=("trials", "sum"),
        milliseconds=("solve_seconds_median", "median"),
        **kinds,
    )
    rows = rows.loc[style.estimator_order(table["estimator"].tolist())]
    rows["milliseconds"] *= 1e3
    scored = {name: _by_estimator(boards.get(name), rows.index) for name in errors}
    for name in errors:
        rows[name] = scored[name]["median"].fillna(rows[name])
    ranking = scored[errors[0]] if errors else _by_estimator(None, rows.index)
    rows = rows.join(ranking.drop(columns="median"))
    for name in ("failures", "trials"):
        rows[name] = rows[name].fillna(rows.pop(f"all_{name}")).astype(int)
    return score.in_order(rows.reset_index(), study)


def _by_estimator(scored: pd.DataFrame | None, names: pd.Index) -> pd.DataFrame:
    empty = pd.DataFrame(columns=["estimator", *_SCORED], dtype=float)
    known = empty if scored is None else scored
    return known.set_index("estimator")[_SCORED].reindex(names)


def errors_of_board(tables: RunTables, study: Study = USUAL) -> dict[str, str]:
    """Names and titles of the errors that the board shows: the one that ranks, and held out."""
    metrics = in_leaderboard(study.metrics, tables.leaderboard)
    first = primary(metrics)
    return {m.name: m.title for m in metrics if m == first or (first and m.name == _HELD)}


def board_note(rows: pd.DataFrame, study: Study = USUAL) -> str:
    """What the numbers of a ``board_table`` are."""
    told = rows["reference"].dropna()
    first = primary(study.metrics)
    if told.empty or first is None:
        return "Nobody has a score. Errors are medians over all trials."
    return (
        f"Score: geometric mean of {first.label} over that of {told.iloc[0]} in the same trials "
        "with noise; 0.79 is 21 % smaller. In brackets: its 95 % bootstrap interval over draws, "
        "from six draws on. A failure counts as the larger error of uniform and the reference "
        "there. Errors are medians over the same trials. Those marked 'prior' know how true "
        "weights are drawn; floors do not rank."
    )


def tag(row: Mapping[Any, Any], study: Study = USUAL) -> str:
    """What is to be known of the estimator of a row: that it is a floor, or knows the prior."""
    if row["floor"]:
        return "floor"
    tags = ["prior"] * study.knows_prior(row["estimator"])
    return ", ".join([*tags, *["unranked"] * row["unranked"]])
