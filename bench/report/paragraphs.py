"""A paragraph on each estimator: where it wins, where it breaks, and what it costs.

Every sentence is made from the tables of a run, and says one thing with its numbers.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.escapes import markdown_text
from olne_bench.bench.report.measures import in_leaderboard, primary
from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE
from olne_bench.bench.report.statistics.standing import ranks_at
from olne_bench.bench.report.statistics.wins import ALL
from olne_bench.bench.report.study import USUAL, Study

_MOST_PLACES = 3  # that a sentence names
_SLOWER = 1.05  # a ratio of times below it is no difference
_CELL = ["scenario", "sensor"]


@dataclass(frozen=True)
class Paragraph:
    """Sentences about an estimator.

    Attributes:
        estimator: its label, arbitrary text.
        sentences: plain text, with labels as they are.
    """

    estimator: str
    sentences: tuple[str, ...]


def paragraphs(
    board: pd.DataFrame, wins: pd.DataFrame, levels: pd.DataFrame, study: Study = USUAL
) -> list[Paragraph]:
    """A paragraph on each estimator, those with the most first ranks first, the floor last.

    Args:
        board: the leaderboard.
        wins: from ``statistics.wins.win_table``.
        levels: from ``statistics.noise_errors``.
        study: study of the run.
    """
    if board.empty:
        return []
    metric = primary(in_leaderboard(study.metrics, board))
    firsts = {name: _firsts(rows, metric) for name, rows in board.groupby("estimator")}
    order = sorted(firsts, key=lambda name: (name == FLOOR, -firsts[name], str(name)))
    return [
        Paragraph(
            str(name),
            (
                *_ranks(board, str(name), metric),
                *_duels(wins, str(name), metric),
                *_failures(levels[levels["estimator"] == name]),
                *_regions(board[board["estimator"] == name]),
                *_cost(board, str(name)),
            ),
        )
        for name in order
    ]


def markdown_paragraphs(found: Sequence[Paragraph]) -> str:
    """The paragraphs as Markdown, each after an empty line."""
    return "".join(
        f"\n**{markdown_text(one.estimator)}.** {markdown_text(' '.join(one.sentences))}\n"
        for one in found
    )


def _firsts(rows: pd.DataFrame, metric: MetricDeclaration | None) -> int:
    column = f"{metric.name}_rank" if metric else ""
    return int(rows[column].eq(1).sum()) if column in rows else 0


def _ranks(board: pd.DataFrame, name: str, metric: MetricDeclaration | None) -> Iterator[str]:
    """In how many cells it is first, and where it is last."""
    column = f"{metric.name}_rank" if metric else ""
    if metric is None or column not in board:
        return
    whole = board[board["estimator"] == name]
    own = whole[whole[column].notna()]
    others = whole[~ranks_at(whole)]
    if len(others):
        places = [f"{scenario}, {sensor} ({why})" for scenario, sensor, why in _reasons(others)]
        yield f"It does not rank in {_count(places)}: {_listed(places)}."
    if own.empty:
        if len(others) < len(whole):
            yield f"It has no rank by {metric.label}: too few draws, or a small part of the trials."
        return
    first = own[own[column] == 1]
    of = f"of {len(own)} cells of scenario and sensor" if len(own) > 1 else "of one cell"
    tops = board[(board[column] == 1) & (board["estimator"] != FLOOR)]
    sizes = tops.groupby(_CELL).size()
    alone = sum(sizes.get(cell, 0) == 1 for cell in _cells(first)) if name != FLOOR else 0
    shared = f", {alone} of them alone" if alone else ""
    yield f"It has rank 1 by {metric.label} in {len(first) or 'none'} {of}{shared}."
    worst = int(own[column].max())
    if worst > 1:
        places = [f"{scenario}, {sensor}" for scenario, sensor in _cells(own[own[column] == worst])]
        yield f"Its worst rank is {worst}, in {_count(places)}: {_listed(places)}."
    broken = own[np.isinf(own[f"{metric.name}_median"].to_numpy(float))]
    if len(broken):
        places = [f"{scenario}, {sensor}" for scenario, sensor in _cells(broken)]
        yield f"Its median error is infinite in {_count(places)}: {_listed(places)}."


def _duels(wins: pd.DataFrame, name: str, metric: MetricDeclaration | None) -> Iterator[str]:
    """Whom it beats, and who beats it, draw by draw."""
    if metric is None:
        return
    told = wins[wins["error"] == metric.name]
    told = told[told["scenario"] == ALL] if (told["scenario"] == ALL).any() else told
    better: list[str] = []
    worse: list[str] = []
    unclear: list[str] = []
    for row in told.to_dict("records"):
        if name not in (row["estimator"], row["other"]):
            continue
        first = row["estimator"] == name
        share = row["wins"] if first else 1 - row["wins"]
        text = f"{row['other'] if first else row['estimator']} ({_percent(share)})"
        clear = row["p_holm"] < SIGNIFICANCE
        (unclear if not clear else better if share > 0.5 else worse).append(text)
    for start, others in (
        ("Draw by draw, it beats", better),
        ("Draw by draw, it loses to", worse),
        ("Draw by draw, there is no significant difference to", unclear),
    ):
        if others:
            others[0] = others[0].replace(" %)", " % of draws)")
            yield f"{start} {_joined(others)}."


def _failures(levels: pd.DataFrame) -> Iterator[str]:
    """How many attempts fail, and where most of them do."""
    attempts, failures = int(levels["attempts"].sum()), int(levels["failures"].sum())
    if not attempts:
        yield "It attempted nothing."
        return
    if not failures:
        yield f"It fails in none of {attempts} trials."
        return
    order = ["failures", "scenario", "sensor", "sigma"]
    spoilt = levels[levels["failures"] > 0].sort_values(order, ascending=[False, True, True, True])
    places = [
        f"{row['scenario']}, {row['sensor']}, at {row['sigma']:g} m"
        + (f" ({row['failures']} of {row['attempts']})" if len(spoilt) > 1 else "")
        for row in spoilt.to_dict("records")
    ]
    if len(places) == 1 and failures > 1:
        where = f", all on {places[0]}"
    elif len(places) <= _MOST_PLACES:
        where = f": {'; '.join(places)}"
    else:
        where = f", most often on {places[0]}"
    yield f"It fails in {failures} of {attempts} trials{where}."


def _regions(rows: pd.DataFrame) -> Iterator[str]:
    """How often its regions hold the truth."""
    if "covers_truth_trials" not in rows or not rows["covers_truth_trials"].sum():
        return
    number = rows["covers_truth_trials"]
    share = float((rows["covers_truth_share"].fillna(0) * number).sum() / number.sum())
    yield f"Its 95 % regions hold the true weights in {_percent(share)} of {number.sum()} trials."


def _cost(board: pd.DataFrame, name: str) -> Iterator[str]:
    """Its median time, and how it compares with the fastest contender of each cell."""
    times = board.set_index(_CELL)["solve_seconds_median"]
    names = board["estimator"].to_numpy()
    own = times[names == name].dropna()
    if own.empty:
        return
    cells = f", in the median over {len(own)} cells" if len(own) > 1 else ""
    yield f"Its median time is {human(1e3 * own.median())} ms{cells}."
    contenders = times[names != FLOOR]
    if name == FLOOR or len({*names} - {FLOOR}) < 2:
        return
    ratios = own / contenders.groupby(level=_CELL).min().reindex(own.index)
    ratio, fastest = float(ratios.median()), int((ratios == 1).sum())
    of = f"{fastest} of {len(own)} cells" if len(own) > 1 else "this cell"
    if math.isfinite(ratio) and ratio >= _SLOWER:
        yield f"That is {human(ratio)} times the time of the fastest contender."
    if fastest:
        yield f"It is the fastest contender in {of}."


def _cells(rows: pd.DataFrame) -> list[tuple[str, str]]:
    return list(rows[_CELL].itertuples(index=False, name=None))


def _reasons(rows: pd.DataFrame) -> list[tuple[str, str, str]]:
    return list(rows[[*_CELL, "standing"]].itertuples(index=False, name=None))


def _listed(parts: Sequence[str]) -> str:
    """The first places, and how many more there are."""
    rest = len(parts) - _MOST_PLACES
    return "; ".join(parts[:_MOST_PLACES]) + (f"; and {rest} more" if rest > 0 else "")


def _count(places: Sequence[str]) -> str:
    return f"{len(places)} cell{'s' if len(places) > 1 else ''}"


def _joined(parts: Sequence[str]) -> str:
    *others, last = parts
    return f"{', '.join(others)} and {last}" if others else last


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
