"""Update the tables of README and documentation from ``results/``.

    python scripts/docs_tables.py

A table is between the comments ``<!-- table: NAME -->`` and ``<!-- end -->``, and is replaced by
what the function of that name returns.
"""

import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from paper_claims import claims_of
from scipy.stats import binomtest

from olne_bench.bench.report.figures.style import estimator_order
from olne_bench.envs.roads.temperaments import TEMPERAMENTS

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
PAPER = ["two_player", "highway_overtaking"]
_NAMES = "estimators highway unknowns constraints calibration learned online driving"
PAGES = (
    "README.md",
    "docs/study.md",
    *(f"docs/evidence/{name}.md" for name in _NAMES.split()),
)
#: Ends the labels of roads whose target speeds nobody tells.
_UNKNOWN = ", unknown speeds"
_TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Row = dict[Any, Any]
#: Heads of a table, and what is below each: a column, or a text of a row.
Columns = dict[str, str | Callable[[Row], str]]

_PLACE: Columns = {"Scenario": "scenario", "Sensor": "sensor", "Estimator": "estimator"}
_FAILURES: Columns = {"Failures": lambda row: f"{row['failures']} of {row['trials']}"}
_END: Columns = _FAILURES | {"ms": lambda row: _number(1e3 * row["solve_seconds_median"])}
_SCORE: Columns = {"Score": lambda row: _number(row["score"])}
_POSITION: Columns = {"Position error [m]": "position_error_median"}
_COSINE: Columns = {"Cosine error": "cosine_error_median"}
_COVERED: Columns = {"Covered": "covers_truth_share"}


def filled(page: str) -> str:
    """A page with its tables filled from ``results/``.

    Raises:
        KeyError: on the name of a table that does not exist.
    """
    return _TABLE.sub(lambda found: f"{found[1]}\n{TABLES[found[2]]()}\n\n{found[3]}", page)


def paper() -> str:
    """The paper's two scenarios: one row per estimator, best first."""
    board = _board("paper").sort_values(
        ["scenario", "sensor", "position_error_median"], ascending=[False, True, True]
    )
    return _table(board, _PLACE | _POSITION | _COSINE | {"Error / bound": "limit_ratio"} | _END)


def times() -> str:
    """Median time [ms] of one estimate: the paper's scenarios, and the median of the roads."""
    board = _board("field")
    board["where"] = board["scenario"].where(board["scenario"].isin(PAPER), "roads")
    board["ms"] = 1e3 * board["solve_seconds_median"]
    wide = board.pivot_table("ms", "estimator", "where", "median")[[*PAPER, "roads"]]
    return _wide(["Estimator"], wide.map(_number))


def coverage() -> str:
    """Share of 95 % ellipsoids that hold the truth, by noise level."""
    trials = pd.read_parquet(RESULTS / "paper" / "trials.parquet")
    trials = trials[trials["sigma"].isin([0.001, 0.005, 0.01, 0.02, 0.05, 0.1])]
    by = ["scenario", "sensor", "estimator"]
    wide = trials.dropna(subset="covers_truth").pivot_table("covers_truth", by, "sigma")
    return _wide(list(_PLACE), wide.map("{:.0%}".format).rename(columns="{:g} m".format))


def exponents() -> str:
    """Exponents, with 95 % intervals, of the decrease of errors with the number of trajectories."""
    table = _csv("several_trajectories", "exponents")
    bounds = table[["exponent", "exponent_low", "exponent_high"]].itertuples(index=False)
    table["shown"] = [f"{a:.2f} [{low:.2f}, {high:.2f}]" for a, low, high in bounds]
    by = ["sensor", "sigma"]
    wide = table.pivot_table("shown", by, "estimator", aggfunc="first")
    limit = table.groupby(by)["limit_exponent"].first().map("{:.2f}".format)
    wide = wide.assign(**{"Cramér-Rao limit": limit}).rename("{:g}".format, level=1)
    return _wide(["Sensor", "Noise [m]"], wide, left=1)


def roads() -> str:
    """Suite ``roads``, full sensor, known target speeds: scores and median errors."""
    held: Columns = {"Held-out error [m]": "held_out_error_median"}
    start: Columns = {"Road": "scenario", "Estimator": "estimator"}
    columns = start | _SCORE | _POSITION | held | _COSINE | _COVERED | _END
    return _table(_roads_seen_whole(unknown=False), columns)


def roads_errors() -> str:
    """Suite ``roads``, HighwayEnv's roads, full sensor: median position errors [m] with scores."""
    board = _roads_seen_whole(unknown=False)
    board = board[board["scenario"] != "merging"]
    pairs = board[["position_error_median", "score"]].itertuples(index=False)
    board = board.assign(shown=[f"{_number(error)} ({_number(score)})" for error, score in pairs])
    wide = board.pivot_table("shown", "estimator", "scenario", aggfunc="first")
    return _wide(["Estimator"], wide.loc[estimator_order(list(wide.index))])


def roads_unknown() -> str:
    """Suite ``roads``, full sensor, unknown target speeds: scores and median errors."""
    start: Columns = {
        "Road": lambda row: row["scenario"].removesuffix(_UNKNOWN),
        "Estimator": "estimator",
    }
    speeds: Columns = {"Error of target speeds [deviations]": "parameter_error_median"}
    columns = start | _SCORE | _POSITION | speeds | _COSINE | _END
    return _table(_roads_seen_whole(unknown=True), columns, left=2)


def _roads_seen_whole(unknown: bool) -> pd.DataFrame:
    """The roads' board of the full sensor: target speeds unknown or known."""
    board = _board("roads")
    part = board["scenario"].str.endswith(_UNKNOWN) == unknown
    board = board[part & (board["sensor"] == "full") & (board["trials"] > 0)]
    scores = _scores("position_error")
    place = ["scenario", "sensor", "estimator"]
    return board.merge(scores[scores["sigma"].isna()][[*place, "score"]], how="left", on=place)


def _scores(error: str) -> pd.DataFrame:
    """Scores by an error in the suite ``roads``; those who do not rank have none, floors apart."""
    table = _csv("roads", "scores")
    shown = table["ranked"] | (table["estimator"] == "uniform")
    return table[(table["error"] == error) & shown]


def road_scores() -> str:
    """Suite ``roads``: scores of all roads together, by three errors, and failures."""
    errors = {"Position error": "position_error", "Held-out error": "held_out_error"}
    errors["Cosine error"] = "cosine_error"
    columns = {}
    for head, error in errors.items():
        table = _scores(error)
        whole = table[(table["scenario"] == "all") & table["sigma"].isna()]
        whole = whole.set_index("estimator").sort_values("score")
        columns[head] = pd.Series(
            {
                name: f"{row['score']:.2f} [{row['score_low']:.2f}, {row['score_high']:.2f}]"
                for name, row in whole.iterrows()
            }
        )
        if error == "position_error":
            failed = whole["failures"].astype(str) + " of " + whole["trials"].astype(str)
    wide = pd.DataFrame(columns | {"Failures": failed}).reindex(columns["Position error"].index)
    return _wide(["Estimator"], wide)


def recognised() -> str:
    """Suite ``roads``, full sensor: shares of drivers whose temperament is recognised."""
    table = pd.read_csv(RESULTS / "roads" / "temperaments.csv.gz")
    table = table[(table["sensor"] == "full") & table["sigma"].isna()]
    table["known"] = table["recognised"] * table["drivers"]
    table["unknown"] = table["scenario"].str.endswith(_UNKNOWN)
    counts = table.groupby(["estimator", "unknown", "temperament"])[["known", "drivers"]].sum()
    shares = counts["known"] / counts["drivers"]
    columns = [(unknown, name) for unknown in (False, True) for name in TEMPERAMENTS]
    rows = [
        [one, *(_share(shares.get((one, *column), math.nan)) for column in columns)]
        for one in estimator_order(list(table["estimator"]))
    ]
    heads = [f"{name.capitalize()}{_UNKNOWN if unknown else ''}" for unknown, name in columns]
    return _markdown(["Estimator", *heads], rows, left=1)


def predictions() -> str:
    """Suite ``roads``, full sensor: errors of predictions after half of the samples, by road."""
    names = ["true_weights", "map", "kkt_constrained", "constant_velocity", "constant_controls"]
    names += ["stock", "stock_fitted"]
    table = _csv("predictions", "over_time")
    table = table[np.isclose(table["time"], 3.6) & table["estimator"].isin(names)]
    order = [names.index(name) for name in table["estimator"]]
    table = table.assign(order=order, road=pd.factorize(table["scenario"])[0])
    columns: Columns = {"Road": "scenario", "Prediction by": "estimator"}
    columns |= {f"{ahead} s": _interval_of(f"fde_{ahead}s", ahead == 3) for ahead in (1, 2, 3, 4)}
    return _table(table.sort_values(["road", "order"]), columns)


def prediction_tests() -> str:
    """Suite ``roads``, full sensor: whether predictions are better than HighwayEnv's drivers."""
    return _tests_online("predictions")


def parameters() -> str:
    """Suite ``parameters``: errors of weights and unknowns, all noise levels together."""
    board = _board("parameters")
    errors: Columns = {"Parameter error": "parameter_error_median"}
    errors |= {"Covered": "covers_parameters_share"}
    return _table(board[board["cosine_error_median"].notna()], _PLACE | _COSINE | errors | _END)


def constrained() -> str:
    """Suite ``constrained``, full sensor: median errors with the constraints and in ignorance."""
    board = _board("constrained")
    board = board[board["sensor"] == "full"].set_index(["scenario", "estimator"])
    columns = {"Position error": _POSITION["Position error [m]"]} | _COSINE | _FAILURES
    rows = []
    for scenario, name in board.index:
        if (scenario, f"{name}, ignorant") in board.index:
            pair = [board.loc[(scenario, one)].to_dict() for one in (name, f"{name}, ignorant")]
            cells = [_cell(one, how) for how in columns.values() for one in pair]
            rows.append([scenario, name, *cells])
    both = [f"{head}{end}" for head in columns for end in ("", ", ignorant")]
    return _markdown(["Scenario", "Estimator", *both], rows, left=2)


def claims() -> str:
    """The measurements of ``scripts/paper_claims.py``."""
    rows = [
        [
            "holds" if claim.holds else "**fails**",
            claim.text,
            f"{claim.value:.4g}",
            f"{claim.low:g} to {claim.high:g}".replace("-inf to", "at most"),
        ]
        for claim in claims_of(RESULTS / "paper")
    ]
    return _markdown(["", "Claim", "Measured", "Allowed"], rows, left=2)


def posterior() -> str:
    """Of ``scripts/posterior_calibration.py``: a row for each view and noise level."""
    # Heads, and the columns that the script prints.
    shown = {
        **{"View": 0, "Noise [m]": 1, "Draws": 2, "Mean cosine error": 3, "Covered [%]": 4},
        **{"Control [%]": 5, "Weights within 95 % [%]": 8, "Least p of ranks": 9},
        **{"Effective size": 11, "R-hat": 12, "Not converged [%]": 13, "Time [s]": 14},
    }
    rows = []
    for scenario in ("two_player", "highway_overtaking", "highway", "merge"):
        path = RESULTS / "calibration" / f"{scenario}.txt"
        for line in path.read_text().splitlines()[2:] if path.exists() else []:
            cells = re.split(r"\s{2,}", line)
            if cells[0] == "all":
                cells.insert(1, "all")
            rows.append([scenario, *(cells[place] for place in shown.values())])
    return _markdown(["Scenario", *shown], rows, left=2)


def regions() -> str:
    """Suite ``calibration``: coverage of 95 % regions with exact intervals, and their widths."""
    rows = _calibration().to_dict("records")
    cells = [f"{_exact(row['covered_95'], row['trials'])}, {_number(row['width'])}" for row in rows]
    return _by_level(_calibration(), cells)


def levels() -> str:
    """Suite ``calibration``: the probabilities of levels of regions, of weights, and of TARP."""
    shown = _calibration()[["p_uniform", "p_weights", "p_tarp"]].map(_chance)
    return _by_level(_calibration(), [", ".join(row) for row in shown.itertuples(index=False)])


def scores() -> str:
    """Suite ``calibration``: proper scores and cosine errors, all noise levels together."""
    board = _board("calibration")
    columns: Columns = {"Energy score": "energy_score_median", "CRPS": "crps_median"}
    columns |= {"Log score lost": "held_out_log_score_median", "Cosine error": "cosine_error_mean"}
    return _table(_in_order(board[board["trials"] > 0]), _PLACE | columns | _FAILURES)


def gains() -> str:
    """Suite ``calibration``: mean cosine errors of ``posterior`` and its rivals, cell by cell."""
    names = ("posterior", "kkt_constrained", "map", "ridge", "uniform")
    columns: Columns = {"Scenario": "scenario", "Sensor": "sensor"}
    columns |= {"Noise [m]": lambda row: f"{row['sigma']:g}"}
    columns |= {"Trials": lambda row: str(row["trials"])} | {name: name for name in names}
    columns["Posterior / best rival"] = lambda row: (
        f"{row['ratio']:.2f} [{row['ratio_low']:.2f}, {row['ratio_high']:.2f}]"
    )
    columns["p"] = lambda row: _chance(row["p_holm"])
    return _table(_csv("calibration", "posterior_gains"), columns)


def identified() -> str:
    """Suite ``calibration``: share of weights that are identified, and what is left, by noise."""
    table = _csv("calibration", "identifiability_by_noise")
    found = table.groupby(["scenario", "sensor", "sigma"])[["identified", "left"]].mean()
    shown = [f"{known:.0%}, {left:.0%}" for known, left in found.itertuples(index=False)]
    return _by_level(found.reset_index(), shown)


def learned() -> str:
    """What is learned beside what solves games: errors, coverage, energy score and time."""
    columns = _PLACE | _POSITION | _COSINE | _COVERED | {"Energy score": "energy_score_median"}
    return _table(_in_order(_board("learned")), columns | _END)


def learned_errors() -> str:
    """Means over views and noise levels of what ``learned_error.py`` prints, and their range."""
    rows = []
    for scenario in PAPER:
        path = RESULTS / "learned" / f"errors_{scenario}.txt"
        table = pd.read_csv(path, sep=r"\s*\|\s*", engine="python")
        errors = [_number(table[f"cos {name}"].mean()) for name in ("neural", "map", "uniform")]
        shares = [
            f"{_share(table[name].mean())} [{table[name].min():.0%}, {table[name].max():.0%}]"
            for name in ("ellipsoid", "interval")
        ]
        rows.append([scenario, str(table.iloc[0, 0]).split()[-1], *errors, *shares])
    heads = "Scenario, Draws, neural_posterior, map, uniform, In 95 % ellipsoid, In 95 % interval"
    return _markdown(heads.split(", "), rows, left=1)


def learned_online() -> str:
    """Predictions while samples come in, of what is learned and what is not."""
    columns: Columns = {"Scenario": "scenario", "Prediction by": "estimator"}
    columns |= {"Cosine error": "cosine_error", "Error in 1 s [m]": "fde_1s"}
    columns |= {"Error in 3 s [m]": _interval_of("fde_3s"), "ms": "latency_50"}
    return _table(_csv("learned", "online_summary"), columns)


def online() -> str:
    """Median errors of predictions 3 s ahead while samples come in, by road."""
    names = ["map", "kkt_constrained", "uniform", "true_weights"]
    names += ["constant_velocity", "stock", "stock_fitted"]
    table = _csv("online", "summary")
    table["shown"] = [_interval_of("fde_3s")(row) for row in table.to_dict("records")]
    wide = table.pivot_table("shown", "scenario", "estimator", aggfunc="first", sort=False)
    return _wide(["Road"], wide[names])


def online_tests() -> str:
    """Errors over those of constant velocity and of fitted drivers, and the time to be sure."""
    return _tests_online("online")


def _tests_online(study: str) -> str:
    table, summary = _csv(study, "comparisons"), _csv(study, "summary")
    table["pair"] = table["estimator"] + " / " + table["other"]
    pairs = table[["ratio", "p_holm"]].itertuples(index=False)
    table["shown"] = [f"{_number(ratio)} (p {_chance(p)})" for ratio, p in pairs]
    wide = table.pivot_table("shown", "scenario", "pair", aggfunc="first", sort=False)
    known = summary[summary["estimator"] == "map"].to_dict("records")
    shown = _interval_of("half_time")
    half = pd.Series([shown(row) for row in known], [row["scenario"] for row in known])
    return _wide(["Road"], wide.assign(**{"Half time of map [s]": half}))


def drives() -> str:
    """What became of drives among Nash traffic, by road and planner."""
    return _drives("nash")


def stock_drives() -> str:
    """What became of drives among HighwayEnv's own drivers, by road and planner."""
    return _drives("stock")


def _drives(traffic: str) -> str:
    def regret(row: Row) -> str:
        value, low, high = (100 * row[f"regret{end}"] for end in ("", "_low", "_high"))
        return f"{value:.2f}" + ("" if math.isnan(low) else f" [{low:.2f}, {high:.2f}]")

    table = _csv("driving", "summary")
    columns: Columns = {"Road": "road", "Planner": "planner"}
    columns |= {"Drives": lambda row: str(row["drives"])}
    columns |= {"Collisions": lambda row: _exact(row["collision"], int(row["drives"]))}
    columns |= {"Regret [%]": regret, "Progress [m]": "progress", "Jerk [m/s^3]": "jerk"}
    columns |= {"Error in 3 s [m]": "fde_3s", "Cycle [ms]": "cycle_50", "99 % [ms]": "cycle_99"}
    return _table(table[table["traffic"] == traffic], columns)


def drive_tests() -> str:
    """Paired differences of planners of the game to those that know nothing of the others."""
    heads = {"collision": "Collisions [%]", "cost": "Cost [%]", "fde_3s": "Error in 3 s [m]"}
    table = _csv("driving", "tests")
    players = table["planner"].isin(["oracle", "map", "kkt_constrained"])
    table = table[(table["traffic"] == "nash") & players]
    table["pair"] = table["column"].map(heads) + ", less " + table["other"]
    table.loc[table["column"] != "fde_3s", "difference"] *= 100
    numbers = table[["difference", "p_holm"]].itertuples(index=False)
    table["shown"] = [f"{_number(difference)} (p {_chance(p)})" for difference, p in numbers]
    rivals = ("uniform", "constant_velocity")
    pairs = [f"{head}, less {other}" for head in heads.values() for other in rivals]
    wide = table.pivot_table("shown", ["road", "planner"], "pair", aggfunc="first", sort=False)
    return _wide(["Road", "Planner"], wide.reindex(columns=pairs).fillna("–"))


TABLES: dict[str, Callable[[], str]] = {
    name: found
    for name, found in list(globals().items())
    if getattr(found, "__module__", "") == __name__ and name[0] != "_" and name != "filled"
}


def _csv(study: str, name: str) -> pd.DataFrame:
    table = pd.read_csv(RESULTS / study / f"{name}.csv")
    return table.rename(columns={"view": "sensor"})  # its name in tables before version 0.1


def _board(study: str) -> pd.DataFrame:
    return _csv(study, "leaderboard")


def _calibration() -> pd.DataFrame:
    """Rows of ``calibration.csv``, the best known kinds of regions first."""
    return _in_order(_csv("calibration", "calibration"))


def _in_order(table: pd.DataFrame) -> pd.DataFrame:
    order = {name: place for place, name in enumerate(estimator_order(list(table["estimator"])))}
    table = table.assign(place=table["estimator"].map(order))
    return table.sort_values(["scenario", "sensor", "place"], kind="stable")


def _by_level(table: pd.DataFrame, cells: list[str]) -> str:
    """A row for each scenario, sensor and perhaps estimator, a column for each noise level.

    Scenarios have noise levels of their own, which are named with them.
    """
    keys = [key for key in _PLACE.values() if key in table]
    sigmas = {str(name): sorted(own["sigma"].unique()) for name, own in table.groupby("scenario")}
    most = max(map(len, sigmas.values()))
    rows = []
    for labels, group in table.assign(cell=cells).groupby(keys, sort=False):
        place = [str(label) for label in labels]
        told = sigmas[place[0]]
        cell = dict(zip(group["sigma"], group["cell"], strict=True))
        noise = ", ".join(f"{sigma:g}" for sigma in told)
        shown = [cell.get(sigma, "–") for sigma in told] + ["–"] * (most - len(told))
        rows.append([f"{place[0]}: {noise} m", *place[1:], *shown])
    heads = [str(key).capitalize() for key in keys]
    heads += ["Least noise", *(["More"] * (most - 2)), "Most"][:most]
    return _markdown(heads, rows, left=len(keys))


def _table(table: pd.DataFrame, columns: Columns, left: int = 0) -> str:
    """A line for each row; columns of texts are first, and stand on the left."""
    rows = table.to_dict("records")
    left = left or sum(isinstance(rows[0].get(how), str) for how in columns.values())
    lines = ([_cell(row, how) for how in columns.values()] for row in rows)
    return _markdown(list(columns), lines, left)


def _cell(row: Row, how: str | Callable[[Row], str]) -> str:
    if callable(how):
        return how(row)
    value = row[how]
    if isinstance(value, str):
        return value
    return _share(value) if how.endswith("_share") else _number(value)


def _wide(heads: list[str], wide: pd.DataFrame, left: int = 0) -> str:
    """A line for each row of texts, after the labels of its index."""
    labels = [label if isinstance(label, tuple) else (label,) for label in wide.index]
    rows = [[*map(str, label), *row] for label, row in zip(labels, wide.to_numpy(), strict=True)]
    return _markdown([*heads, *map(str, wide.columns)], rows, left or len(heads))


def _markdown(heads: list[str], rows: Iterable[list[str]], left: int) -> str:
    rule = ["---" if k < left else "---:" for k in range(len(heads))]
    cells = [[cell.replace("_", r"\_") for cell in row] for row in (heads, *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in (cells[0], rule, *cells[1:]))


def _interval_of(name: str, interval: bool = True) -> Callable[[Row], str]:
    """A value, with its interval."""

    def shown(row: Row) -> str:
        value, low, high = (_number(row.get(f"{name}{end}", 0)) for end in ("", "_low", "_high"))
        return f"{value} [{low}, {high}]" if interval else value

    return shown


def _exact(share: float, trials: int) -> str:
    """A share with its exact 95 % interval (Clopper and Pearson)."""
    bounds = binomtest(round(share * trials), trials).proportion_ci(0.95, method="exact")
    return f"{share:.0%} [{100 * bounds.low:.0f}, {100 * bounds.high:.0f}]"


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


def main() -> None:
    """Rewrite the pages whose tables have changed."""
    for name in PAGES:
        path = ROOT / name
        before = path.read_text(encoding="utf-8")
        after = filled(before)
        if after != before:
            path.write_text(after, encoding="utf-8")
            print(f"{name}: tables updated")


if __name__ == "__main__":
    main()
