"""How well recorded drivers are predicted, on one half of the recordings or on both.

Pieces of a road are in its two halves in turn. The first half is there to develop on: what is
fitted is fitted to every other one of its pieces. The second half is opened once; there everything
is fitted to the first.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pandas as pd

from olne_bench.bench.people.cases import AHEAD, HORIZONS, IMPERFECT, KINDS, Case
from olne_bench.bench.people.rivals import POPULATION, Rivals, fitted_to
from olne_bench.errors import UserError

METHODS = (
    *("straight", "controls", "game", "alone", "own weights", IMPERFECT, POPULATION),
    *("intent", "leader known"),
    *("idm", "mobil", "ridge", "kernel"),
)
FIRST, SECOND, BOTH = "first", "second", "both"
#: Shares of a Laplace distribution within so many mean errors.
_NINETY = np.log(10.0)
_DRAWS = 2000  # of the bootstrap
_LEAST = 3  # pieces of which there is a summary
#: What methods are compared with, beside driving straight on.
_BESIDE = {
    "game": ("alone", "idm"),
    **dict.fromkeys(("own weights", IMPERFECT, POPULATION), ("game",)),
}


def second_half(pieces: dict[str, str]) -> set[str]:
    """Pieces of the second half, of all pieces and their roads."""
    turns = {road: sorted(p for p in pieces if pieces[p] == road) for road in pieces.values()}
    return {piece for own in turns.values() for piece in own[1::2]}


def rows_of(cases: Sequence[Case], second: set[str]) -> pd.DataFrame:
    """A row for each case, horizon and method; cases of the second half may be missing.

    Raises UserError if the first half has fewer than two pieces, so that nothing can be fitted.
    """
    first = [case for case in cases if case.piece not in second]
    order = sorted({case.piece for case in first})
    if len(order) < 2:
        raise UserError(
            "what predicts one piece of recording is fitted to others: expected at least two to "
            f"develop on, got {len(order)}"
        )
    turns = [[case for case in first if order.index(case.piece) % 2 == k] for k in (0, 1)]
    parts = [(turns[0], turns[1]), (turns[1], turns[0])]
    parts.append(([case for case in cases if case.piece in second], first))
    rows: list[dict[str, object]] = []
    for own, others in parts:
        if own:
            rivals = fitted_to(others)
            half = FIRST if own[0] in first else SECOND
            rows += [row | {"half": half} for case in own for row in _rows(case, rivals)]
    return pd.DataFrame(rows)


def _rows(case: Case, rivals: Rivals) -> Iterator[dict[str, object]]:
    predicted = rivals.predicted(case)
    for method, places in predicted.items():
        off = places - case.happened
        spread = rivals.spread(method, case.road)[: len(off)]
        score = np.log(2 * spread) + np.abs(off) / spread
        shares = rivals.shares(method, case)
        if shares is not None:
            apart = np.abs(case.sampled[:, :, 0] - case.happened[:, 0]) / spread[:, 0]
            score[:, 0] = np.log(2 * spread[:, 0]) - np.log(shares @ np.exp(-apart) + 1e-300)
        region = case.claimed if method == "game" else _NINETY * spread
        holds = np.abs(off) < region
        for k, ahead in enumerate(HORIZONS[: len(off)]):
            row: dict[str, object] = {"road": case.road, "piece": case.piece, "kind": case.kind}
            row |= {"method": method}
            row |= {"ahead": ahead, "along": off[k, 0], "left": off[k, 1], "score": score[k, 0]}
            row |= {"holds_along": holds[k, 0], "holds_left": holds[k, 1]}
            if method == "own weights":
                row |= {"seconds": case.seconds, "residual": case.residual}
            yield row | {"answered": case.answered}


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Mean errors by road, half, kind, horizon and method, over those of driving straight on."""
    known = [half for half in (FIRST, SECOND) if half in set(rows["half"])]
    halves = {half: {half} for half in known} | ({BOTH: {*known}} if len(known) > 1 else {})
    kinds = {"all": {*KINDS}, **{kind: {kind} for kind in KINDS}}
    found = []
    for road, half, kind in product(sorted(rows["road"].unique()), halves, kinds):
        part = rows[rows["road"].eq(road) & rows["half"].isin(halves[half])]
        part = part[part["kind"].isin(kinds[kind])]
        for ahead in HORIZONS:
            wide = {str(m): own for m, own in part[part["ahead"] == ahead].groupby("method")}
            if wide and wide["game"]["piece"].nunique() >= _LEAST:
                place = {"road": road, "half": half, "kind": kind, "ahead": ahead}
                found += [place | row for row in _summed(wide)]
    return pd.DataFrame(found)


def _summed(wide: dict[str, pd.DataFrame]) -> Iterator[dict[str, object]]:
    """A row for each method, of the same cases in the same order."""
    for method in METHODS:
        if method not in wide or len(wide[method]) != len(wide["straight"]):
            continue
        own = wide[method]
        row = {"method": method, "cars": len(own), "pieces": own["piece"].nunique()}
        row |= {"along": own["along"].abs().mean(), "left": own["left"].abs().mean()}
        for other in ("straight", *_BESIDE.get(method, ())):
            row |= _ratio(other, wide[other], own)
        row |= {name: own[name].mean() for name in ("score", "holds_along", "holds_left")}
        row |= {name: own[name].median() for name in ("seconds", "residual") if name in own}
        yield row | {"answered": own["answered"].mean()}


def _ratio(name: str, base: pd.DataFrame, own: pd.DataFrame) -> dict[str, float]:
    """Mean error along the way over another method's, with a 95 % bootstrap over pieces."""
    sums = pd.DataFrame({"own": own["along"].abs().to_numpy(), "base": base["along"].abs()})
    by_piece = sums.groupby(base["piece"]).sum().to_numpy()
    rng = np.random.default_rng(0)
    drawn = by_piece[rng.integers(len(by_piece), size=(_DRAWS, len(by_piece)))].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], (0.025, 0.975))
    ratio = by_piece[:, 0].sum() / by_piece[:, 1].sum()
    return {f"over_{name}": ratio, f"over_{name}_low": low, f"over_{name}_high": high}


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """What a reader wants first: errors after ``AHEAD`` over driving straight on, by method."""
    part = table[(table["ahead"] == AHEAD) & (table["method"] != "straight")].copy()
    part["share"] = [
        f"{row.over_straight:.2f} [{row.over_straight_low:.2f}, {row.over_straight_high:.2f}]"
        for row in part.itertuples()
    ]
    index = ["road", "half", "kind", "cars"]
    wide = part.pivot_table(index=index, columns="method", values="share", aggfunc="first")
    return wide[[method for method in METHODS if method in wide.columns]]
