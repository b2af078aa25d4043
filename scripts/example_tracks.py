"""Write small synthetic files in every format of tracks, from one motion.

    olne-bench record highway --out highway.parquet
    olne-bench export highway.parquet --out examples/tracks/highway.csv
    python scripts/example_tracks.py examples/tracks

The second command writes the motion: five cars at equilibrium on HighwayEnv's highway. This script
reads it and writes it in the formats of highD, inD, NGSIM, INTERACTION, SUMO and CommonRoad. The
fifth car comes into view late. These files contain no licensed data.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pyproj import Proj
from scipy.interpolate import CubicSpline

from olne_bench.envs.track_formats.ngsim import FOOT
from olne_bench.envs.tracks.export import CAR_LENGTH, CAR_WIDTH, Episode, write_commonroad
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.envs.tracks.road_file import (
    PlayerEntry,
    RoadFile,
    read_road_file,
    write_road_file,
)

LATE = 0.8  # [s]; the last car is not seen before
DECIMALS = 6
LANES = (0.0, 4.0, 8.0, 12.0)  # [m], y of HighwayEnv's lanes


def sampled(times: np.ndarray, states: np.ndarray, rate: float) -> pd.DataFrame:
    """A row for each car and sample: cubic splines through states (T, N, 4), at ``rate`` [Hz].

    Columns are time, frame, car (from 1 on), x, y, heading, speed, vx and vy.
    """
    at = np.arange(round((times[-1] - times[0]) * rate) + 1) / rate
    smooth = CubicSpline(times - times[0], states)(at)
    frames = []
    for i in range(states.shape[1]):
        frame = pd.DataFrame(smooth[:, i], columns=["x", "y", "heading", "speed"])
        frame = frame.assign(time=at, car=i + 1)
        frames.append(frame[at >= LATE - 1e-9] if i + 1 == states.shape[1] else frame)
    rows = pd.concat(frames, ignore_index=True)
    rows["frame"] = np.rint(rows["time"] * rate).astype(int)
    rows["vx"] = rows["speed"] * np.cos(rows["heading"])
    rows["vy"] = rows["speed"] * np.sin(rows["heading"])
    return rows


def highd(rows: pd.DataFrame) -> dict[str, Any]:
    """25 frames per second, upper left corners of boxes."""
    return {
        **{"frame": rows["frame"] + 1, "id": rows["car"]},
        **{"x": rows["x"] - CAR_LENGTH / 2, "y": rows["y"] - CAR_WIDTH / 2},
        **{"width": CAR_LENGTH, "height": CAR_WIDTH},
        **{"xVelocity": rows["vx"], "yVelocity": rows["vy"]},
    }


def ind(rows: pd.DataFrame) -> dict[str, Any]:
    """Centres, and headings in degrees."""
    return {
        **{"recordingId": 1, "trackId": rows["car"], "frame": rows["frame"]},
        **{"xCenter": rows["x"], "yCenter": rows["y"]},
        "heading": np.rad2deg(rows["heading"]) % 360,
        **{"width": CAR_WIDTH, "length": CAR_LENGTH},
        **{"xVelocity": rows["vx"], "yVelocity": rows["vy"]},
    }


def ngsim(rows: pd.DataFrame) -> dict[str, Any]:
    """Feet, and the centre of the front."""
    return {
        **{"Vehicle_ID": rows["car"], "Frame_ID": rows["frame"] + 1},
        "Global_Time": 1118846980200 + 100 * rows["frame"],
        **{"Local_X": rows["y"] / FOOT, "Local_Y": (rows["x"] + CAR_LENGTH / 2) / FOOT},
        **{"v_Length": CAR_LENGTH / FOOT, "v_Width": CAR_WIDTH / FOOT},
        "v_Vel": rows["speed"] / FOOT,
        "Lane_ID": np.abs(rows["y"].to_numpy()[:, None] - LANES).argmin(axis=1) + 1,
    }


def interaction(rows: pd.DataFrame) -> pd.DataFrame:
    """Milliseconds, and a second case with the same names of cars."""
    frame = rows["frame"] + 1
    columns = {
        **{"case_id": 1.0, "track_id": rows["car"], "frame_id": frame},
        **{"timestamp_ms": 100 * frame, "agent_type": "car"},
        **{name: rows[name] for name in ("x", "y", "vx", "vy")},
        **{"psi_rad": rows["heading"], "length": CAR_LENGTH, "width": CAR_WIDTH},
    }
    table = pd.DataFrame(columns)
    return pd.concat([table, table[table["frame_id"] <= 4].assign(case_id=2.0)])


def write_highd_targets(folder: Path) -> None:
    """Write the targets of ``highway.toml`` for the cars and the lanes of highD."""
    known, players = read_road_file(folder / "highway.toml"), {}
    for k, entry in enumerate(known.players.values(), start=1):
        lanes = [f"lower_{int(name[-1]) + 1}" for name in entry.lanes or []]
        players[str(k)] = PlayerEntry(targets=entry.targets, lanes=lanes)
    road = RoadFile(scenario=known.scenario, players=players)
    write_road_file(folder / "highd_tracks.toml", road)


def write_sumo(folder: Path, rows: pd.DataFrame) -> None:
    """Write SUMO's tracks (front bumpers, degrees clockwise from north) and its network."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<fcd-export>"]
    for time, frame in rows.groupby("time"):
        lines.append(f'    <timestep time="{time:.2f}">')
        for row in frame.to_dict("records"):
            x = row["x"] + CAR_LENGTH / 2 * np.cos(row["heading"])
            y = row["y"] + CAR_LENGTH / 2 * np.sin(row["heading"])
            angle = (90 - np.rad2deg(row["heading"])) % 360
            lines.append(
                f'        <vehicle id="car{row["car"]}" x="{x:.6f}" y="{y:.6f}" '
                f'angle="{angle:.6f}" type="DEFAULT_VEHTYPE" speed="{row["speed"]:.6f}" '
                'lane="road_0"/>'
            )
        lines.append("    </timestep>")
    (folder / "sumo_fcd.xml").write_text("\n".join([*lines, "</fcd-export>", ""]))
    lanes = [
        f'        <lane id="road_{k}" index="{k}" speed="30" length="1000" width="4" '
        f'shape="0,{y:g} 1000,{y:g}"/>'
        for k, y in enumerate(reversed(LANES))
    ]
    edge = ['    <edge id="road" from="a" to="b">', *lanes, "    </edge>"]
    (folder / "sumo.net.xml").write_text("\n".join(["<net>", *edge, "</net>", ""]))


def write_lanelet2(folder: Path) -> None:
    """Write the lanes of INTERACTION's cars and a footpath; one way runs against the others."""
    utm = Proj(proj="utm", zone=31, ellps="WGS84")
    east, north = utm(0, 0)
    sides = [LANES[0] - 4, *(lane - 2 for lane in LANES), LANES[-1] + 2]
    nodes, ways, relations = [], [], []
    for k, y in enumerate(sides):
        for end, x in ((1, 0.0), (2, 1000.0)):
            degrees = utm(east + x, north + y, inverse=True)
            longitude, latitude = (round(value, 9) + 0.0 for value in degrees)  # no -0
            nodes += [
                f'  <node id="{10 * k + end}" lat="{latitude:.9f}" lon="{longitude:.9f}">',
                f'    <tag k="local_x" v="{x:g}"/>',
                f'    <tag k="local_y" v="{y:g}"/>',
                "  </node>",
            ]
        refs = (10 * k + 2, 10 * k + 1) if k == 2 else (10 * k + 1, 10 * k + 2)
        ends = [f'    <nd ref="{ref}"/>' for ref in refs]
        ways += [f'  <way id="{100 + k}">', *ends, "  </way>"]
    for k in range(len(sides) - 1):
        relations += [
            f'  <relation id="{200 + k}">',
            f'    <member type="way" ref="{101 + k}" role="left"/>',
            f'    <member type="way" ref="{100 + k}" role="right"/>',
            '    <tag k="type" v="lanelet"/>',
            f'    <tag k="subtype" v="{"road" if k else "walkway"}"/>',
            "  </relation>",
        ]
    lines = ['<osm version="0.6">', *nodes, *ways, *relations, "</osm>", ""]
    (folder / "interaction.osm").write_text("\n".join(lines))


def write_all(folder: Path) -> None:
    """Write all files beside the folder's ``highway.csv``."""
    known = read_tracks(folder / "highway.csv").recording
    often, tenths = (sampled(known.times[0], known.states[0], rate) for rate in (25, 10))
    tables: dict[str, Any] = {
        "highd_tracks": highd(often),
        "ind_tracks": ind(tenths),
        "ngsim": ngsim(tenths),
        "interaction": interaction(tenths),
    }
    for name, table in tables.items():
        pd.DataFrame(table).round(DECIMALS).to_csv(folder / f"{name}.csv", index=False)
    markings = ";".join(f"{lane - 2:g}" for lane in LANES) + f";{LANES[-1] + 2:g}"
    text = f"id,frameRate,upperLaneMarkings,lowerLaneMarkings\n1,25,,{markings}\n"
    (folder / "highd_recordingMeta.csv").write_text(text)
    (folder / "ind_recordingMeta.csv").write_text("recordingId,frameRate\n1,10\n")
    write_highd_targets(folder)
    write_lanelet2(folder)
    write_sumo(folder, tenths)
    write_commonroad(folder / "commonroad.xml", Episode.of(known, 0))


if __name__ == "__main__":
    write_all(Path(sys.argv[1]))
