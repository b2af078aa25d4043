"""SUMO's floating car data (``--fcd-output``): XML with a row per vehicle and time step.

Positions are those of the centre of the front bumper; angles are in degrees clockwise from north.
"""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from olne_bench.envs.tracks.table import COLUMNS, MOST_BYTES, Tracks, plain_float
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_input

DESCRIPTION = "SUMO: XML of --fcd-output; lanes from its network by --road FILE.net.xml"
LENGTH = 5.0  # [m], SUMO's default length of a passenger car


def read(path: Path, part: str | None) -> Tracks:
    """Read the vehicles; see ``track_formats``."""
    if part is not None:
        raise UserError(f"--part {part!r}: files of this format have no parts")
    check_input("tracks file", path, MOST_BYTES)
    what = f"{path} is not floating car data of SUMO"
    with bad_input(what, OSError):
        rows = pd.DataFrame(
            _vehicles(path, what), columns=["time", "player", "x", "y", "angle", "speed"]
        )
    heading = np.deg2rad(90 - rows["angle"])
    table = rows.assign(
        heading=heading,
        x=rows["x"] - LENGTH / 2 * np.cos(heading),
        y=rows["y"] - LENGTH / 2 * np.sin(heading),
    )
    note = f"SUMO gives positions of front bumpers; cars are assumed to be {LENGTH:g} m long"
    return Tracks(table[list(COLUMNS)], notes=(note,))


def _vehicles(path: Path, what: str) -> Iterator[tuple[float, str, float, float, float, float]]:
    time = np.nan
    for event, element in ElementTree.iterparse(path, events=("start", "end")):
        if element.tag == "timestep":
            if event == "start":
                time = plain_float(element.attrib["time"])
            else:
                element.clear()
        elif element.tag == "vehicle" and event == "end":
            known = element.attrib
            with bad_input(f"{what}: vehicle {known.get('id')!r} at time {time:g}"):
                x, y, angle, speed = (
                    plain_float(known[name]) for name in ("x", "y", "angle", "speed")
                )
                yield time, known["id"], x, y, angle, speed
