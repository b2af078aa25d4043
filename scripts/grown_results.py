"""Put scenarios of a study that were run again in the place of those that are kept."""

from pathlib import Path

import shared  # noqa: F401  one thread
import pandas as pd

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures import forest, style
from olne_bench.bench.report.leaderboard import scored_rows
from olne_bench.bench.report.leaderboard_text import markdown
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.report.statistics.score import ALL, log_errors, pair_table, score_table
from olne_bench.bench.report.study import in_leaderboard, study_of
from olne_bench.bench.report.write import write_text


def grown(new: pd.DataFrame, kept: Path, key: list[str]) -> pd.DataFrame:
    """The rows of a kept table with those of the same key replaced, sorted by the key."""
    if not kept.exists():
        return new
    old = pd.read_parquet(kept) if kept.suffix == ".parquet" else pd.read_csv(kept)
    if new.empty:
        return old
    ran = pd.MultiIndex.from_frame(new[key])
    left = old[~pd.MultiIndex.from_frame(old[key]).isin(ran)]
    return pd.concat([new, left]).sort_values(key, kind="stable", ignore_index=True)


def grow_boards(run: Path, out: Path, rows: pd.DataFrame) -> None:
    """Write the boards of a study of which some scenarios were run again.

    What a scenario's rows alone determine is that of the run, or what was kept. Scores and pairs
    are computed from ``rows``, all trials with the columns that are kept; by other errors there are
    scores of single scenarios only.
    """
    study = study_of([load_suite(run.name)])
    logs = log_errors(weighed(rows), study)
    scores = score_table(logs, study)
    before = grown(pd.read_csv(run / "scores.csv"), out / "scores.csv", ["scenario"])
    lacking = ~before["error"].isin(scores["error"]) & (before["scenario"] != ALL)
    scores = pd.concat([scores, before[lacking]], ignore_index=True)
    tables = {
        name: grown(pd.read_csv(run / f"{name}.csv"), out / f"{name}.csv", ["scenario"])
        for name in ("leaderboard", "errors_by_noise")
    }
    board = tables["leaderboard"]
    board = board.drop(columns=board.filter(regex=r"_score(_low|_high)?$").columns)
    metrics = in_leaderboard(study.metrics, board)
    tables["leaderboard"] = scored_rows(board, metrics, scores, study)
    tables |= {"scores": scores, "comparisons": pair_table(logs, study)}
    for name, table in tables.items():
        if (out / f"{name}.csv").exists():
            write_csv(table, out / f"{name}.csv")
    write_text(out / "leaderboard.md", markdown(tables["leaderboard"], study))
    with style.applied():
        style.save(forest.draw(scores, study), out / "figures/scores", ["png"])
