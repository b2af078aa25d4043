"""Test whether errors with a fresh salt are as small as those that were submitted.

An estimator that knows the noise or the draws of a published salt is better there than with
others. Whatever the salt, draws have one distribution, so submitted and fresh ones can be
exchanged. What is exchanged is a *unit*: all that one draw decides. Rows of a unit are not
independent: sensors share the noise, and noise levels of a family share the truth. A unit is

- a seed of a family, with all its sensors and noise levels, or
- a seed of a fixed scenario at one noise level, with all its sensors.

Units of one scenario (and, if it is fixed, of one noise level) are a *stratum*. Labels are
permuted within strata. There are two one-sided tests: whether fresh units have higher ranks, and
whether fewer of them are among the best, as where a tenth of the rows is known by heart.

A first test at ``SUSPICIOUS`` asks for more fresh draws; these alone decide, at ``LEVEL``. So an
honest submission is refused with probability ``LEVEL`` at most, however the first test ends.
"""

import itertools
import math
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.statistics.attempts import errors_of, median

#: Chance that an honest submission is refused by these tests, at most.
LEVEL = 2.5e-4
#: Level of the first test, beyond which further trials decide.
SUSPICIOUS = 0.05
#: Trials of each plugin with fresh salts: of the first test, and of the second.
FIRST, SECOND = 48, 144
#: Most trials of a test, where few seeds were submitted.
MOST = 600
#: Most cells (sensor, noise level) of a unit that are run.
_CELLS = 4
#: Share of units that count as the best.
_BEST = 0.1
#: Logarithms of errors over their median are cut here.
_LOW, _HIGH = -12.0, 3.0
#: So many orders as extreme as the observed one decide (Besag and Clifford 1991).
_ENOUGH = 100
_PERMUTED = 500_000

Stratum = tuple[str, float]
Cell = tuple[str, float]


@dataclass(frozen=True)
class FreshErrors:
    """How an estimator does with a fresh salt."""

    estimator: str
    metric: str
    trials: int
    submitted: float  # median error of the submitted rows of the same cells
    fresh: float  # median error of the fresh trials
    p: float  # chance of fresh errors as much larger, or more, if the salt makes no difference
    decides: bool  # whether there are enough units for a p-value below the level
    level: float = LEVEL  # p-values below it refuse

    @property
    def accepted(self) -> bool:
        """Whether chance explains the difference, and could have been ruled out."""
        return self.decides and self.p >= self.level


def fresh_trials(
    trials: Sequence[Trial], number: int, level: float, rng: np.random.Generator
) -> list[Trial]:
    """Trials of one estimator like some of these, with fresh salts, and seeds as a run has them.

    Whole units are drawn, up to four cells of each: at least so many that the rarest order of
    submitted and fresh ones is rarer than half the level; none if ``MOST`` trials do not suffice.
    """
    strata: dict[Stratum, dict[Cell, list[Trial]]] = {}
    for trial in trials:
        if trial.sigma > 0 or trial.scenario.family:
            cells = strata.setdefault(stratum_of(trial), {})
            cells.setdefault((trial.sensor.label, trial.sigma), []).append(trial)
    names = list(strata)
    order = [names[k] for k in rng.permutation(len(names))]
    chosen = {name: _some(list(strata[name].values()), rng) for name in order}
    sizes = {name: max(len(cell) for cell in cells) for name, cells in chosen.items()}
    counts = _units(chosen, sizes, number, level)
    return [
        replace(cells[0], salt=salt, seed=k % sizes[name])
        for name, count in counts.items()
        for salt, units in _salted(count, sizes[name])
        for k in units
        for cells in chosen[name]
    ]


def stratum_of(trial: Trial) -> Stratum:
    """The stratum of a trial's unit; its noise level is -1 for a family."""
    return trial.scenario.label, -1.0 if trial.scenario.family else trial.sigma


def _some(cells: list[list[Trial]], rng: np.random.Generator) -> list[list[Trial]]:
    chosen = rng.choice(len(cells), min(_CELLS, len(cells)), replace=False)
    return [cells[k] for k in sorted(chosen)]


def _units(
    chosen: Mapping[Stratum, list[list[Trial]]],
    sizes: Mapping[Stratum, int],
    number: int,
    level: float,
) -> dict[Stratum, int]:
    """Number of fresh units of each stratum: one by one, stratum by stratum, until they suffice."""
    counts: dict[Stratum, int] = {}
    trials = 0
    for name, cells in itertools.cycle(chosen.items()):
        enough = orders((sizes[key], _played(key, n)) for key, n in counts.items()) * level > 2
        if trials >= number and enough:
            return counts
        if trials >= MOST:
            break
        counts[name] = counts.get(name, 0) + 1
        trials += len(cells)
    return {}


def _played(name: Stratum, number: int) -> int:
    """How many of so many fresh draws can be counted on: some of a family have no equilibrium."""
    return number if name[1] >= 0 else number // 2


def orders(groups: Iterable[tuple[int, int]]) -> float:
    """In how many ways labels of submitted and fresh units can be given, within strata."""
    return float(math.prod(math.comb(a + b, a) for a, b in groups))


def _salted(count: int, size: int) -> list[tuple[str, range]]:
    """As many salts as are needed, if each has no other seeds than the run had."""
    starts = range(0, count, size)
    return [(secrets.token_hex(16), range(start, min(start + size, count))) for start in starts]


def compare_fresh(
    rows: pd.DataFrame,
    fresh: pd.DataFrame,
    metric: MetricDeclaration,
    families: Iterable[str],
    level: float = LEVEL,
) -> FreshErrors:
    """Compare errors of an estimator's fresh trials with those submitted.

    Failures, and trials that the estimator declines, count as infinitely large. Draws without a
    truth do not count. Seeds of ``families`` draw the truth. Each of both tests has half the level.
    """
    both = pd.concat([rows.assign(fresh=False), fresh.assign(fresh=True)], ignore_index=True)
    both = both[has_truth(both)]
    family = both["scenario"].isin([*families])
    both = both.assign(
        stratum=both["scenario"] + both["sigma"].where(~family, -1.0).map(" {}".format),
        error=np.where(both["status"].eq("skipped"), np.inf, errors_of(both, metric)),
    )
    cell = ["stratum", "sensor", "sigma"]
    run = both.groupby(cell)["fresh"].transform("any").astype(bool)
    both = both[run & ((both["sigma"] > 0) | family)]
    units = _scores(both, cell)
    counts = units.groupby("stratum")["fresh"].agg(["sum", "size"])
    ways = orders((int(n - m), int(m)) for m, n in counts.to_numpy())
    errors = {new: group["error"].to_numpy(float) for new, group in both.groupby("fresh")}
    nothing = np.empty(0)
    return FreshErrors(
        estimator=str(fresh["estimator"].iloc[0]),
        metric=metric.name,
        trials=len(fresh),
        submitted=median(errors.get(False, nothing)),
        fresh=median(errors.get(True, nothing)),
        p=min(1.0, 2 * _chance(units, level)),
        decides=ways * level > 2,
        level=level,
    )


def has_truth(table: pd.DataFrame) -> pd.Series:
    """Which rows' draws have an equilibrium: what is skipped before it is observed has none."""
    return ~(table["status"].eq("skipped") & table["observation_error"].isna())


def _scores(both: pd.DataFrame, cell: list[str]) -> pd.DataFrame:
    """One row per unit: mean rank and least log error within cells, and whether it is fresh."""
    groups = both.groupby(cell)["error"]
    ranks = groups.transform(lambda errors: rankdata(errors) / len(errors))
    logs = groups.transform(lambda errors: _log_ratio(errors.to_numpy(float)))
    table = both.assign(rank=ranks, log=logs)
    unit = ["stratum", "salt_id", "seed", "fresh"]
    return table.groupby(unit, as_index=False).agg({"rank": "mean", "log": "min"})


def _log_ratio(errors: np.ndarray) -> np.ndarray:
    finite = np.maximum(errors, 1e-15)
    middle = np.median(finite)
    if not np.isfinite(middle):  # more than half failed
        return np.where(np.isfinite(errors), -1.0, 0.0)
    return np.asarray(np.clip(np.log10(finite / middle), _LOW, _HIGH))


def _chance(units: pd.DataFrame, level: float) -> float:
    """The smaller p-value of both tests, over permutations of labels within strata."""
    rng = np.random.default_rng(0)
    best = units["log"] <= units["log"].quantile(_BEST)
    times, done = math.ceil(40 / level), 0
    high = few = 0
    for part in _parts(times, len(units)):
        sums, counts = np.zeros(part), np.zeros(part, int)
        for _, stratum in units.assign(best=best).groupby("stratum"):
            number = int(stratum["fresh"].sum())
            places = rng.permuted(np.tile(np.arange(len(stratum)), (part, 1)), axis=1)[:, :number]
            sums += stratum["rank"].to_numpy()[places].sum(axis=1)
            counts += stratum["best"].to_numpy()[places].sum(axis=1)
        new = units["fresh"]
        # The observed order is one of the permutations.
        high += int((sums >= units["rank"][new].sum() - 1e-9).sum())
        few += int((counts <= best[new].sum()).sum())
        done += part
        if min(high, few) >= _ENOUGH:
            break
    return (1 + min(high, few)) / (1 + done)


def _parts(times: int, size: int) -> list[int]:
    """Numbers of permutations that fit into memory at a time."""
    most = max(1, _PERMUTED // max(size, 1))
    return [min(most, times - start) for start in range(0, times, most)]
