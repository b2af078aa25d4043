"""Who is in tracks: rows without a name, ids that another car has had before, and who is no car."""

import re

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.text import listed
from olne_bench.errors import UserError

LONGEST_ABSENCE = 60.0  # [s]; a car that comes back later is another car with the same id
#: Medians of cars beyond these [m, m/s] are in other units.
_SHORTEST, _LONGEST, _FAST, _SLOW = 2.5, 9.0, 50.0, 0.05
_ABSENT_STEPS = 20  # of the data that it is away at least
_MOTORISED = {"motorcycle", "motorbike", "moped", "scooter", "motor"}
#: Parts of names of classes that do not drive on lanes as cars do.
_OTHERS = {
    *("pedestrian", "pedestrians", "ped", "pedtype", "person", "vru", "animal", "wheelchair"),
    *("bicycle", "bicycles", "bike", "biketype", "cyclist", "bicyclist", "cycle"),
    *("static", "parked", "trailer", "container", "containertype", "construction", "boundary"),
    *("building", "pillar", "median", "train", "tram", "rail", "railtype", "obstacle", "ship"),
}


def named(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Rows that have a player, each once, and notes on others."""
    lacks = table["player"].fillna("").str.strip().str.lower().isin(["", "nan"])
    if len(table) and lacks.all():
        raise UserError("none of its rows has a player")
    again = ~lacks & table.duplicated()
    what = {"without a player": lacks.sum(), "that repeat another": again.sum()}
    notes = [f"left out: {count} rows {which}" for which, count in what.items() if count]
    return table[~lacks & ~again], notes


def told_apart(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """The table with another name for a car that has the id of one seen long before, and a note."""
    rows = table.sort_values("time", kind="stable")
    apart = rows.groupby("player")["time"].diff()
    away = apart > max(LONGEST_ABSENCE, _ABSENT_STEPS * apart.median())
    if not away.any():
        return table, []
    again = away.groupby(rows["player"]).cumsum().reindex(table.index)
    mark = "#"
    while table["player"].str.contains(mark, regex=False).any():
        mark += "#"
    later = again > 0
    names = table["player"].mask(later, table["player"] + mark + (again + 1).astype(str))
    cars = listed(list(names[later].unique()))
    note = f"an id that comes back after more than {LONGEST_ABSENCE:g} s is another car: {cars}"
    return table.assign(player=names), [note]


def is_vehicle(kind: object) -> bool:
    """Whether a class is one of cars, or not known; motorcycles are vehicles, cyclists are not."""
    if not isinstance(kind, str):
        return True
    words = set(re.findall("[a-z]+", re.sub("([a-z])([A-Z])", r"\1 \2", kind).lower()))
    return bool(words & _MOTORISED) or not words & _OTHERS


def vehicles(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Rows of vehicles, and a note on others."""
    kinds = table.groupby("player", sort=False)["class"].first()
    others = kinds[[not is_vehicle(kind) for kind in kinds]]
    if others.empty:
        return table, []
    told = listed([f"{player} ({kind})" for player, kind in others.items()])
    if len(others) == len(kinds):
        raise UserError(f"nobody is a vehicle: {told}; --players takes them by name")
    return table[~table["player"].isin(others.index)], [
        f"left out, no vehicles: {told}; --players takes them by name"
    ]


def unit_doubts(table: pd.DataFrame) -> list[str]:
    """Warnings on lengths and speeds that vehicles have in other units, such as feet."""
    kinds = table.groupby("player")["class"].first()
    heavy = kinds.astype(str).str.contains("truck|bus", case=False)
    cars = table[table["player"].isin(kinds.index[~heavy & kinds.map(is_vehicle)])]
    players = cars.dropna(subset=["x", "y"]).sort_values("time").groupby("player")
    length = players["length"].median().replace(0, np.nan).median()
    first, last = players[["time", "x", "y"]].first(), players[["time", "x", "y"]].last()
    moved = last - first
    speed = (np.hypot(moved["x"], moved["y"]) / moved["time"].replace(0, np.nan)).median()
    doubts = []
    if length < _SHORTEST or length > _LONGEST:
        doubts.append(f"vehicles are {length:.3g} m long in the median")
    if speed > _FAST or 0 < speed < _SLOW:
        doubts.append(f"vehicles move at {speed:.3g} m/s in the median")
    unit = "kilometres" if speed < _SLOW else "feet"
    return [f"warning: {doubt}; expected metres, are these {unit}?" for doubt in doubts]
