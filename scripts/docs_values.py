"""Numbers in sentences, from ``results/``.

A number is between ``<!--=NAME-->`` and ``<!--/-->``, and is replaced by what ``VALUES`` has under
that name; ``docs_tables.py`` does it.
"""

import json
import re
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import pandas as pd
from behaviours import over_open_loop
from scipy.stats import binomtest
from stale_results import MODULES, SUITES, old

#: When the tenth sample of a road comes [s].
TENTH_SAMPLE = 3.6
RESULTS = Path(__file__).parents[1] / "results"
_VALUE = re.compile(r"(<!--=([\w.-]+)-->).*?(<!--/-->)", re.DOTALL)


def filled(page: str) -> str:
    """A page with the numbers in its sentences filled.

    Raises:
        KeyError: on the name of a number that does not exist.
    """
    return _VALUE.sub(lambda found: f"{found[1]}{VALUES[found[2]]()}{found[3]}", page)


@lru_cache
def _table(name: str) -> pd.DataFrame:
    path = RESULTS / name
    return pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)


def _row(name: str, **labels: Any) -> pd.Series:
    """The one row of a table with these labels."""
    return _one(_table(name), labels)


def _one(table: pd.DataFrame, labels: dict[str, Any]) -> pd.Series:
    for column, value in labels.items():
        table = table[table[column] == value]
    if len(table) != 1:
        raise ValueError(f"{len(table)} rows have {labels}")
    return table.iloc[0]


def _interval(row: pd.Series, column: str, form: str = "{:.2f}") -> str:
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    return " ".join((form.format(row[column]), f"[{form.format(low)},", f"{form.format(high)}]"))


# ----------------------------------------------------------------------------------------- people


def _people(
    road: str,
    kind: str,
    seconds: int,
    method: str,
    column: str,
    interval: bool,
    file: str = "summary",
) -> str:
    """A figure of the study of recorded drivers, of both halves of a road."""
    labels = {"road": road, "half": "both", "kind": kind, "ahead": seconds, "method": method}
    row = _row(f"people/{file}.csv", **labels)
    return _interval(row, column) if interval else f"{row[column]:.2f}"


def _held() -> str:
    """Range of shares that the game's regions hold, both ways, over roads and seconds."""
    table = _table("people/summary.csv")
    table = table[
        (table["method"] == "game") & (table["kind"] == "all") & (table["half"] == "both")
    ]
    shares = table[["holds_along", "holds_left"]].to_numpy()
    return f"{100 * shares.min():.0f} to {100 * shares.max():.0f}"


#: Kind, seconds, method and column of figures of both roads, and whether intervals are told.
ON_BOTH_ROADS = {
    "": ("all", 3, "game", "over_straight", True),
    ".idm": ("all", 3, "idm", "over_straight", False),
    ".own": ("all", 3, "own weights", "over_straight", False),
    ".coupled": ("all", 3, "game", "over_alone", True),
    ".wave": ("wave", 3, "game", "over_alone", True),
    ".wave5": ("wave", 5, "game", "over_alone", False),
    ".weights": ("all", 3, "own weights", "over_game", True),
    ".imperfect": ("all", 3, "imperfect", "over_game", True),
    ".loose": ("all", 3, "imperfect", "over_straight", False),
}

# ------------------------------------------------------------------------------------- behaviours


def _decided() -> tuple[int, int, int]:
    """Motions, those that are decided, and those that are decided and right."""
    trials = _table("behaviours/trials.csv")
    decided = trials[~trials["chosen"].isin(["undecided", "none"])]
    return len(trials), len(decided), int((decided["chosen"] == decided["truth"]).sum())


def _residual(behaviour: str) -> str:
    """Ratio of a behaviour's residual to the open loop's, with its interval."""
    found = over_open_loop(_table("behaviours/people.csv"), behaviour)
    return str(found["residual over that of open_loop"])


# --------------------------------------------------------------------------------------- the rest


def _encounter(
    quarter: str, planner: str, other: str, column: str = "difference", of: str = "cost"
) -> str:
    """A contrast of the suite ``encounters``, in hundredths of what standing costs."""
    row = _row("encounters/tests.csv", column=of, quarter=quarter, planner=planner, other=other)
    if column == "difference":
        return f"{abs(100 * row['difference']):.1f}"
    return f"{row[column]:.1g}"


def _drives(planner: str, column: str) -> str:
    """A number of all encounters of a planner, to the whole."""
    row = _row("encounters/quarters.csv", quarter="all", planner=planner)
    return f"{row[column]:.0f}"


def _score(estimator: str, gain: bool) -> str:
    """Score by position errors over all roads and sensors, or by how much smaller errors are."""
    table = _table("roads/scores.csv")
    table = table[table["sigma"].isna()]
    labels = {"error": "position_error", "scenario": "all", "sensor": "all", "estimator": estimator}
    row = _one(table, labels)
    score, low, high = (row[f"score{end}"] for end in ("", "_low", "_high"))
    if not gain:
        return f"{score:.2f}"
    return f"{_less(score)} % smaller errors [{_less(high)}, {_less(low)}]"


def _less(ratio: float) -> str:
    return f"{100 * (1 - ratio):.0f}"


def _regions() -> tuple[int, int]:
    """Regions of ``posterior`` for truths from its prior, and those that hold the truth."""
    names = ("two_player", "highway", "highway_overtaking", "merge")
    lines = [
        re.search(r"^all +(\d+) +[\d.]+ +([\d.]+) \[", text, re.MULTILINE)
        for text in ((RESULTS / f"calibration/{name}.txt").read_text() for name in names)
    ]
    pairs = [(int(line[1]), float(line[2])) for line in lines if line]
    return sum(n for n, _ in pairs), sum(round(n * share / 100) for n, share in pairs)


def _regions_share() -> str:
    total, held = _regions()
    ends = binomtest(held, total).proportion_ci(method="exact")
    share, low, high = (f"{100 * value:.1f}" for value in (held / total, ends.low, ends.high))
    return f"{share} % [{low}, {high}]"


def _recognised() -> str:
    """Range over roads of the share of drivers whose temperament ``map`` recognises, full view."""
    table = _table("roads/temperaments.csv.gz")
    table = table[(table["sensor"] == "full") & (table["estimator"] == "map")]
    table = table[table["sigma"].isna()]
    sums = table.assign(right=table["recognised"] * table["drivers"]).groupby("scenario")
    found = 100 * sums["right"].sum() / sums["drivers"].sum()
    return f"{found.min():.0f} to {found.max():.0f}"


def _ahead(estimator: str, digits: int) -> str:
    """Range over roads of median errors 3 s ahead [m], with ten of 20 samples."""
    table = _table("predictions/over_time.csv")
    chosen = (table["estimator"] == estimator) & (table["time"] == TENTH_SAMPLE)
    found = table[chosen]["fde_3s"]
    return f"{found.min():.{digits}f} to {found.max():.{digits}f}"


def _driving(planner: str) -> str:
    """Collisions of a planner among Nash traffic."""
    table = _table("driving/summary.csv")
    chosen = (table["planner"] == planner) & (table["traffic"] == "nash") & (table["road"] != "all")
    return str(table[chosen]["collisions"].sum())


def _damage(change: str, dial: float, estimator: str) -> str:
    """Share of draws whose region holds the truth."""
    row = _row(
        "misspecified/damage.csv", of="highway", change=change, dial=dial, estimator=estimator
    )
    return f"{100 * row['covers_truth_share']:.0f}"


def _ahead_of_map(change: str, whose: str) -> str:
    """Median error 2 s ahead on the highway over that of ``map``; ``truth`` are true weights."""
    row = _row("misspecified/ahead.csv", scenario=f"highway, {change}")
    return f"{row[whose] / row['map']:.2f}"


def _conformal(column: str) -> str:
    """Range over changes and seconds of the share of draws that discs of ``map`` hold."""
    table = _table("misspecified/conformal.csv")
    table = table[table["scenario"].str.startswith("highway,")]
    shares = 100 * table[table["estimator"] == "map"][column]
    return f"{shares.min():.0f} to {shares.max():.0f}"


def _inverse(game: str, rival: str = "") -> str:
    """Milliseconds of the joint method; or how many times as long a rival takes, by medians."""
    found = json.loads((RESULTS / "perf/perf.json").read_text())["inverse"][game]
    if not rival:
        return f"{found['ours_ms']:.2g}"
    return f"{found[rival]['ratio of medians']:.0f}"


def _c2st() -> str:
    """Range of the scenarios' median C2ST."""
    found = [
        float(re.search(r"C2ST: median ([\d.]+)", path.read_text())[1])  # type: ignore[index]
        for path in sorted(RESULTS.glob("calibration/references_*.txt"))
    ]
    return f"{min(found):.3f} to {max(found):.3f}"


def _bound(column: str) -> str:
    """Range of errors over the joint bound, over scenarios and views."""
    ratios = pd.read_csv(RESULTS / "unknowns/bounds.txt", sep=r" {2,}", engine="python")[column]
    return f"{ratios.min():.2f} to {ratios.max():.2f}"


def _merging(name: str) -> str:
    """What follows a name in what was printed of ``merging`` with three players."""
    text = (RESULTS / "constraints/merging_3_players.txt").read_text()
    return f"{float(re.search(rf'{name} +([0-9.]+)', text)[1]):.2g}"  # type: ignore[index]


def _effective() -> str:
    """The most of the network's points that exact games leave effective, over views and noise."""
    files = sorted((RESULTS / "learned").glob("errors_*.txt"))
    tables = [pd.read_csv(path, sep=r"\s*\|\s*", engine="python") for path in files]
    return f"{pd.concat(tables)['effective'].max():.0f}"


def _again(error: str) -> str:
    """How often intervals of medians of two runs on different draws meet."""
    text = (RESULTS / "again/same_ranks.txt").read_text()
    found = re.search(rf"{error}: intervals meet in ([\d.]+)% of (\d+)", text)
    assert found
    return f"{found[1]} % of {int(found[2]):,}"


def _unknown(estimator: str, column: str, roads: bool = False, percent: bool = False) -> str:
    """Range over scenarios and views of the suite ``parameters``, or over its roads alone."""
    board = _table("parameters/leaderboard.csv")
    shown = board["scenario"].str.contains(", ") | (not roads)
    values = board[shown & (board["estimator"] == estimator)][column]
    low, high = values.min(), values.max()
    return f"{100 * low:.0f} to {100 * high:.0f}" if percent else f"{low:.2g} to {high:.2g}"


def _constrained(ignorant: bool) -> str:
    """Range of the joint method's median cosine errors over scenarios, full sensor."""
    board = _table("constrained/leaderboard.csv")
    name = "kkt_constrained" + (", ignorant" if ignorant else "")
    found = board[(board["estimator"] == name) & (board["sensor"] == "full")]["cosine_error_median"]
    return f"{found.min():.2g} to {found.max():.2g}"


VALUES: dict[str, Callable[[], str]] = {
    **{
        f"people.{name}{part}": partial(_people, road, *given)
        for name, road in (("us", "US-101"), ("lankershim", "Lankershim"))
        for part, given in ON_BOTH_ROADS.items()
    },
    **{
        f"people.nash{part}": partial(_people, "Nash", *ON_BOTH_ROADS[part], file="nash_summary")
        for part in (".weights", ".imperfect")
    },
    "people.held": _held,
    "results.old": lambda: f"{len(old())} of {len(SUITES) + len(MODULES)}",
    "behaviours.motions": lambda: str(_decided()[0]),
    "behaviours.decided": lambda: str(_decided()[1]),
    "behaviours.right": lambda: str(_decided()[2]),
    "behaviours.undecided": lambda: str(_decided()[0] - _decided()[1]),
    **{
        f"behaviours.{name}": partial(_residual, name)
        for name in ("feedback", "responding", "leading", "alone", "straight")
    },
    "encounters.gain": partial(_encounter, "4", "map", "uniform"),
    "encounters.p": partial(_encounter, "4", "map", "uniform", "p"),
    "encounters.gain.all": partial(_encounter, "all", "map", "uniform"),
    "encounters.gain.all.p": partial(_encounter, "all", "map", "uniform", "p_holm"),
    "encounters.truth": partial(_encounter, "all", "map", "oracle"),
    "encounters.fewer.p": partial(
        _encounter, "all", "map", "constant_velocity", "p_holm", "collision"
    ),
    "encounters.value": lambda: (
        f"{100 * _row('encounters/quarters.csv', quarter='4', planner='map')['value']:.1f}"
    ),
    "encounters.straight": partial(_encounter, "all", "map", "constant_velocity"),
    "encounters.straight.p": partial(_encounter, "all", "map", "constant_velocity", "p_holm"),
    "encounters.map": partial(_drives, "map", "collisions"),
    "encounters.oracle": partial(_drives, "oracle", "collisions"),
    "encounters.constant": partial(_drives, "constant_velocity", "collisions"),
    "encounters.drives": partial(_drives, "map", "drives"),
    "encounters.cycle": partial(_drives, "map", "cycle_99"),
    "encounters.contingency": partial(_drives, "map_contingency", "collisions"),
    "encounters.samples": partial(_drives, "map_contingency", "cycle_99"),
    "roads.map.score": partial(_score, "map", False),
    "roads.map.gain": partial(_score, "map", True),
    "posterior.regions": lambda: f"{_regions()[0]:,}",
    "posterior.held": lambda: f"{_regions()[1]:,}",
    "posterior.share": _regions_share,
    "roads.recognised": _recognised,
    "predictions.map": partial(_ahead, "map", 2),
    "predictions.stock": partial(_ahead, "stock_fitted", 1),
    **{f"driving.{name}": partial(_driving, name) for name in ("map", "stock", "ppo")},
    "again.meet": partial(_again, "position_error"),
    "again.cosine": partial(_again, "cosine_error"),
    "references.c2st": _c2st,
    "learned.effective": _effective,
    "ahead.told": partial(_ahead_of_map, "as told", "imperfect"),
    "ahead.replanning": partial(_ahead_of_map, "replanning 0.4", "imperfect"),
    "ahead.stock": partial(_ahead_of_map, "stock 1", "imperfect"),
    "ahead.bias": partial(_ahead_of_map, "bias 1", "imperfect"),
    "ahead.lagged": partial(_ahead_of_map, "lagged_noise 0.8", "imperfect"),
    "ahead.entropic": partial(_ahead_of_map, "entropic 0.01", "imperfect"),
    "ahead.entropic.truth": partial(_ahead_of_map, "entropic 0.01", "truth"),
    "conformal.held": partial(_conformal, "held"),
    "conformal.told": partial(_conformal, "held_as_told"),
    "unknown.bound": partial(_bound, "weights/bound"),
    "unknown.bound.parameters": partial(_bound, "parameters/bound"),
    "unknown.speeds": partial(_unknown, "kkt_constrained", "parameter_error_median", True),
    "unknown.ukf": partial(_unknown, "ukf", "parameter_error_median"),
    "unknown.uniform": partial(_unknown, "uniform", "parameter_error_median"),
    "unknown.held": partial(_unknown, "ukf", "covers_parameters_share", False, True),
    "unknown.narrow": partial(_unknown, "kkt_constrained", "covers_parameters_share", True, True),
    "constrained.ms": partial(_merging, "median"),
    "constrained.faster": partial(_merging, "ratio"),
    "constrained.known": partial(_constrained, False),
    "constrained.ignorant": partial(_constrained, True),
    "perf.two": partial(_inverse, "two_player", "compact"),
    "perf.five": partial(_inverse, "highway_overtaking", "compact"),
    "perf.two.published": partial(_inverse, "two_player", "published"),
    "perf.five.published": partial(_inverse, "highway_overtaking", "published"),
    "perf.two.zero": partial(_inverse, "two_player", "published, zero"),
    "perf.five.zero": partial(_inverse, "highway_overtaking", "published, zero"),
    "perf.two.ms": partial(_inverse, "two_player"),
    "perf.five.ms": partial(_inverse, "highway_overtaking"),
    **{
        f"damage.{estimator}.{change}": partial(_damage, change, dial, estimator)
        for estimator in ("robust", "posterior")
        for change, dial in (("outliers", 0.05), ("lagged_noise", 0.8))
    },
}
