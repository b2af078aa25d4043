"""Check stored rows: compare runs, run rows again, and say how near to the truth honest ones are.

python scripts/stored_rows.py optima runs/field runs/field --estimators bilevel kkt_constrained
python scripts/stored_rows.py ranks runs/roads runs/again
python scripts/stored_rows.py repeat results/paper/trials.parquet paper
python scripts/stored_rows.py plausible runs/roads
"""

import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import shared
import numpy as np
import pandas as pd
from pyarrow import parquet

from olne_bench.bench.plan.draws import draws_of, draws_source
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial, in_order_of_plugins
from olne_bench.bench.report.statistics.attempts import places_of
from olne_bench.bench.report.statistics.identifiability import weights_of
from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE
from olne_bench.bench.report.statistics.plausibility import distances_of, implausible
from olne_bench.bench.report.study import Study, study_in
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.store import read_store
from olne_bench.bench.submission.played import played_study
from olne_bench.envs.solved.kept_draws import travelling

SEQUENCE = ["scenario", "sensor", "sigma", "seed"]
SAME, NOTHING = 1e-6, 1e-12  # relative and absolute difference of objectives
#: What ``ranks`` compares; errors below the last number are rounding.
LEVEL = ["scenario", "sensor", "sigma", "estimator"]
PAIR = ["scenario", "estimator", "other"]
ERRORS = ("position_error", "cosine_error")
NEGLIGIBLE = 1e-7
#: They depend on the machine.
FREE = ("message", "extras", "solve_seconds")


def optima(run: Path, other: Path, estimators: tuple[str, ...] = ("kkt_constrained",) * 2) -> None:
    """Check whether two estimators that minimise the squared error found the same optima.

        olne-bench run scripts/paper_ipopt.toml --out runs/ipopt      (half an hour)
        python scripts/stored_rows.py optima runs/ipopt runs/paper

    Compares the sequences on which both converge. Prints, per scenario and sensor: how many
    sequences have the same objective (to a relative 1e-6), how far their weights are apart, how
    often the second one's objective is lower or higher, and the medians of their errors.
    """
    first, second = _solved(run, estimators[0]), _solved(other, estimators[-1])
    rows = first.merge(second, on=SEQUENCE, suffixes=("_1", "_2"))
    table = rows.groupby(SEQUENCE[:2]).apply(_compared)
    print(table.to_string(float_format=lambda value: f"{value:.3g}"))


def _solved(folder: Path, estimator: str) -> pd.DataFrame:
    trials = pd.read_parquet(folder / "trials.parquet")
    known = trials.estimator.str.split("(").str[0]  # the label without parameters
    solved = trials[(known == estimator) & trials.status.isin(["ok", "failed_forward"])]
    return solved[[*SEQUENCE, "count", "objective", "weights", "cosine_error", "position_error"]]


def _compared(rows: pd.DataFrame) -> pd.Series:
    one, two = rows.objective_1, rows.objective_2
    margin = SAME * one + NOTHING
    same = (two - one).abs() <= margin
    pairs = zip(rows[same].weights_1, rows[same].weights_2, strict=True)
    apart = [np.abs(np.stack(own) - np.stack(other)).max() for own, other in pairs]
    return pd.Series(
        {
            "sequences": len(rows),
            "same %": 100 * same.mean(),
            "weights apart": max(apart, default=np.nan),
            "lower %": 100 * (two < one - margin).mean(),
            "higher %": 100 * (two > one + margin).mean(),
            "higher by 1e-4 %": 100 * (two > one * (1 + 1e-4) + NOTHING).mean(),
            "cosine 1": rows.cosine_error_1.median(),
            "cosine 2": rows.cosine_error_2.median(),
            "position 1 [m]": rows.position_error_1.median(),
            "position 2 [m]": rows.position_error_2.median(),
        }
    )


def ranks(run: Path, other: Path) -> None:
    """Compare two runs of a suite on different draws: same scores, and medians within intervals?

        olne-bench run roads --out runs/roads
        olne-bench run roads --salt again --out runs/again
        python scripts/stored_rows.py ranks runs/roads runs/again

    Scores of a scenario and sensor differ where their 95 % intervals do not meet, and so do medians
    at a noise level. Of equal medians, each is within the other's interval in some 79 % of cases,
    as both are of draws; that share is printed, too. Prints shares and what does not agree, and
    where one run's significant win in a scenario is the other's loss.
    """
    runs = run, other
    levels = [pd.read_csv(folder / "errors_by_noise.csv") for folder in runs]
    scored = all((folder / "scores.csv").is_file() for folder in runs)
    if not scored:
        print("only medians are compared: a run has no scores.csv")
    for error in ERRORS:
        if scored:
            _say(f"{error}: intervals of scores meet in", _scores_meet(runs, error))
            tests = [pd.read_csv(folder / "comparisons.csv") for folder in runs]
            _say(f"{error}: no pair is significant one way and the other in", _agreed(tests, error))
        both = _both(levels, LEVEL, f"{error}_")
        within = _reaches(both, "median", "median").mean()
        print(f"{error}: each median within the other's interval in {within:.1%} of {len(both)}")
        _say(f"{error}: intervals of medians meet in", _reaches(both, "low", "high"))


def _scores_meet(runs: tuple[Path, ...], error: str) -> pd.Series:
    """Whether intervals of scores meet, by scenario, sensor and estimator."""
    tables = [pd.read_csv(folder / "scores.csv") for folder in runs]
    scores = [table[(table["error"] == error) & table["sigma"].isna()] for table in tables]
    both = _both(scores, ["scenario", "sensor", "estimator"], "score_")
    return _reaches(both, "low", "high")


def _say(what: str, agrees: pd.Series) -> None:
    print(f"{what} {agrees.mean():.1%} of {len(agrees)}")
    for place in agrees.index[~agrees]:
        print(f"  not in {', '.join(map(str, place))}")


def _agreed(tests: list[pd.DataFrame], error: str) -> pd.Series:
    """Whether no run's significant win is a significant loss in the other, by pair."""
    told = [table[table["error"] == error].set_index(PAIR) for table in tests]
    both = told[0].merge(told[1], on=PAIR, suffixes=("_1", "_2"))
    clear = (both["p_holm_1"] < SIGNIFICANCE) & (both["p_holm_2"] < SIGNIFICANCE)
    return ~(clear & ((both["ratio_1"] < 1) != (both["ratio_2"] < 1)))


def _both(tables: list[pd.DataFrame], key: list[str], prefix: str) -> pd.DataFrame:
    """Numbers and intervals of both runs, by what they are about."""
    both = tables[0].merge(tables[1], on=key, suffixes=("_1", "_2")).set_index(key)
    found = both.filter(regex=f"^{prefix}(median|low|high)_[12]$").dropna()
    return found.rename(columns=lambda name: name.removeprefix(prefix))


def _reaches(both: pd.DataFrame, least: str, most: str) -> pd.Series:
    """Whether each run's numbers reach into the interval of the other."""
    agrees = [
        (both[f"{least}_{own}"] <= both[f"high_{other}"] + NEGLIGIBLE)
        & (both[f"{most}_{own}"] >= both[f"low_{other}"] - NEGLIGIBLE)
        for own, other in ((1, 2), (2, 1))
    ]
    return pd.Series(agrees[0] & agrees[1], index=both.index)


def repeat(
    table: Path,
    suite: str,
    estimator: tuple[str, ...] = (),
    number: int = 40,
    seed: int = 0,
    jobs: int = 2,
) -> int:
    """Run some rows of a published table again, and say which numbers differ and by how much.

    A column is equal if all its values are, bit by bit. Of the others, the median and the largest
    relative difference are shown. It also names trials whose status changed, and says whether the
    environment of the rows is the present one. Exit code 1 if any number differs.
    """
    stored = parquet.read_table(table)
    rows, columns = stored.to_pylist(), {one.name: str(one.type) for one in stored.schema}
    if estimator:
        rows = [row for row in rows if row["estimator"] in estimator]
    chosen = random.Random(seed).sample(rows, min(number, len(rows)))
    known = {_key(row, columns): row for row in chosen}
    whole = load_suite(suite)
    every = in_order_of_plugins(whole, draws=draws_source(suite, whole))
    trials = [trial for trial in every if _key(trial.labels, columns) in known]
    ended = list(run_trials(trials, jobs=jobs))
    there = ", ".join(sorted({row.get("environment_version", "not told") for row in chosen}))
    here = ", ".join(sorted({trial.versions.environment for trial in trials}))
    print(f"environment of the rows: {there}, here: {here}")
    return int(_differ(known, ended, columns))


def _key(labels: dict[str, Any], columns: dict[str, str]) -> tuple[str, ...]:
    """What identifies a trial in a table of such columns; small ones leave out parameters."""
    return tuple(str(labels[name]) for name in KEY_COLUMNS if name in columns)


def _differ(
    known: dict[tuple[str, ...], Any],
    ended: list[tuple[Trial, Outcome]],
    columns: dict[str, str],
) -> bool:
    """Print what differs, and return whether anything does.

    ``columns`` are the table's, with their types. What a small table leaves out is not compared.
    """
    small = "parameters" not in columns
    differences: dict[str, list[float]] = {}
    for trial, outcome in ended:
        row, again = known[_key(trial.labels, columns)], outcome.columns | outcome.scores
        for name in sorted(again.keys() - set(FREE)):
            value = again[name]
            if small and name not in columns:
                continue
            if columns.get(name) == "float" and value is not None:  # single precision
                value = float(np.float32(value))
            differences.setdefault(name, []).append(_difference(row.get(name), value))
        if row["status"] != outcome.status:
            print(f"{', '.join(trial.key)}: {row['status']} there, {outcome.status} here")
    equal = [name for name, found in differences.items() if not any(found)]
    print(f"{len(ended)} rows; equal in all: {', '.join(equal)}")
    for name, found in differences.items():
        changed = [one for one in found if one]
        if changed:
            print(
                f"{name}: {len(changed)} rows differ, relatively by {np.median(changed):.1g} in "
                f"the median, {max(changed):.1g} at most"
            )
    return len(equal) < len(differences)


def _difference(there: Any, here: Any) -> float:
    """Largest relative difference; infinity where only one is a number, or texts differ."""
    if isinstance(there, str | bytes) or isinstance(here, str | bytes):
        return 0.0 if there == here else np.inf
    one, other = (np.array(np.nan if v is None else v, dtype=float) for v in (there, here))
    if one.shape != other.shape or (np.isnan(one) != np.isnan(other)).any():
        return np.inf
    scale = np.maximum(np.maximum(np.abs(one), np.abs(other)), np.finfo(float).tiny)
    return float(np.nan_to_num(np.abs(one - other) / scale).max(initial=0.0))


def plausible(rows: Path, suite: str | None = None, times: float = 1.0) -> None:
    """How near to the truth honest rows are: none may be marked as implausible.

        python scripts/stored_rows.py plausible runs/roads                  # a run's folder
        python scripts/stored_rows.py plausible results/roads/trials.parquet --suite roads
        python scripts/stored_rows.py plausible runs/roads --times 0.2      # truth with some noise

    All estimators are judged as if they were plugins. Prints how many rows with noise are judged
    and marked, and, for a run, the least mean of squared distances over those expected: of one row,
    and of a cell of scenario, sensor, noise level and estimator. ``--times`` moves every estimate
    of a run towards the truth: its error becomes this part of what it was.
    """
    if suite:
        whole = load_suite(suite)
        trials, study, draws = pd.read_parquet(rows), played_study([whole]), draws_of(suite, whole)
    else:
        with read_store(rows) as store:
            trials, study, draws = store.frame(), study_in(rows, store), None
    plugins = {
        label: entry.model_copy(update={"name": f"/{label}.py"})
        for label, entry in study.estimators.items()
    }
    study = replace(study, estimators=plugins)
    with travelling(draws):
        ended = trials["status"].isin(["ok", "failed_forward"])
        drawn = trials["scenario"].map(study.has_drawn_truths)
        judged = trials[drawn & (trials["sigma"] > 0) & ended]
        if times != 1.0:
            judged = _moved(judged, study, times)
        marked = implausible(judged, study)
        print(f"{marked.sum()} of {len(judged)} rows are marked, of {len(trials)} in all")
        if "weights" in judged and len(judged):
            _say_distances(judged.assign(marked=marked), study)


def _moved(rows: pd.DataFrame, study: Study, factor: float) -> pd.DataFrame:
    parts = []
    for (scenario, seed), numbers in places_of(rows, ["scenario", "seed"]).items():
        own = rows.iloc[numbers]
        truth = study.scenes.truth(scenario, int(seed)).weights
        weights = truth + factor * (weights_of(own, truth.shape) - truth)
        parts.append(own.assign(weights=pd.Series(weights.tolist(), own.index)))
    return pd.concat(parts)


def _say_distances(rows: pd.DataFrame, study: Study) -> None:
    parts = []
    for (scenario, sensor), own in rows.groupby(["scenario", "sensor"]):
        found = distances_of(own, str(scenario), str(sensor), study)
        numbers = {
            place: (one.whitened, len(one.scales), one.plain, one.scales.sum())
            for place, one in zip(own.index, found, strict=True)
            if one is not None
        }
        names = ["whitened", "free", "plain", "expected"]
        table = pd.DataFrame.from_dict(numbers, orient="index", columns=names)
        parts.append(own[[*LEVEL, "marked"]].join(table, how="inner"))
    whole = pd.concat(parts)
    print(f"{len(whole)} of them are looked at with their truth")
    cells = whole.groupby(LEVEL).agg("sum")
    for name, over in (("whitened", "free"), ("plain", "expected")):
        ratio = cells[name] / cells[over]
        print(
            f"{name}: least of one row {(whole[name] / whole[over]).min():.3g}, least of "
            f"{len(cells)} cells {ratio.min():.3g} in {ratio.idxmin()}"
        )
    number = (cells["marked"] == whole.groupby(LEVEL).size()).sum()
    print(f"{number} of {len(cells)} cells are marked as a whole")


if __name__ == "__main__":
    shared.command(optima, ranks, repeat, plausible)
