"""How often ``olne-bench verify`` finds forged rows, and how often it refuses honest ones.

    python scripts/verify_power.py
    python scripts/verify_power.py --real

Forgeries are made in stored rows of ``results/``: a forged row is found where ``verify`` would run
it again. One estimator of the study stands for the plugin, all others for its rivals. Fresh trials
are stored ones, too: of seeds that are left out of the submission. With ``--real``, the example in
``results/submissions`` is forged in each way, and verified by running its trials.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet
from scipy.stats import binomtest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.report.statistics.plausibility import implausible
from olne_bench.bench.report.study import Study, study_of
from olne_bench.bench.run.store_table import to_frame
from olne_bench.bench.submission.boards import board_files
from olne_bench.bench.submission.choose import choose
from olne_bench.bench.submission.files import digest
from olne_bench.bench.submission.fresh import (
    FIRST,
    LEVEL,
    SECOND,
    SUSPICIOUS,
    compare_fresh,
    fresh_trials,
    has_truth,
)
from olne_bench.bench.submission.manifest import MANIFEST, PLUGINS, ROWS, read_submission
from olne_bench.bench.submission.parquet_rows import read_parquet
from olne_bench.bench.submission.played import played_study
from olne_bench.bench.submission.rows import Rows

METRIC = declare(PositionError)
EXAMPLE = Path("results/submissions/tempered_residual")
PERFECT = 1e-12  # [m]
#: Tables of studies, the estimator that stands for the plugin, and the rivals that it is sent with.
CASES = {
    "paper": ("kkt_residual", ("kkt_constrained", "uniform")),
    "roads": ("map", ("kkt_constrained", "kkt_residual", "uniform")),
}

SEEDS = (2, 20)  # noise draws of a submission

Forge = Callable[[pd.DataFrame, float, np.random.Generator], pd.Index]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=400, help="forgeries of each kind")
    parser.add_argument("--honest", type=int, default=2500, help="honest submissions of each kind")
    parser.add_argument("--real", action="store_true", help="forge and verify the example")
    arguments = parser.parse_args()
    rng = np.random.default_rng(0)
    if arguments.real:
        real(rng)
        return
    forged_rows(arguments.times, rng)
    fresh_salts(arguments.times, arguments.honest)


def forged_rows(times: int, rng: np.random.Generator) -> None:
    """Forge rows in each way."""
    print("Forged rows: share of submissions in which one is run again")
    for suite, (plugin, rivals) in CASES.items():
        table = rows_of(suite, (plugin, *rivals))
        for seeds in SEEDS:
            part = table[table["seed"] < seeds].reset_index(drop=True)
            for name, forge in FORGERIES.items():
                for share in (0.05, 0.01):
                    found, rows = found_rows(part, plugin, forge, share, times, rng)
                    if rows > 1:
                        what = (
                            f"{suite}, {seeds} seeds: {name}, {share:.0%} ({rows} of {len(part)})"
                        )
                        say(what, found, times)


def fresh_salts(usual: int, number_of_honest: int) -> None:
    """Submit honest rows, and rows of those who know some of the noise."""
    print("\nFresh salts: share of submissions that are refused")
    total = 0
    for suite, (plugin, _) in CASES.items():
        rng = np.random.default_rng(1)  # a suite alone repeats its part
        for seeds in SEEDS:
            for known in (0.0, 0.01, 0.1, 1.0):
                times = usual // 4 if known else number_of_honest
                second, refused = refused_rows(suite, plugin, seeds, known, times, rng)
                kind = f"knows {known:.0%} of the noise" if known else "honest"
                say(f"{suite}, {seeds} seeds: {kind}", refused, times)
                if not known:
                    say(f"{suite}, {seeds} seeds: honest, asked for a second test", second, times)
                    total += refused
    number = number_of_honest * len(CASES) * len(SEEDS)
    say(f"honest, all {number}", total, number)


def say(what: str, hits: int, times: int) -> None:
    """A share with its 95 % interval."""
    low, high = binomtest(hits, times).proportion_ci(0.95, "exact")
    print(f"{what:<76} {hits / times:7.2%}  [{low:.2%}, {high:.2%}]", flush=True)


def rows_of(suite: str, estimators: tuple[str, ...]) -> pd.DataFrame:
    """Stored rows of some estimators."""
    table = pd.read_parquet(f"results/{suite}/trials.parquet")
    if "observation_error" not in table:  # some studies keep fewer columns
        table["observation_error"] = np.where(table["status"] == "skipped", np.nan, 0.0)
    return table[table["estimator"].isin(estimators)].reset_index(drop=True)


# What liars do. Each function changes rows in place, and returns which.


def worst_perfect(table: pd.DataFrame, share: float, _: np.random.Generator) -> pd.Index:
    """The worst rows of the plugin have no error."""
    own = attempts(table)
    order = own["position_error"].fillna(np.inf).sort_values(ascending=False).index
    chosen = order[: count(share, len(own))]
    return _set(table, chosen, PERFECT)


def better(table: pd.DataFrame, share: float, rng: np.random.Generator) -> pd.Index:
    """Random rows of the plugin are 20 % better."""
    own = attempts(table)
    chosen = drawn(own, share, rng)
    return _set(table, chosen, table.loc[chosen, "position_error"] * 0.8)


def repaired(table: pd.DataFrame, share: float, rng: np.random.Generator) -> pd.Index:
    """Failures of the plugin are ok, with usual errors."""
    own = attempts(table)
    failed = own.index[own["status"] != "ok"]
    if len(failed) < count(share, len(own)):
        return failed[:0]
    chosen = pd.Index(rng.choice(failed, count(share, len(own)), replace=False))
    return _set(table, chosen, own["position_error"].median())


def rivals_worse(table: pd.DataFrame, share: float, rng: np.random.Generator) -> pd.Index:
    """Random rows of rivals are 5 m worse."""
    chosen = drawn(attempts(table, own=False), share, rng)
    return _set(table, chosen, table.loc[chosen, "position_error"] + 5.0)


def rivals_slightly_worse(table: pd.DataFrame, share: float, rng: np.random.Generator) -> pd.Index:
    """Random rows of rivals are 20 % worse."""
    chosen = drawn(attempts(table, own=False), share, rng)
    return _set(table, chosen, table.loc[chosen, "position_error"] * 1.2)


FORGERIES: dict[str, Forge] = {
    "the plugin's worst rows perfect": worst_perfect,
    "random rows 20 % better": better,
    "failures turned into ok": repaired,
    "rivals' rows 5 m worse": rivals_worse,
    "rivals' rows 20 % worse": rivals_slightly_worse,
}


def count(share: float, rows: int) -> int:
    """Number of rows that are a share of so many."""
    return int(np.ceil(share * rows))


def attempts(table: pd.DataFrame, *, own: bool = True) -> pd.DataFrame:
    """Rows of the plugin, or of rivals, that were not skipped."""
    return table[(table["own"] == own) & table["status"].ne("skipped")]


def drawn(rows: pd.DataFrame, share: float, rng: np.random.Generator) -> pd.Index:
    """A random share of rows, out of those that have errors."""
    places = rows.index[rows["position_error"].notna()]
    chosen = rng.choice(places, min(count(share, len(rows)), len(places)), replace=False)
    found: pd.Index = pd.Index(chosen)
    return found


def _set(table: pd.DataFrame, chosen: pd.Index, error: Any) -> pd.Index:
    table.loc[chosen, "position_error"] = error
    table.loc[chosen, "status"] = "ok"
    return chosen


def found_rows(
    table: pd.DataFrame, plugin: str, forge: Forge, share: float, times: int, rng: Any
) -> tuple[int, int]:
    """How often a forged row is run again, and how many are forged each time."""
    table = table.assign(own=table["estimator"] == plugin)
    labels = np.where(table["own"], plugin, "")
    planned: Any = {(str(k),): SimpleNamespace(plugin=p, k=k) for k, p in enumerate(labels)}
    places: dict[tuple[str, ...], int] = {(str(k),): k for k in range(len(table))}
    found = forged = 0
    for _ in range(times):
        lie = table.copy()
        changed = set(forge(lie, share, rng))
        forged = len(changed)
        if not changed:
            return 0, 0
        again: Any = choose(planned, Rows(lie, None, places), METRIC, None, rng)
        found += any(trial.k in changed for trial in again)
    return found, forged


@dataclass(frozen=True)
class Honest:
    """Trials and rows of an estimator, to be split into submitted and fresh ones."""

    trials: list[Trial]
    rows: pd.DataFrame
    families: list[str]
    study: Study

    @classmethod
    def of(cls, suite: str, estimator: str) -> "Honest":
        """Those of a study."""
        rows = rows_of(suite, (estimator,))
        known = set(zip(*(rows[n] for n in ("scenario", "sensor", "sigma", "seed")), strict=True))
        whole = load_suite(suite)
        trials = [
            t
            for t in expand(whole)
            if t.estimator.label == estimator
            and (t.scenario.label, t.sensor.label, t.sigma, t.seed) in known
        ]
        families = [s.label for s in whole.scenarios if s.family]
        return cls(
            trials, rows.drop(columns="weights", errors="ignore"), families, study_of([whole])
        )


def refused_rows(
    suite: str, estimator: str, seeds: int, known: float, times: int, rng: np.random.Generator
) -> tuple[int, int]:
    """How often the second test is needed, and how often it refuses."""
    honest = Honest.of(suite, estimator)
    needed = refused = 0
    most = honest.rows.groupby("scenario")["seed"].max() + 1
    for _ in range(times):
        table = honest.rows.copy()
        for name, rows in honest.rows.groupby("scenario")["seed"]:
            table.loc[rows.index, "seed"] = rng.permutation(int(most[name]))[rows]
        submitted = table[table["seed"] < seeds].copy()
        _learn_by_heart(submitted, known, rng)
        trials = _of_rows(honest.trials, submitted[has_truth(submitted)])
        if implausible(submitted, honest.study).any():
            refused += 1
            continue
        others = table[table["seed"] >= seeds]
        for number, level in ((FIRST, SUSPICIOUS), (SECOND, LEVEL)):
            fresh = _played(fresh_trials(trials, number, level, rng), others, seeds)
            accepted = compare_fresh(submitted, fresh, METRIC, honest.families, level).accepted
            if accepted:
                break
            needed += level == SUSPICIOUS
        refused += not accepted
    return needed, refused


def _learn_by_heart(rows: pd.DataFrame, known: float, rng: np.random.Generator) -> None:
    chosen = rng.random(len(rows)) < known
    errors = ["position_error", "cosine_error"]
    rows.loc[chosen & rows["status"].ne("skipped"), errors] = PERFECT, 0.0


def _of_rows(trials: list[Trial], rows: pd.DataFrame) -> list[Trial]:
    """A trial for each row: seeds are permuted, so any of its cell does."""
    cells = {(t.scenario.label, t.sensor.label, t.sigma): t for t in trials}
    places = zip(rows["scenario"], rows["sensor"], rows["sigma"], rows["seed"], strict=True)
    return [replace(cells[(a, b, c)], seed=int(seed)) for a, b, c, seed in places]


def _played(trials: list[Trial], others: pd.DataFrame, first: int) -> pd.DataFrame:
    """Stored rows of other seeds for fresh trials: one seed for each draw."""
    labels = [others[name] for name in ("scenario", "sensor", "sigma", "seed")]
    places = {key: k for k, key in enumerate(zip(*labels, strict=True))}
    seeds: dict[tuple[str, float], dict[tuple[str, int], int]] = {}
    chosen = []
    for trial in trials:
        level = -1.0 if trial.scenario.family else trial.sigma
        units = seeds.setdefault((trial.scenario.label, level), {})
        unit = units.setdefault((trial.salt, trial.seed), first + len(units))
        chosen.append(places[(trial.scenario.label, trial.sensor.label, trial.sigma, unit)])
    return others.iloc[chosen].assign(salt_id="fresh")


# Real runs.


def real(rng: np.random.Generator) -> None:
    """Forge the example in each way, and verify it."""
    print("Real runs of the example: exit code of olne-bench verify (0 accepted, 1 or 2 refused)")
    own = read_submission(EXAMPLE).name
    kinds: dict[str, Forge | None] = {"honest": None} | FORGERIES
    for name, forge in kinds.items():
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "submission"
            shutil.copytree(EXAMPLE, folder)
            if forge is not None and not _forged(folder, own, forge, rng):
                continue
            command = [sys.executable, "-m", "olne_bench", "verify", str(folder), "--seed", "0"]
            ended = subprocess.run(command, capture_output=True, text=True)
            said = (ended.stdout + ended.stderr).strip().splitlines()
            told = [line.strip() for line in said if line.strip().startswith("DIFFERS")]
            print(f"{name}: {ended.returncode}  {(told or said)[-1][:120]}", flush=True)


def _forged(folder: Path, own: str, forge: Forge, rng: np.random.Generator) -> int:
    """Forge 5 % of the rows of a submission, and its tables and manifest; the number of rows."""
    arrow = read_parquet((folder / ROWS).read_bytes(), folder)
    frame = to_frame(arrow)
    lie = frame.assign(own=frame["estimator"] == own)
    changed = forge(lie, 0.05, rng)
    for name in ("status", "position_error"):
        column = pa.array(lie[name], type=arrow.schema.field(name).type, from_pandas=True)
        arrow = arrow.set_column(arrow.schema.get_field_index(name), name, column)
    parquet.write_table(arrow, folder / ROWS)
    suites = read_submission(EXAMPLE).suites(folder / PLUGINS)
    for name, text in board_files(to_frame(arrow), played_study(suites)).items():
        (folder / name).write_text(text, encoding="utf-8", newline="")
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["files"] = {name: digest((folder / name).read_bytes()) for name in manifest["files"]}
    (folder / MANIFEST).write_text(json.dumps(manifest))
    return len(changed)


if __name__ == "__main__":
    main()
