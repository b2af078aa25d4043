"""Update the tables of README and documentation from ``results/``.

    python scripts/docs_tables.py

A table is between the comments ``<!-- table: NAME -->`` and ``<!-- end -->``, and is replaced.
``TABLES`` has the names.
"""

import math
import re
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from paper_claims import claims_of
from scipy.stats import binomtest

from olne_bench.bench.report.figures.style import estimator_order
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE
from olne_bench.envs.temperaments import TEMPERAMENTS

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
PAPER = ["two_player", "highway_overtaking"]
PAGES = (
    "README.md",
    "docs/estimators.md",
    "docs/study.md",
    "docs/highway.md",
    "docs/unknowns.md",
    "docs/constraints.md",
    "docs/calibration.md",
    "docs/learned.md",
    "docs/online.md",
    "docs/driving.md",
)
#: Columns of a leaderboard, and their heads in the table of constraints.
_WORTH = {
    "position_error_median": "Position error",
    "cosine_error_median": "Cosine error",
}
#: Heads of the table of posteriors, and the columns that the script prints.
_POSTERIOR = {
    **{"View": 0, "Noise [m]": 1, "Draws": 2, "Mean cosine error": 3, "Covered [%]": 4},
    **{"Control [%]": 5, "Weights within 95 % [%]": 8, "Least p of ranks": 9},
    **{"Effective size": 11, "R-hat": 12, "Not converged [%]": 13, "Time [s]": 14},
}
#: What predicts in the table of online studies.
_FORECASTS = (
    *("map", "kkt_constrained", "uniform", "true_weights"),
    *("constant_velocity", "stock", "stock_fitted"),
)
#: What predicts in the table of the roads, and the time of half of the samples [s].
_PREDICT = (
    *("true_weights", "map", "kkt_constrained", "constant_velocity", "constant_controls"),
    *("stock", "stock_fitted"),
)
_HALF = 3.6
#: Planners that know something, rivals, and columns in the table of tests of drives.
_PLAYERS = ("oracle", "map", "kkt_constrained")
_RIVALS = ("uniform", "constant_velocity")
_TESTED = {"collision": "Collisions [%]", "cost": "Cost [%]", "fde_3s": "Error in 3 s [m]"}
#: Marks what is significant.
_STAR = r"\*"
#: Ends the labels of roads whose target speeds nobody tells.
_UNKNOWN = ", unknown speeds"
_PLACE = ("scenario", "sensor", "estimator")
_TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(page: str) -> str:
    """A page with its tables filled from ``results/``.

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
            *_place_and_errors(row),
            _number(row["limit_ratio"]),
            *_failures_and_time(row),
        ]
        for row in board.to_dict("records")
    ]
    heads = (
        "Scenario, Sensor, Estimator, Position error [m], Cosine error, Error / bound, Failures, ms"
    )
    return _markdown(heads.split(", "), rows, left=3)


def times() -> str:
    """Median time [ms] of one estimate: the paper's scenarios, and the median of the roads."""
    board = _leaderboard("field")
    board["where"] = board["scenario"].where(board["scenario"].isin(PAPER), "roads")
    board["ms"] = 1e3 * board["solve_seconds_median"]
    wide = board.pivot_table("ms", "estimator", "where", "median")[[*PAPER, "roads"]]
    rows = [[name, *map(_number, values)] for name, *values in wide.itertuples()]
    return _markdown(["Estimator", *wide.columns], rows, left=1)


def coverage() -> str:
    """Share of 95 % ellipsoids that hold the truth, by noise level."""
    trials = pd.read_parquet(RESULTS / "paper" / "trials.parquet")
    trials = trials[trials["sigma"].isin([0.001, 0.005, 0.01, 0.02, 0.05, 0.1])]
    by = ["scenario", "sensor", "estimator"]
    wide = trials.dropna(subset="covers_truth").pivot_table("covers_truth", by, "sigma")
    rows = [[*keys, *(f"{share:.0%}" for share in row)] for keys, *row in wide.itertuples()]
    heads = ["Scenario", "Sensor", "Estimator", *(f"{sigma:g} m" for sigma in wide.columns)]
    return _markdown(heads, rows, left=3)


def exponents() -> str:
    """Exponents, with 95 % intervals, of the decrease of errors with the number of trajectories."""
    table = pd.read_csv(RESULTS / "several_trajectories" / "exponents.csv")
    table = table.rename(columns={"view": "sensor"})
    bounds = table[["exponent", "exponent_low", "exponent_high"]].itertuples(index=False)
    table["shown"] = [f"{a:.2f} [{low:.2f}, {high:.2f}]" for a, low, high in bounds]
    by = ["sensor", "sigma"]
    wide = table.pivot_table("shown", by, "estimator", aggfunc="first")
    limit = table.groupby(by)["limit_exponent"].first()
    rows = [
        [sensor, f"{sigma:g}", *cells, f"{limit[sensor, sigma]:.2f}"]
        for (sensor, sigma), *cells in wide.itertuples()
    ]
    return _markdown(["Sensor", "Noise [m]", *wide.columns, "Cramér-Rao limit"], rows, left=1)


def roads() -> str:
    """Suite ``roads``, full sensor, known target speeds: ranks and median errors."""
    rows = [
        [
            row["scenario"],
            row["estimator"],
            _rank(row["position_error_rank"]),
            _number(row["position_error_median"]),
            _number(row["held_out_error_median"]),
            _number(row["cosine_error_median"]),
            _share(row["covers_truth_share"]),
            *_failures_and_time(row),
        ]
        for row in _roads_seen_whole(unknown=False).to_dict("records")
    ]
    heads = (
        "Road, Estimator, Rank, Position error [m], Held-out error [m], Cosine error, Covered, "
        "Failures, ms"
    )
    return _markdown(heads.split(", "), rows, left=2)


def roads_errors() -> str:
    """Suite ``roads``, HighwayEnv's roads, full sensor: median position errors [m] with ranks."""
    board = _roads_seen_whole(unknown=False)
    board = board[board["scenario"] != "merging"]
    shown = [
        f"{_number(error)} ({_rank(rank)})"
        for error, rank in zip(
            board["position_error_median"], board["position_error_rank"], strict=True
        )
    ]
    wide = board.assign(shown=shown).pivot_table("shown", "estimator", "scenario", aggfunc="first")
    wide = wide.loc[estimator_order(list(wide.index))]
    rows = [list(row) for row in wide.itertuples()]
    return _markdown(["Estimator", *wide.columns], rows, left=1)


def roads_unknown() -> str:
    """Suite ``roads``, full sensor, unknown target speeds: ranks and median errors."""
    rows = [
        [
            row["scenario"].removesuffix(_UNKNOWN),
            row["estimator"],
            _rank(row["position_error_rank"]),
            _number(row["position_error_median"]),
            _number(row["parameter_error_median"]),
            _number(row["cosine_error_median"]),
            *_failures_and_time(row),
        ]
        for row in _roads_seen_whole(unknown=True).to_dict("records")
    ]
    heads = (
        "Road, Estimator, Rank, Position error [m], Error of target speeds [deviations], "
        "Cosine error, Failures, ms"
    )
    return _markdown(heads.split(", "), rows, left=2)


def _roads_seen_whole(unknown: bool) -> pd.DataFrame:
    """The roads' board of the full sensor: target speeds unknown or known."""
    board = _leaderboard("roads")
    part = board["scenario"].str.endswith(_UNKNOWN) == unknown
    return board[part & (board["sensor"] == "full") & (board["trials"] > 0)]


def _rank(rank: float) -> str:
    return "–" if math.isnan(rank) else f"{rank:.0f}"


def wins() -> str:
    """Suite ``roads``: shares of draws of all roads that a line's estimator wins from a column's.

    By position error; a star where the difference is significant.
    """
    table = pd.read_csv(RESULTS / "roads" / "wins.csv")
    whole = table[
        (table["scenario"] == "all scenarios") & (table["error"] == "position_error")
    ].to_dict("records")
    shares = {(row["estimator"], row["other"]): (row["wins"], row["p_holm"]) for row in whole}
    shares |= {(other, one): (1 - share, p) for (one, other), (share, p) in shares.items()}
    names = estimator_order([name for pair in shares for name in pair])
    rows = [[one, *(_won(shares.get((one, other))) for other in names)] for one in names]
    return _markdown(["", *names], rows, left=1)


def _won(found: tuple[float, float] | None) -> str:
    if found is None:
        return ""
    share, p_holm = found
    return f"{share:.0%}{_STAR if p_holm < SIGNIFICANCE else ''}"


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
    table = pd.read_csv(RESULTS / "predictions" / "over_time.csv")
    table = table[np.isclose(table["time"], _HALF)]
    rows = []
    for road, of in _lines(table, "scenario", "estimator").items():
        for name in _PREDICT:
            one, two, four = (_number(of[name][f"fde_{ahead}s"]) for ahead in (1, 2, 4))
            rows.append([road, name, one, two, _with_interval(of[name], "fde_3s"), four])
    return _markdown(["Road", "Prediction by", "1 s", "2 s", "3 s", "4 s"], rows, left=2)


def prediction_tests() -> str:
    """Suite ``roads``, full sensor: whether predictions are better than HighwayEnv's drivers."""
    return _tests_online(RESULTS / "predictions")


def parameters() -> str:
    """Suite ``parameters``: errors of weights and unknowns, all noise levels together."""
    board = _leaderboard("parameters")
    board = board[board["cosine_error_median"].notna()]
    rows = [
        [
            row["scenario"],
            row["sensor"],
            row["estimator"],
            _number(row["cosine_error_median"]),
            _number(row["parameter_error_median"]),
            _share(row["covers_parameters_share"]),
            *_failures_and_time(row),
        ]
        for row in board.to_dict("records")
    ]
    heads = "Scenario, Sensor, Estimator, Cosine error, Parameter error, Covered, Failures, ms"
    return _markdown(heads.split(", "), rows, left=3)


def constrained() -> str:
    """Suite ``constrained``, full sensor: median errors with the constraints and in ignorance."""
    board = _leaderboard("constrained")
    board = board[board["sensor"] == "full"].set_index(["scenario", "estimator"])
    rows = []
    for scenario, name in board.index:
        if (scenario, f"{name}, ignorant") not in board.index:
            continue
        pair = [board.loc[(scenario, one)] for one in (name, f"{name}, ignorant")]
        cells = [_number(one[column]) for column in _WORTH for one in pair]
        failures = [f"{one['failures']} of {one['trials']}" for one in pair]
        rows.append([scenario, name, *cells, *failures])
    heads = (*_WORTH.values(), "Failures")
    both = [f"{head}{end}" for head in heads for end in ("", ", ignorant")]
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
    rows = []
    for scenario in ("two_player", "highway_overtaking", "highway", "merge"):
        path = RESULTS / "calibration" / f"{scenario}.txt"
        for line in path.read_text().splitlines()[2:] if path.exists() else []:
            cells = re.split(r"\s{2,}", line)
            if cells[0] == "all":
                cells.insert(1, "all")
            rows.append([scenario, *(cells[place] for place in _POSTERIOR.values())])
    heads = ["Scenario", *_POSTERIOR]
    return _markdown(heads, rows, left=2)


def regions() -> str:
    """Suite ``calibration``: coverage of 95 % regions with exact intervals, and their widths."""
    table = _calibration()
    cells = [
        f"{_exact(row['covered_95'], row['trials'])}, {_number(row['width'])}"
        for row in table.to_dict("records")
    ]
    return _by_level(table, cells)


def levels() -> str:
    """Suite ``calibration``: the probabilities of levels of regions, of weights, and of TARP."""
    table = _calibration()
    shown = table[["p_uniform", "p_weights", "p_tarp"]].map(_chance)
    return _by_level(table, [", ".join(row) for row in shown.itertuples(index=False)])


def scores() -> str:
    """Suite ``calibration``: proper scores and cosine errors, all noise levels together."""
    board = _leaderboard("calibration")
    scored = ("energy_score_median", "crps_median", "held_out_log_score_median")
    columns = [*scored, "cosine_error_mean"]
    rows = [
        [
            *(row[key] for key in _PLACE),
            *(_number(row[column]) for column in columns),
            f"{row['failures']} of {row['trials']}",
        ]
        for row in _in_order(board[board["trials"] > 0]).to_dict("records")
    ]
    heads = (
        "Scenario, Sensor, Estimator, Energy score, CRPS, Log score lost, Cosine error, Failures"
    )
    return _markdown(heads.split(", "), rows, left=3)


def gains() -> str:
    """Suite ``calibration``: mean cosine errors of ``posterior`` and its rivals, cell by cell."""
    table = pd.read_csv(RESULTS / "calibration" / "posterior_gains.csv")
    shown = ("posterior", "kkt_constrained", "map", "ridge", "uniform")
    rows = [
        [
            row["scenario"],
            row["sensor"],
            f"{row['sigma']:g}",
            f"{row['trials']}",
            *(_number(row[name]) for name in shown),
            f"{row['ratio']:.2f} [{row['ratio_low']:.2f}, {row['ratio_high']:.2f}]",
            _chance(row["p_holm"]),
        ]
        for row in table.to_dict("records")
    ]
    heads = ["Scenario", "Sensor", "Noise [m]", "Trials", *shown, "Posterior / best rival", "p"]
    return _markdown(heads, rows, left=2)


def identified() -> str:
    """Suite ``calibration``: share of weights that are identified, and what is left, by noise."""
    table = pd.read_csv(RESULTS / "calibration" / "identifiability_by_noise.csv")
    by = ["scenario", "sensor", "sigma"]
    found = table.groupby(by)[["identified", "left"]].mean().reset_index()
    cells = [f"{row['identified']:.0%}, {row['left']:.0%}" for row in found.to_dict("records")]
    return _by_level(found, cells)


def learned() -> str:
    """What is learned beside what solves games: errors, coverage, energy score and time."""
    rows = [
        [
            *_place_and_errors(row),
            _share(row["covers_truth_share"]),
            _number(row["energy_score_median"]),
            *_failures_and_time(row),
        ]
        for row in _in_order(_leaderboard("learned")).to_dict("records")
    ]
    heads = "Scenario, Sensor, Estimator, Position error [m], Cosine error, Covered, Energy score"
    return _markdown([*heads.split(", "), "Failures", "ms"], rows, left=3)


def learned_errors() -> str:
    """Means over views and noise levels of what ``learned_error.py`` prints, and their range."""
    rows = []
    for scenario in PAPER:
        path = RESULTS / "learned" / f"errors_{scenario}.txt"
        table = pd.read_csv(path, sep=r"\s*\|\s*", engine="python")
        draws = int(str(table.iloc[0, 0]).split()[-1])
        errors = [_number(table[f"cos {name}"].mean()) for name in ("neural", "map", "uniform")]
        shares = [
            f"{_share(table[name].mean())} [{table[name].min():.0%}, {table[name].max():.0%}]"
            for name in ("ellipsoid", "interval")
        ]
        rows.append([scenario, str(draws), *errors, *shares])
    heads = "Scenario, Draws, neural_posterior, map, uniform, In 95 % ellipsoid, In 95 % interval"
    return _markdown(heads.split(", "), rows, left=1)


def learned_online() -> str:
    """Predictions while samples come in, of what is learned and what is not."""
    table = pd.read_csv(RESULTS / "learned" / "online_summary.csv")
    rows = [
        [
            row["scenario"],
            row["estimator"],
            _number(row["cosine_error"]),
            _number(row["fde_1s"]),
            _with_interval(row, "fde_3s"),
            _number(row["latency_50"]),
        ]
        for row in table.to_dict("records")
    ]
    heads = "Scenario, Prediction by, Cosine error, Error in 1 s [m], Error in 3 s [m], ms"
    return _markdown(heads.split(", "), rows, left=2)


def online() -> str:
    """Median errors of predictions 3 s ahead while samples come in, by road."""
    table = pd.read_csv(RESULTS / "online" / "summary.csv")
    rows = [
        [road, *(_with_interval(of[name], "fde_3s") for name in _FORECASTS)]
        for road, of in _lines(table, "scenario", "estimator").items()
    ]
    return _markdown(["Road", *_FORECASTS], rows, left=1)


def online_tests() -> str:
    """Errors over those of constant velocity and of fitted drivers, and the time to be sure."""
    return _tests_online(RESULTS / "online")


def _tests_online(folder: Path) -> str:
    table = pd.read_csv(folder / "comparisons.csv")
    summary = _lines(pd.read_csv(folder / "summary.csv"), "scenario", "estimator")
    table["pair"] = table["estimator"] + " / " + table["other"]
    rows = [
        [
            road,
            *(f"{_number(row['ratio'])} (p {_chance(row['p_holm'])})" for row in of.values()),
            _with_interval(summary[road]["map"], "half_time"),
        ]
        for road, of in _lines(table, "scenario", "pair").items()
    ]
    heads = ["Road", *dict.fromkeys(table["pair"]), "Half time of map [s]"]
    return _markdown(heads, rows, left=1)


def drives() -> str:
    """What became of drives among Nash traffic, by road and planner."""
    return _drives("nash")


def stock_drives() -> str:
    """What became of drives among HighwayEnv's own drivers, by road and planner."""
    return _drives("stock")


def _drives(traffic: str) -> str:
    table = pd.read_csv(RESULTS / "driving" / "summary.csv")
    rows = [
        [
            row["road"],
            row["planner"],
            str(row["drives"]),
            _exact(row["collision"], int(row["drives"])),
            _percent(row, "regret"),
            *(_number(row[name]) for name in ("progress", "jerk", "fde_3s")),
            *(_number(row[name]) for name in ("cycle_50", "cycle_99")),
        ]
        for row in table[table["traffic"] == traffic].to_dict("records")
    ]
    heads = "Road, Planner, Drives, Collisions, Regret [%], Progress [m], Jerk [m/s^3]"
    more = ["Error in 3 s [m]", "Cycle [ms]", "99 % [ms]"]
    return _markdown([*heads.split(", "), *more], rows, left=2)


def _percent(row: dict[Hashable, Any], name: str) -> str:
    """A share and its interval in hundredths, to two decimals."""
    estimate, low, high = (100 * row[name + end] for end in ("", "_low", "_high"))
    return f"{estimate:.2f}" + ("" if math.isnan(low) else f" [{low:.2f}, {high:.2f}]")


def drive_tests() -> str:
    """Paired differences of planners of the game to those that know nothing of the others."""
    table = pd.read_csv(RESULTS / "driving" / "tests.csv")
    table = table[(table["traffic"] == "nash") & table["planner"].isin(_PLAYERS)]
    table["pair"] = table["column"].map(_TESTED) + ", less " + table["other"]
    table.loc[table["column"] != "fde_3s", "difference"] *= 100
    pairs = [f"{head}, less {other}" for head in _TESTED.values() for other in _RIVALS]
    rows = []
    for (road, planner), part in table.groupby(["road", "planner"], sort=False):
        of = part.set_index("pair").to_dict("index")
        cells = [
            f"{_number(of[pair]['difference'])} (p {_chance(of[pair]['p_holm'])})"
            if pair in of
            else "–"
            for pair in pairs
        ]
        rows.append([str(road), str(planner), *cells])
    return _markdown(["Road", "Planner", *pairs], rows, left=2)


TABLES: dict[str, Callable[[], str]] = {
    table.__name__: table
    for table in (
        *(paper, times, coverage, exponents, claims),
        *(roads_errors, roads, roads_unknown, wins, recognised, parameters, constrained),
        *(posterior, regions, levels, scores, gains, identified),
        *(learned, learned_errors, learned_online),
        *(predictions, prediction_tests, online, online_tests),
        *(drives, stock_drives, drive_tests),
    )
}


def _leaderboard(name: str) -> pd.DataFrame:
    table = pd.read_csv(RESULTS / name / "leaderboard.csv")
    return table.rename(columns={"view": "sensor"})  # its name in tables before version 0.1


def _calibration() -> pd.DataFrame:
    """Rows of ``calibration.csv``, the best known kinds of regions first."""
    return _in_order(pd.read_csv(RESULTS / "calibration" / "calibration.csv"))


def _in_order(table: pd.DataFrame) -> pd.DataFrame:
    order = {name: place for place, name in enumerate(estimator_order(list(table["estimator"])))}
    table = table.assign(place=table["estimator"].map(order))
    return table.sort_values(["scenario", "sensor", "place"], kind="stable")


def _by_level(table: pd.DataFrame, cells: list[str]) -> str:
    """A row for each scenario, sensor and perhaps estimator, a column for each noise level.

    Scenarios have noise levels of their own, which are named with them.
    """
    keys = [key for key in _PLACE if key in table]
    sigmas = {str(name): sorted(own["sigma"].unique()) for name, own in table.groupby("scenario")}
    most = max(map(len, sigmas.values()))
    table = table.assign(cell=cells)
    rows = []
    for labels, group in table.groupby(keys, sort=False):
        place = [str(label) for label in labels]
        told = sigmas[place[0]]
        cell = dict(zip(group["sigma"], group["cell"], strict=True))
        noise = ", ".join(f"{sigma:g}" for sigma in told)
        shown = [cell.get(sigma, "–") for sigma in told] + ["–"] * (most - len(told))
        rows.append([f"{place[0]}: {noise} m", *place[1:], *shown])
    heads = [key.capitalize() for key in keys]
    heads += ["Least noise", *(["More"] * (most - 2)), "Most"][:most]
    return _markdown(heads, rows, left=len(keys))


def _lines(table: pd.DataFrame, first: str, second: str) -> dict[str, dict[str, Any]]:
    """Rows by two of their labels."""
    return {
        str(name): {str(row[second]): row for row in part.to_dict("records")}
        for name, part in table.groupby(first, sort=False)
    }


def _with_interval(row: dict[Hashable, Any], name: str) -> str:
    """A value with its interval."""
    value, low, high = (_number(row[f"{name}{end}"]) for end in ("", "_low", "_high"))
    return f"{value} [{low}, {high}]"


def _exact(share: float, trials: int) -> str:
    """A share with its exact 95 % interval (Clopper and Pearson)."""
    bounds = binomtest(round(share * trials), trials).proportion_ci(0.95, method="exact")
    return f"{share:.0%} [{100 * bounds.low:.0f}, {100 * bounds.high:.0f}]"


def _chance(value: float) -> str:
    if math.isnan(value):
        return "–"
    return "< 0.001" if value < 0.001 else f"{value:.2g}"


def _place_and_errors(row: dict[Hashable, Any]) -> list[str]:
    """Scenario, sensor and estimator, and the median errors of positions and weights."""
    errors = [_number(row[f"{name}_error_median"]) for name in ("position", "cosine")]
    return [*(row[name] for name in _PLACE), *errors]


def _failures_and_time(row: dict[Hashable, Any]) -> tuple[str, str]:
    """Failures of all trials, and the median time of an estimate [ms]."""
    return f"{row['failures']} of {row['trials']}", _number(1e3 * row["solve_seconds_median"])


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.0f}" if abs(value) >= 99.5 else f"{float(f'{value:.2g}'):g}"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.0%}"


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
            print(f"{name}: tables updated")


if __name__ == "__main__":
    main()
