"""Copy what the repository keeps of the studies that were run: tables, some figures, small pages.

    python scripts/keep_results.py runs

A study that was not run stays as it is in ``results/``; so do scenarios of large studies that were
not run. Their trials are kept small: who was run where, by which code, what became of it, and main
errors, in single precision; anybody gets the rest from the same draws with the same command.
Figures have 256 colours, a third of their bytes. Exit code 1 if ``results/`` has more than 15 MB.
"""

import gzip
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import shared
import pandas as pd
import pyarrow as pa
from grown_results import grow_boards, grown
from PIL import Image
from pyarrow import parquet
from stale_results import remember, versions_in
from truth_ahead import FEWEST

import olne_bench as ob
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.figures.damage import draw as draw_damage
from olne_bench.bench.run.store_table import parquet_options

RESULTS = Path(__file__).parents[1] / "results"
TABLES = ("leaderboard.csv", "leaderboard.md", "scores.csv", "errors_by_noise.csv")
#: Figures of each study. Pictures of unknown speeds are left out, for size.
FIGURES = {
    "paper": ("*.png",),
    "roads": ("errors_*.png", "trial_*.png", "confusion_*.png", "scores.png"),
    **dict.fromkeys(("field", "sensors", "parameters", "constrained"), ("errors_*.png",)),
    "calibration": ("calibration_*.png", "widths_*.png", "identifiability_*.png"),
}
DRAWN = ("map", "robust", "imperfect")
WORLD = ["of", "change", "dial", "estimator"]
WITH_DISCS = (*DRAWN, "posterior", "uniform")
SMALL = ("roads", "parameters", "constrained")
LABELS = ["scenario", "sensor", "sigma", "seed", "salt_id", "estimator", "count", "status"]
NUMBERS = ["position_error", "held_out_error", "cosine_error", "parameter_error", "solve_seconds"]
SHARES = ["covers_truth"]
PAGE, ALL = 700_000, 15_000_000  # [bytes] at most


def main(runs: Path) -> int:
    """Copy, and say how large it is."""
    runs = runs.resolve()
    for name, keeper in KEEPERS.items():
        if (runs / name).is_dir():
            call("-m", "olne_bench", "report", runs / name)
            keeper(runs / name, RESULTS / name)
    if parts := sorted(runs.glob("misspecified*")):
        keep_damage(parts, RESULTS / "misspecified")
    call("scripts/docs_tables.py")
    call("scripts/dataset.py", "write")
    size = sum(path.stat().st_size for path in RESULTS.rglob("*") if path.is_file())
    print(f"results: {size / 1e6:.1f} MB of at most {ALL / 1e6:.0f}")
    return int(size > ALL)


def keep_trials(run: Path, out: Path) -> None:
    """Copy a study of trials."""
    shutil.rmtree(out, ignore_errors=True)
    copy(run, out, *TABLES, "trials.parquet")
    if (run / "index.html").exists() and (run / "index.html").stat().st_size < PAGE:
        copy(run, out, "index.html")
    keep_figures(run, out)
    record(run.name, run)


def keep_figures(run: Path, out: Path) -> None:
    """Copy the figures that are kept of a study."""
    copy(run / "figures", out / "figures", *FIGURES[run.name])
    for path in (out / "figures").glob("*, unknown speeds.png"):
        path.unlink()
    fewer_colours(out)


def keep_calibration(run: Path, out: Path) -> None:
    """Copy tables without trials, which are too many, to a folder that has other results, too."""
    copy(run, out, "leaderboard.csv", "leaderboard.md")
    copy(run, out, "calibration.csv", "identifiability_by_noise.csv")
    record(run.name, run)
    call("scripts/known_cells.py", run)
    call("scripts/two_modes.py")
    keep_figures(run, out)


def keep_several(run: Path, out: Path) -> None:
    """Keep how errors fall with the number of trajectories."""
    out = out.with_name("several_trajectories")
    call("scripts/several_trajectories.py", run)
    fewer_colours(out)
    record(out.name, run)


def keep_streams(run: Path, out: Path) -> None:
    """Copy the tables of a study of streams."""
    copy(run, out, "summary.csv", "over_time.csv", "comparisons.csv")
    record(run.name, run)


def keep_small(run: Path, out: Path) -> None:
    """Copy a large study, or put the scenarios of a part of it in the place of kept ones."""
    new = fewer_columns(run / "trials.parquet")
    rows = grown(new, out / "trials.parquet", ["scenario"])
    rows = rows.fillna(dict.fromkeys(VERSION_COLUMNS, "earlier"))
    if set(rows["scenario"]) > set(new["scenario"]):
        grow_boards(run, out, rows)
    else:
        shutil.rmtree(out, ignore_errors=True)
        copy(run, out, *TABLES, *["comparisons.csv"] * (run.name == "roads"))
    store(rows, out / "trials.parquet")
    if (run / "temperaments.csv").exists():
        kept = out / "temperaments.csv.gz"
        text = grown(pd.read_csv(run / "temperaments.csv"), kept, ["scenario"]).to_csv(index=False)
        kept.write_bytes(gzip.compress(text.encode(), mtime=0))
    keep_figures(run, out)
    remember(run.name, versions_in(rows))


def keep_learned(run: Path, out: Path) -> None:
    """Keep what networks are worth, of trials in ``run`` and of streams in ``learned_online``."""
    online = run.with_name("learned_online")
    call("-m", "olne_bench", "report", online)
    copy(run, out, "leaderboard.csv")
    shutil.copy(online / "summary.csv", out / "online_summary.csv")
    shutil.copy(online / "figures/online_two_player, wide_full.png", out / "online_two_player.png")
    fewer_colours(out)
    record("learned", run, online)


def keep_encounters(run: Path, out: Path) -> None:
    """Copy a study of encounters, its drives as Parquet."""
    copy(run, out, "quarters.csv", "summary.csv", "tests.csv")
    store(pd.read_csv(run / "episodes.csv"), out / "episodes.parquet")
    copy(run / "figures", out, "regret_by_value.png")
    fewer_colours(out)
    record("encounters", run)


def keep_drives(run: Path, out: Path) -> None:
    """Put the drives of one traffic in the place of those that are kept of it."""
    out = out.with_name("driving")
    drives = grown(pd.read_csv(run / "episodes.csv"), out / "episodes.parquet", ["traffic"])
    store(drives, out / "episodes.parquet")
    summary = grown(pd.read_csv(run / "summary.csv"), out / "summary.csv", ["traffic"])
    summary.to_csv(out / "summary.csv", index=False)
    if run.name == "driving":  # that of stock traffic has no contrasts
        copy(run, out, "tests.csv")
    copy(run / "figures", out, "driving_*.png")
    fewer_colours(out)
    record(run.name, run)


def keep_damage(parts: list[Path], out: Path) -> None:
    """Keep what wrong models cost, from runs of parts of the suite; pictures of a few methods."""
    out.mkdir(exist_ok=True)
    made = [_damage_of(run) for run in parts]
    damage, discs, code = (pd.concat(tables) for tables in zip(*made, strict=True))
    discs = discs[discs["estimator"].isin(WITH_DISCS)]
    damage = grown(damage, out / "damage.csv", WORLD)
    damage.to_csv(out / "damage.csv", index=False, float_format="%.4g")
    discs = grown(discs, out / "conformal.csv", ["scenario", "estimator"])
    discs.to_csv(out / "conformal.csv", index=False, float_format="%.4g")
    code = grown(code, out / "code.parquet", ["scenario", "estimator"])
    code.to_parquet(out / "code.parquet", index=False)
    for scenario, own in damage[damage["estimator"].isin(DRAWN)].groupby("of"):
        with style.applied():
            style.save(draw_damage(own), out / f"damage_{scenario}.png", ["png"])
    fewer_colours(out)
    call("scripts/truth_ahead.py", *parts)
    remember("misspecified", versions_in(code))


def _damage_of(run: Path) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Damage and regions in the finished worlds of a run, and the code that made them."""
    call("-m", "olne_bench", "report", run, "--no-figures")
    damage, discs = pd.read_csv(run / "damage.csv"), pd.read_csv(run / "conformal.csv")
    rows = ob.read(run).trials
    draws = rows.groupby(["scenario", "estimator"])["seed"].transform("nunique")
    code = rows.loc[draws >= FEWEST, ["scenario", "sensor", "estimator", *VERSION_COLUMNS]]
    return (
        damage.query(f"trials >= {FEWEST}"),
        discs.query(f"draws >= {FEWEST}"),
        code.drop_duplicates(),
    )


def copy(run: Path, out: Path, *patterns: str) -> None:
    """Copy the files of a folder that are named so."""
    for pattern in patterns:
        for path in run.glob(pattern):
            out.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, out)


def record(study: str, *runs: Path) -> None:
    """Note by which code the rows of a study were made."""
    call("scripts/stale_results.py", "--record", study, "--run", *runs)


def call(*words: str | Path) -> None:
    """Run a script or a module of this project."""
    subprocess.run([sys.executable, *map(str, words)], check=True, cwd=RESULTS.parent)


def store(rows: pd.DataFrame, path: Path) -> None:
    """Write a table as small Parquet."""
    table = pa.Table.from_pandas(rows, preserve_index=False)
    parquet.write_table(table, path, **parquet_options(table.schema))


def fewer_columns(trials: Path) -> pd.DataFrame:
    """The trials that are kept of a large study."""
    known = parquet.read_schema(trials).names
    kept = [name for name in (*LABELS, *NUMBERS, *SHARES, *VERSION_COLUMNS) if name in known]
    rows = pd.read_parquet(trials, columns=kept)
    return rows.astype({name: "float32" for name in NUMBERS if name in kept})


def fewer_colours(folder: Path) -> None:
    """Store figures that have more colours with 256."""
    for path in sorted(folder.rglob("*.png")):
        with Image.open(path) as image:
            if image.mode != "P":
                few = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
                few.save(path, optimize=True)


#: What keeps a run, by the name of its folder.
KEEPERS: dict[str, Callable[[Path, Path], None]] = {
    **dict.fromkeys(("paper", "field", "sensors"), keep_trials),
    **dict.fromkeys(SMALL, keep_small),
    "calibration": keep_calibration,
    "several": keep_several,
    "learned": keep_learned,
    "encounters": keep_encounters,
    **dict.fromkeys(("driving", "driving_stock"), keep_drives),
    **dict.fromkeys(("online", "predictions"), keep_streams),
}


if __name__ == "__main__":
    shared.command(main)
