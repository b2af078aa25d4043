"""The score: by how much an estimator's errors are smaller than those of the paper's method.

It is the geometric mean over trials with noise of an error over the reference's in the same trial,
of draws that all ranked estimators share; 0.79 reads: errors are 21 % smaller. A failure counts as
the larger error of ``uniform`` and the paper's method in its trial, so that no estimator moves
another's score. Intervals resample draws within scenarios, and tests change the signs of whole
draws: in a family a draw is a seed with all its noise levels and sensors, in a fixed scenario one
noise with all sensors.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.report.parts import joined
from olne_bench.bench.report.statistics.attempts import (
    FLOOR,
    attempts_of,
    errors_of,
    measured,
    which,
)
from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE, holm
from olne_bench.bench.report.study import USUAL, Study, in_table, primary, scored

#: In place of a scenario or a sensor: all of them.
ALL = "all"
#: The paper's method, to whose errors all others are compared.
REFERENCE = "kkt_constrained"
#: The baseline of the paper.
BASELINE = "kkt_residual"

#: An estimator ranks in a cell if it has this share of the draws that the others have, and over all
#: scenarios if it ranks in this share of the cells of scenario and sensor.
_LARGE_PART, _ENOUGH_CELLS = 0.4, 0.25
#: With fewer draws no test can be significant, and an interval would be too narrow.
FEWEST_DRAWS = 6
_RESAMPLES, _SIGN_CHANGES, _BATCH = 1000, 19_999, 1000
_NEGLIGIBLE, _ROUNDING = 1e-3, 1e-9  # of log ratios; of their sums
_TAILS = 0.025, 0.975

_CELL = ["scenario", "sensor"]
_TRIAL = [*_CELL, "sigma", "draw"]
_LABELS = ["error", *_CELL, "estimator"]
#: What rows of ``score_table`` are about, the widest first.
_SLICES: tuple[list[str], ...] = ([], ["sigma"], ["scenario"], _CELL)
_SCORES = ["ranked", "scenarios", "draws", "trials", "failures", "median"]
_SCORES += ["score", "score_low", "score_high"]
_PAIR = ["draws", "ratio", "ratio_low", "ratio_high", "p", "p_holm"]


def log_errors(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Logarithms of the errors that count, of estimators that may rank and floors.

    Columns: ``error, scenario, sensor, sigma, draw, estimator``; ``log`` of the error, or of what
    counts in place of a failure; ``failed``; ``ranked``, in this scenario and sensor.
    """
    noisy = attempts_of(trials[trials["sigma"] > 0])
    metrics = in_table(scored(study.metrics), trials) if len(noisy) else []
    level = noisy["sigma"].where(~which(noisy["scenario"], study.is_family), 0.0)
    draw = noisy["seed"].astype(str) + ":" + level.map("{:g}".format).astype(str)
    floors = [name for name in noisy["estimator"].unique() if study.is_floor(name)]
    parts = []
    for metric in metrics:
        about = measured(noisy, metric, study)
        rows = noisy.loc[about, [*_CELL, "sigma", "estimator"]].assign(draw=draw[about])
        logs = np.log(np.maximum(errors_of(noisy[about], metric), metric.negligible))
        parts.append(rows.assign(error=metric.name, log=logs))
    columns = ["error", *_TRIAL, "estimator", "log", "failed", "ranked"]
    whole = _shared(pd.concat(parts), floors) if parts else pd.DataFrame(columns=columns)
    whole = whole[columns].astype(dict.fromkeys(_LABELS, str))
    return whole.astype({"failed": bool, "ranked": bool})


def _shared(rows: pd.DataFrame, floors: Sequence[str]) -> pd.DataFrame:
    """The trials that all ranked estimators of an error's cell share, with failures replaced."""
    cell, trial = ["error", *_CELL], ["error", *_TRIAL]
    rows = rows.sort_values(cell, kind="stable", ignore_index=True)
    draws = rows.groupby([*cell, "estimator"])["draw"].transform("nunique")
    contends = ~rows["estimator"].isin(floors)
    of_cell = rows[cell].assign(most=draws.where(contends)).groupby(cell)["most"]
    ranked = contends & (draws >= _LARGE_PART * of_cell.transform("max"))
    number = rows["estimator"].where(ranked).groupby([rows[n] for n in cell]).transform("nunique")
    here = ranked.groupby([rows[name] for name in trial]).transform("sum")
    own = rows.assign(ranked=ranked)[(here == number) & (number > 0)]
    failed = ~np.isfinite(own["log"])
    finite = own.assign(log=own["log"].mask(failed), failed=failed)
    places = [finite[name] for name in trial]
    known = finite["log"].where(finite["estimator"].isin([FLOOR, REFERENCE]))
    # In a study without them, or where both failed, any other has to do.
    guess = known.groupby(places).transform("max")
    worst = finite["log"].groupby(places).transform("max")
    found = finite.assign(log=finite["log"].fillna(guess).fillna(worst))
    return found[found["log"].notna()]


def references(logs: pd.DataFrame, study: Study = USUAL) -> dict[str, str]:
    """To whose errors those of each kind are compared: the paper's method, or the first one."""
    found = {}
    for error, rows in logs[logs["ranked"]].groupby("error"):
        names = set(rows["estimator"])
        order = [REFERENCE, *study.estimators, *sorted(names)]
        found[str(error)] = next(name for name in order if name in names)
    return found


def score_table(logs: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """The score of each estimator, by each error, from ``log_errors`` of all scenarios.

    Columns: ``error, scenario, sensor, sigma, estimator`` (scenario and sensor may be ``all``;
    sigma is NaN for all levels); ``reference``; ``ranked``; the numbers of ``scenarios, draws,
    trials`` and ``failures`` that count; the ``median`` error of these trials, failures being
    infinite; ``score, score_low, score_high``, with the ends of a 95 % bootstrap interval.
    """
    columns = ["error", *_CELL, "sigma", "estimator", "reference", *_SCORES]
    parts = [pd.DataFrame(columns=columns)]
    known = references(logs, study)
    for error, ratios in _ratios(logs, known):
        common = _common(ratios)
        for keys in _SLICES:
            rows_of = ratios if "scenario" in keys else common
            for place, part in rows_of.groupby(keys) if keys else [((), rows_of)]:
                labels: dict[str, Any] = {"error": error, "sigma": np.nan}
                labels |= {"scenario": ALL, "sensor": ALL}
                labels |= dict(zip(keys, place, strict=True)) | {"reference": known[error]}
                parts.append(_scores(part).assign(**labels))
    return joined(parts)[columns]


def pair_table(logs: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Ranked estimators in pairs, over all scenarios and in each, by each error of ``log_errors``.

    Columns: these; ``draws`` that both have; ``ratio`` (geometric mean of the first's errors over
    the other's), ``ratio_low, ratio_high`` (95 %); ``p`` of a permutation test; ``p_holm``,
    adjusted after Holm for all pairs of an error in the same scenarios.
    """
    columns = ["error", "scenario", "estimator", "other", *_PAIR]
    parts = [pd.DataFrame(columns=columns)]
    for error, own in _ratios(logs, references(logs, study)):
        ratios = own[own["ranked"]]
        for scenario, part in [(ALL, _common(ratios)), *ratios.groupby("scenario")]:
            pairs = _pairs(part)
            adjusted = holm(pairs["p"].to_numpy(float))
            parts.append(pairs.assign(error=error, scenario=scenario, p_holm=adjusted))
    return joined(parts)[columns]


def _ratios(logs: pd.DataFrame, known: dict[str, str]) -> Iterator[tuple[str, pd.DataFrame]]:
    """Each error's rows with ``ratio``, the logarithm of error over its reference's in the trial.

    Also numbers ``cell`` of scenario and sensor, ``trial`` in their order, ``unit`` of their draw.
    """
    if not known:
        return
    of_reference = logs["estimator"] == logs["error"].map(known)
    own = logs.loc[of_reference, ["error", *_TRIAL, "log"]].rename(columns={"log": "of_reference"})
    both = logs.merge(own, on=["error", *_TRIAL])
    places = {"cell": _CELL, "trial": _TRIAL, "unit": ["scenario", "draw"]}
    numbers = {name: both.groupby(levels).ngroup() for name, levels in places.items()}
    whole = both.assign(ratio=both["log"] - both["of_reference"], **numbers)
    for error, rows in whole.groupby("error"):
        yield str(error), rows


def _common(ratios: pd.DataFrame) -> pd.DataFrame:
    """The cells that all estimators share that rank over all scenarios; others do not rank."""
    cells = ratios[ratios["ranked"]].groupby("estimator")["cell"].agg(set)
    numbers = cells.map(len).sort_values(ascending=False, kind="stable")
    shared, ranked = set(ratios["cell"]), []
    for name in numbers.index[numbers >= _ENOUGH_CELLS * numbers.max()]:
        if both := shared & cells[name]:
            shared = both
            ranked.append(name)
    here = ratios[ratios["cell"].isin(shared)]
    return here.assign(ranked=here["estimator"].isin(ranked))


class _Draws:
    """Values of trials, such as log ratios, summed by draw.

    ``sums`` (U, C) are those of the U draws, a column for each estimator or pair, of ``sizes``
    (U, C) trials that have a value; ``strata`` (U,) are the draws' scenarios, as numbers.
    """

    def __init__(self, ratios: pd.DataFrame, trials: np.ndarray, values: np.ndarray) -> None:
        """Sum values (T, C) of trials, whose first rows (T,) are given; NaN where there is none."""
        codes = pd.factorize(ratios["unit"].to_numpy()[trials])[0]
        units, first = np.unique(codes, return_index=True)
        self.strata = pd.factorize(ratios["scenario"].to_numpy()[trials])[0][first]
        known, shape = np.isfinite(values), (len(units), values.shape[1])
        self.sums, self.sizes = np.zeros(shape, order="F"), np.zeros(shape, order="F")
        np.add.at(self.sums, codes, np.where(known, values, 0.0))
        np.add.at(self.sizes, codes, known)
        self.draws = (self.sizes > 0).sum(axis=0)  # (C,) that have a value
        with np.errstate(invalid="ignore"):
            self.means = self.sums.sum(axis=0) / self.sizes.sum(axis=0)  # (C,) over trials

    def ratios(self, name: str) -> dict[str, np.ndarray]:
        """Columns ``draws``, and of this name: geometric means of values' exponentials, ends."""
        low, high = np.exp(self.interval())
        middle = np.exp(self.means)
        return {"draws": self.draws, name: middle, f"{name}_low": low, f"{name}_high": high}

    def interval(self) -> np.ndarray:
        """(2, C) ends of 95 % bootstrap intervals of the means; NaN for few draws."""
        rng = np.random.default_rng(0)
        times = np.empty((_RESAMPLES, len(self.sums)))
        for stratum in np.unique(self.strata):
            here = np.flatnonzero(self.strata == stratum)
            even = np.full(len(here), 1 / len(here))
            times[:, here] = rng.multinomial(len(here), even, size=_RESAMPLES)
        with np.errstate(invalid="ignore"):
            drawn = (times @ self.sums) / (times @ self.sizes)
        found = np.full((2, self.sums.shape[1]), np.nan)
        enough = self.draws >= FEWEST_DRAWS
        found[:, enough] = np.nanquantile(drawn[:, enough], _TAILS, axis=0)
        return found

    def p(self) -> np.ndarray:
        """(C,) two-sided chances of sums as far from zero, if each draw had either sign."""
        rng = np.random.default_rng(0)
        seen = np.abs(self.sums.sum(axis=0)) * (1 - _ROUNDING)
        as_far = np.zeros(len(seen))
        for start in range(0, _SIGN_CHANGES, _BATCH):
            size = min(_BATCH, _SIGN_CHANGES - start), len(self.sums)
            as_far += (np.abs(rng.choice([-1.0, 1.0], size=size) @ self.sums) >= seen).sum(axis=0)
        return np.where(self.draws >= FEWEST_DRAWS, (1 + as_far) / (1 + _SIGN_CHANGES), 1.0)


def _wide(ratios: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First rows (T,) of trials, estimators (E,), and ratios (T, E), NaN where there is none."""
    _, trials, rows = np.unique(ratios["trial"], return_index=True, return_inverse=True)
    columns, names = pd.factorize(ratios["estimator"].to_numpy(), sort=True)
    values = np.full((len(trials), len(names)), np.nan)
    # Of two rows of one trial the first counts, which is set last.
    values[rows[::-1], columns[::-1]] = ratios["ratio"].to_numpy()[::-1]
    return trials, names, values


def _scores(ratios: pd.DataFrame) -> pd.DataFrame:
    """Scores of one slice, without its labels."""
    trials, names, values = _wide(ratios)
    told = _Draws(ratios, trials, values)
    columns = ["estimator", "ranked", "scenario", "failed", "log"]
    whole = {name: ratios[name].to_numpy() for name in columns}
    errors = np.where(whole["failed"], np.inf, np.exp(whole["log"].astype(float)))
    own = [whole["estimator"] == name for name in names]
    counts = {
        "estimator": names,
        "ranked": [whole["ranked"][rows].all() for rows in own],
        "scenarios": [len(set(whole["scenario"][rows])) for rows in own],
        "failures": [whole["failed"][rows].sum() for rows in own],
        "median": [np.median(errors[rows]) for rows in own],
        "trials": told.sizes.sum(axis=0).astype(int),
    }
    return pd.DataFrame(counts | told.ratios("score"))


def _pairs(ratios: pd.DataFrame) -> pd.DataFrame:
    """Comparisons of the estimators of one slice, without its labels."""
    trials, names, values = _wide(ratios)
    first, second = np.triu_indices(len(names), 1)
    differences = values[:, first] - values[:, second]
    # Solvers that end at the same optimum differ by rounding.
    differences[np.abs(differences) < _NEGLIGIBLE] = 0.0
    told = _Draws(ratios, trials, differences)
    labels = {"estimator": names[first], "other": names[second]}
    found = pd.DataFrame(labels | told.ratios("ratio") | {"p": told.p()})
    return found[found["draws"] > 0]


def board_rows(scores: pd.DataFrame, study: Study = USUAL) -> dict[str, pd.DataFrame]:
    """Rows of ``score_table`` over all scenarios and noise levels, by error.

    Ranked estimators come first, by their score; then others, and floors at the end.
    """
    ordered = in_order(scores[(scores["scenario"] == ALL) & scores["sigma"].isna()], study)
    found = dict(iter(ordered.groupby("error", sort=False)))
    first = primary(study.metrics)
    errors = [metric for metric in scored(study.metrics) if metric.name in found]
    return {m.name: found[m.name] for m in sorted(errors, key=lambda metric: metric != first)}


def in_order(rows: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Rows with ``estimator, ranked, score`` in the order of a board, and ``floor, unranked``."""
    floor = which(rows["estimator"], study.is_floor)
    found = rows.assign(floor=floor, unranked=~rows["ranked"].eq(True))
    return found.sort_values(["floor", "unranked", "score"], kind="stable")


def best_group(pairs: pd.DataFrame, names: Sequence[str]) -> list[str]:
    """The first of ranked estimators in the order of their scores, and who ties with it.

    ``pairs`` are rows of ``pair_table`` of one error and scenario.
    """
    if not names:
        return []
    told = pairs[pairs["p_holm"] < SIGNIFICANCE]
    one, other = told["estimator"] == names[0], told["other"] == names[0]
    worse = {*told.loc[one, "other"], *told.loc[other, "estimator"]}
    return [name for name in names if name not in worse]
