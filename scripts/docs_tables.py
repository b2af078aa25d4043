"""Update the tables of README and documentation, and the numbers in sentences, from ``results/``.

    python scripts/docs_tables.py

A table is between the comments ``<!-- table: NAME -->`` and ``<!-- end -->``, and is replaced by
what ``TABLES`` has under that name. ``docs_values.py`` has the numbers.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path

import docs_values
import pandas as pd
from paper_claims import claims_of

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
PAPER = ["two_player", "highway_overtaking"]
PAGES = ("README.md", *(str(page.relative_to(ROOT)) for page in sorted(ROOT.glob("docs/**/*.md"))))
#: Ends the labels of roads whose target speeds nobody tells.
_UNKNOWN = ", unknown speeds"
_TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

#: Heads of columns that their names do not tell.
HEADS = {
    "position_error_median": "Position error [m]", "limit_ratio": "Error / bound", "ms": "ms",
    **{name: name for name in ("posterior", "kkt_constrained", "map", "ridge", "uniform")},
}  # fmt: skip
PLACE = ["scenario", "sensor", "estimator"]


def filled(page: str) -> str:
    """A page with its tables and numbers filled from ``results/``.

    Raises:
        KeyError: on the name of a table or number that does not exist.
    """

    def table(found: re.Match[str]) -> str:
        return f"{found[1]}\n{_markdown(TABLES[found[2]]())}\n\n{found[3]}"

    return docs_values.filled(_TABLE.sub(table, page))


def main() -> None:
    """Rewrite the pages whose tables have changed."""
    for name in PAGES:
        before = (ROOT / name).read_text(encoding="utf-8")
        after = filled(before)
        if after != before:
            (ROOT / name).write_text(after, encoding="utf-8")
            print(f"{name}: tables updated")


# ---------------------------------------------------------------------------------------- results


def _csv(study: str, name: str) -> pd.DataFrame:
    table = pd.read_csv(RESULTS / study / f"{name}.csv")
    return table.rename(columns={"view": "sensor"})  # its name in tables before version 0.1


def _board(study: str) -> pd.DataFrame:
    board = _csv(study, "leaderboard")
    board["ms"] = 1e3 * board["solve_seconds_median"]
    return board.assign(failures=_parts(board))


def _parts(table: pd.DataFrame) -> pd.Series:
    return table["failures"].astype(str) + " of " + table["trials"].astype(str)


def _scores(error: str) -> pd.DataFrame:
    """Scores by an error in the suite ``roads``; those who do not rank have none, floors apart."""
    table = _csv("roads", "scores")
    shown = table["ranked"] | (table["estimator"] == "uniform")
    return table[(table["error"] == error) & shown & table["sigma"].isna()]


# ----------------------------------------------------------------------------------------- tables


def paper() -> pd.DataFrame:
    """Suite ``paper``: median errors, failures and times."""
    board = _board("paper").sort_values("scenario", ascending=False, kind="stable")
    columns = "position_error_median cosine_error_median limit_ratio failures ms"
    return _rows(board, "scenario sensor estimator", columns)


def damage() -> pd.DataFrame:
    """Suite ``misspecified`` on the highway: errors over those of the true model, and coverage."""
    table = pd.read_csv(RESULTS / "misspecified/damage.csv")
    shown = ["map", "robust", "imperfect"]
    table = table[table["estimator"].isin(shown) & (table["of"] == "highway")]
    names = [f"{row.change}&nbsp;{row.dial:g}" for row in table.itertuples()]
    table = table.assign(share=_cells(table, "covers_truth_share"), change=names)
    cells = _pairs(table.round(1), "{}&nbsp;({})", "cosine_error_ratio", "share")
    return _pivot(table, cells, "change")[shown]


def road_scores() -> pd.DataFrame:
    """Suite ``roads``: scores of all roads together, by three errors, and failures."""
    columns = {}
    for head in ("Cosine error", "Held-out error", "Position error"):
        whole = _scores(head.lower().replace("-", "_").replace(" ", "_"))
        whole = whole[whole["scenario"] == "all"].set_index("estimator").sort_values("score")
        columns[head] = pd.Series(_cells(whole, "score[.2f]"), whole.index)
    table = pd.DataFrame(columns | {"Failures": _parts(whole)}).reindex(whole.index)
    return table[["Position error", "Held-out error", "Cosine error", "Failures"]]


def constrained() -> pd.DataFrame:
    """Suite ``constrained``, full sensor: median errors with the constraints and in ignorance."""
    board = _board("constrained")
    shown = _rows(
        board[board["sensor"] == "full"].rename(
            columns={"position_error_median": "position_error"}
        ),
        "scenario estimator",
        "position_error cosine_error_median failures",
    )
    rivals = shown.rename(lambda name: f"{name}, ignorant", axis=1)
    known = shown.index.get_level_values(1).str.endswith(", ignorant")
    rivals = rivals[known].rename(lambda name: name.removesuffix(", ignorant"), level=1)
    both = shown.join(rivals, how="inner")
    return both[[name for one in shown for name in (one, f"{one}, ignorant")]]


def claims() -> pd.DataFrame:
    """The measurements of ``scripts/paper_claims.py``."""
    rows = []
    for claim in claims_of(RESULTS / "paper"):
        allowed = f"{claim.low:g} to {claim.high:g}".replace("-inf to", "at most")
        verdict = "holds" if claim.holds else "**fails**"
        rows.append([verdict, claim.text, f"{claim.value:.4g}", allowed])
    table = pd.DataFrame(rows, columns=["", "Claim", "Measured", "Allowed"])
    return table.set_index(["", "Claim"])


def identified() -> pd.DataFrame:
    """Suite ``calibration``, full view: share of identified weights, and what is left, by noise."""
    table = _csv("calibration", "identifiability_by_noise").query("sensor == 'full'")
    found = table.groupby(["scenario", "sensor", "sigma"])[["identified", "left"]].mean()
    found = found.map("{:.0%}".format).reset_index()
    return _by_level(found, _pairs(found, "{}, {}", "identified", "left"))


def coverage() -> pd.DataFrame:
    """Suite ``calibration``: shares of 95 % regions that hold the truth, over its cells."""
    table = _csv("calibration", "calibration")
    table["held"] = table["covered_95"] * table["trials"]
    found = table.groupby(["scenario", "estimator"], sort=False)[["held", "trials"]].sum()
    found = found[found["held"] > 0].reset_index()
    cells = [
        f"{held / trials:.1%} of {trials:.0f}" for held, trials in found[["held", "trials"]].values
    ]
    return _pivot(found, cells, "scenario")


def learned_errors() -> pd.DataFrame:
    """Means over views and noise levels of what ``learned_error.py`` prints, and their range."""
    rows = {}
    for scenario in PAPER:
        path = RESULTS / "learned" / f"errors_{scenario}.txt"
        table = pd.read_csv(path, sep=r"\s*\|\s*", engine="python")
        shares = [
            f"{_share(table[name].mean())} [{table[name].min():.0%}, {table[name].max():.0%}]"
            for name in ("ellipsoid", "interval")
        ]
        names = ("neural", "posterior", "map", "uniform")
        errors = [_number(table[f"cos {name}"].mean()) for name in names]
        rows[scenario] = [str(table.iloc[0, 0]).split()[-1], *errors, *shares]
    heads = "Draws, neural_posterior, posterior, map, uniform, In 95 % ellipsoid, In 95 % interval"
    found = pd.DataFrame.from_dict(rows, orient="index", columns=heads.split(", "))
    return found.rename_axis("scenario")


def online() -> pd.DataFrame:
    """Median errors of predictions 3 s ahead while samples come in, by road."""
    table = _csv("online", "summary").rename(columns={"scenario": "road"})
    wide = _pivot(table, _cells(table, "fde_3s[]"), "road")
    return wide[["map", "true_weights", "constant_velocity", "stock_fitted"]]


def traffic() -> pd.DataFrame:
    """Rates per vehicle-hour of Nash traffic and, after a slash, IDM's."""
    table = _csv("traffic", "rates").set_index(["road", "kind"])
    crashes = table[["crashes", "low", "high"]].itertuples(index=False)
    table["crashes"] = [f"{middle:.1f} [{low:.1f}, {high:.1f}]" for middle, low, high in crashes]
    names = ["crashes", "near"]
    shown = table[names].map(lambda value: value if isinstance(value, str) else f"{value:.3g}")
    pair = {kind: pd.DataFrame(shown.xs(kind, level="kind")) for kind in ("Nash", "IDM")}
    return pair["Nash"] + " / " + pair["IDM"].loc[pair["Nash"].index]


def people() -> pd.DataFrame:
    """Errors along the lane over those of driving straight on, by road and half."""
    table = _csv("people", "summary").query("ahead == 3 and kind == 'all'")
    methods = ("game", "own weights", "imperfect", "idm", "kernel")
    table = table[table["method"].isin(methods) & table["half"].isin(["both", "second"])]
    ends = table["over_straight_low"], table["over_straight_high"]
    cells = [
        f"{middle:.2f} [{low:.2f}, {high:.2f}]"
        for middle, low, high in zip(table["over_straight"], *ends, strict=True)
    ]
    half = table["half"].map({"both": "", "second": " of the second half"})
    count = table["cars"].astype(str) + " cars" + half
    table = table.assign(place=table["road"] + ", " + count)
    return _pivot(table, cells, "place", "method")


def encounters() -> pd.DataFrame:
    """Suite ``encounters``: regret in hundredths, and collisions, by the value of information."""
    table = _csv("encounters", "quarters")
    regret = table[["regret", "regret_low", "regret_high"]].mul(100)
    table[regret.columns] = regret.where(regret.abs() > 1e-9, 0.0)
    hits = table["collisions"].astype(str) + " of " + table["drives"].astype(str)
    cells = [f"{own}, {hit}" for own, hit in zip(_cells(table, "regret[.2f]"), hits, strict=True)]
    shown = _pivot(table, cells, "planner", "quarter")[["4"]].drop(index=["ppo", "stock"])
    return shown.set_axis(["Quarter 4, most value"], axis=1)


TABLES: dict[str, Callable[[], pd.DataFrame]] = {
    table.__name__: table
    for table in (
        paper, damage, road_scores, constrained, claims, coverage, identified,
        learned_errors, online, people, traffic, encounters,
    )
}  # fmt: skip


# ------------------------------------------------------------------------------------------ cells


def _rows(table: pd.DataFrame, labels: str, columns: str) -> pd.DataFrame:
    """A line for each row: columns as text, behind the labels."""
    cells = {name.partition("[")[0]: _cells(table, name) for name in columns.split()}
    shown = pd.DataFrame(cells, pd.MultiIndex.from_frame(table[labels.split()]))
    return shown.rename(columns=_head)


def _pivot(
    table: pd.DataFrame, cells: list[str], index: str | list[str], columns: str = "estimator"
) -> pd.DataFrame:
    """One cell of each row, by labels in the order of the table."""
    told = table.assign(cell=cells)
    return told.pivot_table("cell", index, columns, aggfunc="first", sort=False)


def _by_level(table: pd.DataFrame, cells: list[str]) -> pd.DataFrame:
    """A row for each scenario, sensor and perhaps estimator, a column for each noise level.

    Scenarios have noise levels of their own, which are named with them.
    """
    keys = [key for key in PLACE if key in table]
    levels = table.groupby("scenario")["sigma"].unique().map(sorted)
    places = [
        levels[name].index(sigma)
        for name, sigma in zip(table["scenario"], table["sigma"], strict=True)
    ]
    noise = {name: ", ".join(f"{sigma:g}" for sigma in own) for name, own in levels.items()}
    told = table["scenario"].map(lambda name: f"{name}: {noise[name]} m")
    wide = _pivot(table.assign(scenario=told, level=places), cells, keys, "level")
    heads = ["Least noise", *(["More"] * (wide.shape[1] - 2)), "Most"][: wide.shape[1]]
    return wide.sort_index(axis=1).fillna("–").set_axis(heads, axis=1)


def _markdown(table: pd.DataFrame) -> str:
    """A table of texts; labels stand on the left."""
    labels, rows = table.index.nlevels, table.reset_index().astype(str).to_numpy()
    heads = [_head(str(name)) for name in table.index.names] + list(map(str, table.columns))
    rule = ["---" if k < labels else "---:" for k in range(len(heads))]
    cells = [[cell.replace("_", r"\_") for cell in row] for row in (heads, *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (cells[0], rule, *cells[1:]))


def _head(name: str) -> str:
    usual = name.removesuffix("_median").replace("_", " ")
    return HEADS.get(name, usual[:1].upper() + usual[1:])


def _pairs(table: pd.DataFrame, form: str, *names: str) -> list[str]:
    """Several columns in one text."""
    columns = [_cells(table, name) for name in names]
    return [form.format(*row) for row in zip(*columns, strict=True)]


def _cells(table: pd.DataFrame, name: str) -> list[str]:
    """A column as texts; with ``[]``, or a format in it, intervals as well."""
    name, _, form = name.partition("[")
    if form:
        show = _number if form == "]" else f"{{:{form[:-1]}}}".format
        ends = zip(*(table[f"{name}{end}"] for end in ("", "_low", "_high")), strict=True)
        return [
            show(value) + ("" if math.isnan(low) else f" [{show(low)}, {show(high)}]")
            for value, low, high in ends
        ]
    show = _share if name.endswith("_share") else _chance if name[:2] == "p_" else _number
    return [value if isinstance(value, str) else show(value) for value in table[name]]


def _chance(value: float) -> str:
    if math.isnan(value):
        return "–"
    return "< 0.001" if value < 0.001 else f"{value:.2g}"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.0%}"


def _number(value: float) -> str:
    if math.isnan(value) or math.isinf(value):
        return "–" if math.isnan(value) else "∞"
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.0f}" if abs(value) >= 99.5 else f"{float(f'{value:.2g}'):g}"


if __name__ == "__main__":
    main()
