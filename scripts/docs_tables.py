"""Write the tables of README and documentation anew from ``results/``.

    python scripts/docs_tables.py

A table stands between the comments ``<!-- table: NAME -->`` and ``<!-- end -->``. What is between
them is replaced. ``TABLES`` has the names.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
from paper_claims import claims_of, line

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
PAGES = ("README.md", "docs/study.md")
_TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(page: str) -> str:
    """A page with its tables as ``results/`` has them.

    Raises:
        KeyError: on the name of a table that does not exist.
    """
    return _TABLE.sub(lambda found: f"{found[1]}\n{TABLES[found[2]]()}\n\n{found[3]}", page)


def paper() -> str:
    """The paper's two scenarios: one row per estimator, best first."""
    board = _leaderboard("paper").sort_values(
        ["scenario", "sensor", "position_error_median"], ascending=[False, True, True]
    )
    rows = [
        [
            row["scenario"],
            row["sensor"],
            row["estimator"],
            _number(row["position_error_median"]),
            _number(row["cosine_error_median"]),
            _number(row["limit_ratio"]),
            f"{row['failures']} of {row['trials']}",
            _number(1e3 * row["solve_seconds_median"]),
        ]
        for row in board.to_dict("records")
    ]
    heads = (
        "Scenario, Sensor, Estimator, Position error [m], Cosine error, Error / bound, Failures, ms"
    )
    return _markdown(heads.split(", "), rows, left=3)


def field() -> str:
    """Median position error [m] of every estimator in every scenario, all seen."""
    board = _leaderboard("field")
    wide = board[board["sensor"] == "full"].pivot_table(
        "position_error_median", "estimator", "scenario"
    )
    rows = [[name, *map(_number, values)] for name, *values in wide.itertuples()]
    return _markdown(["Estimator", *wide.columns], rows, left=1)


def claims() -> str:
    """What ``scripts/paper_claims.py`` prints."""
    lines = [line(claim) for claim in claims_of(RESULTS / "paper")]
    return "\n".join(["```text", *lines, "```"])


TABLES: dict[str, Callable[[], str]] = {"paper": paper, "field": field, "claims": claims}


def _leaderboard(name: str) -> pd.DataFrame:
    table = pd.read_csv(RESULTS / name / "leaderboard.csv")
    return table.rename(columns={"view": "sensor"})  # as tables before version 0.1 call it


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.0f}" if abs(value) >= 99.5 else f"{float(f'{value:.2g}'):g}"


def _markdown(heads: list[str], rows: list[list[str]], left: int) -> str:
    rule = ["---" if k < left else "---:" for k in range(len(heads))]
    cells = [[cell.replace("_", r"\_") for cell in row] for row in (heads, *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (cells[0], rule, *cells[1:]))


def main() -> None:
    """Rewrite the pages whose tables have changed."""
    for name in PAGES:
        path = ROOT / name
        before = path.read_text(encoding="utf-8")
        after = filled(before)
        if after != before:
            path.write_text(after, encoding="utf-8")
            print(f"{name}: tables written anew")


if __name__ == "__main__":
    main()
