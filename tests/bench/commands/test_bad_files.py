"""Bad files of tracks, roads and recordings: one line within seconds, exit code 2, nothing lost."""

import json
import os
import re
import resource
import shutil
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from olne_bench.bench.commands.cli import main

TRACKS = Path(__file__).parents[3] / "examples" / "tracks"
UNSEEN = "\x1b\x00\u202e\u2028"
PARTS = {
    "csv": ("highway.csv", "highway.toml"),
    "highd": ("highd_tracks.csv", "highd_recordingMeta.csv"),
    "ind": ("ind_tracks.csv", "ind_recordingMeta.csv"),
    "ngsim": ("ngsim.csv",),
    "interaction": ("interaction.csv", "interaction.osm"),
    "sumo": ("sumo_fcd.xml", "sumo.net.xml"),
    "commonroad": ("commonroad.xml",),
}
MORE = {
    "highd": ("--resample", "0.4"),
    "ind": ("--resample", "0.4"),
    "interaction": ("--part", "1", "--road", "interaction.osm"),
    "sumo": ("--road", "sumo.net.xml"),
}
VALUES = ("inf", "nan", "1e300", "5e-324", "-1", "", "abc", "1_0", "\x1b[2J", "\u202e", "9" * 5000)
SEEDS = range(8)


def ends(capsys, *arguments) -> str:
    """What is said on bad input, or nothing if the input is taken."""
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    code = 0
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as ended:
        code = ended.code
    said, errors = capsys.readouterr()
    assert code in (0, 2), errors
    assert not set(UNSEEN) & set(said + errors)
    assert time.process_time() - started < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 250_000  # [KiB]
    if code == 0:
        return ""
    assert said == "" and errors.count("\n") == 1 and len(errors) < 3000, errors
    assert errors.startswith("olne-bench: error: ")
    return errors


def refused(capsys, *arguments) -> str:
    errors = ends(capsys, *arguments)
    assert errors
    return errors


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copytree(TRACKS, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def damaged(data: bytes, random: np.random.Generator) -> bytes:
    """The content of a file with one damage: a number, a word, a line, some bytes or the end."""
    kind, text = random.integers(6), data.decode()
    if kind < 3:
        pattern = r"-?\d+\.?\d*" if kind < 2 else r"[A-Za-z_]{2,}"
        found = list(re.finditer(pattern, text))
        match = found[random.integers(len(found))]
        value = VALUES[random.integers(len(VALUES))]
        if kind == 1:  # everywhere
            return text.replace(match.group(), value).encode()
        return (text[: match.start()] + value + text[match.end() :]).encode()
    first, last = sorted(random.integers(len(data), size=2))
    if kind == 3:
        return data[:first]
    return data[:first] + (random.bytes(4) if kind == 4 else b"") + data[last:]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", PARTS)
def test_damaged_tracks_are_refused_or_read(capsys, folder, name, seed):
    random = np.random.default_rng([seed, *name.encode()])
    path = folder / PARTS[name][random.integers(len(PARTS[name]))]
    path.write_bytes(damaged(path.read_bytes(), random))
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    arguments = ("import", PARTS[name][0], "--format", name, *MORE.get(name, ()))
    if ends(capsys, *arguments, "--out", "out.parquet"):
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


FILES = {
    "empty": b"",
    "bytes": bytes(range(256)),
    "deep": b"<a>" * 100_000,
    "encoding": b'<?xml version="1.0" encoding="klingon"?><fcd-export/>',
    "another encoding": b'<?xml version="1.0" encoding="rot13"?><fcd-export/>',
    "entities": (
        b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a0 "aaaaaaaaaa">'
        + b"".join(b'<!ENTITY a%d "%s">' % (k + 1, b"&a%d;" % k * 10) for k in range(12))
        + b"]><fcd-export>&a12;</fcd-export>"
    ),
    "a long line": b"x" * 10**6,
}


@pytest.mark.parametrize("content", FILES)
@pytest.mark.parametrize("name", PARTS)
def test_what_is_no_file_of_tracks_is_refused(capsys, folder, name, content):
    (folder / "bad.xml").write_bytes(FILES[content])
    said = refused(capsys, "import", "bad.xml", "--format", name, "--out", "out.parquet")
    assert "bad.xml" in said


@pytest.mark.parametrize("content", FILES)
@pytest.mark.parametrize("road", ["bad.net.xml", "bad.osm", "bad.toml"])
def test_what_is_no_file_of_a_road_is_refused(capsys, folder, road, content):
    (folder / road).write_bytes(FILES[content] or b"x")
    given = ("ngsim.csv", "--format", "ngsim", "--road", road)
    assert road in refused(capsys, "import", *given, "--out", "out.parquet")


@pytest.mark.parametrize("name", PARTS)
def test_folders_pipes_and_huge_files_are_refused(capsys, folder, name):
    (folder / "folder").mkdir()
    os.mkfifo("pipe")
    with Path("huge").open("wb") as file:
        file.truncate(3 * 2**30)
    for path, words in {"folder": "it is a folder", "pipe": "no tracks", "huge": "at most"}.items():
        assert words in refused(capsys, "import", path, "--format", name, "--out", "out.parquet")
    with Path("large").open("wb") as file:  # not too large, but nothing that could be read
        file.truncate(200 * 2**20)
    refused(capsys, "import", "large", "--format", name, "--out", "out.parquet")


def test_elements_may_be_nested_deep(capsys, folder):
    deep = "<net>" + "<edge>" * 50_000 + "</edge>" * 50_000 + "</net>"
    (folder / "deep.net.xml").write_text(deep)
    arguments = ("import", "sumo_fcd.xml", "--format", "sumo", "--road", "deep.net.xml")
    assert "none of its 0 lanes" in refused(capsys, *arguments, "--out", "out.parquet")


ARC = "{kind = 'arc', centre = [0, 0], radius = 1, start_phase = 0, end_phase = 99},"
QUOTED = "'a',"
LANE = "[lanes.a]\npoints = [[0, 0], [9, 0]]\n"
#: Road files, and a part of what is said.
ROADS = {
    "deep": (f"x = {'[' * 3000}{']' * 3000}", "not a TOML file: maximum recursion depth"),
    "text": (LANE + "width = '3'", "lanes.a.width: Input should be a valid number"),
    "truth": (LANE + "width = true", "lanes.a.width: Input should be a valid number"),
    "nan": (LANE + "width = nan", "lanes.a.width: Input should be a finite number"),
    "negative": (LANE + "width = -1", "lanes.a.width: Input should be greater than 0"),
    "wide": (LANE + "width = 1e300", "lanes.a: a lane's width is 1e+300 m, expected 0 to 1000"),
    "unknown": (LANE + '"w\\u001b" = 3', "lanes.a.w\\x1b: Extra inputs are not permitted"),
    "long": (LANE + f"{'k' * 10**5} = 3", "kkk: Extra inputs"),
    "one point": ("[lanes.a]\npoints = [[0, 0]]", "at least two different points"),
    "one point twice": ("[lanes.a]\npoints = [[0, 0], [0, 0]]", "at least two different points"),
    "far": ("[lanes.a]\npoints = [[0, 0], [1e300, 0]]", "a point at 1e+300, beyond 1e+09 m"),
    "points": (f"[lanes.a]\npoints = [{'[0, 0],' * 10_001}]", "10001 points, at most 10000"),
    "turns": (f"[lanes.a]\ncurves = [{ARC * 11}]", "turns by 1089 rad"),
    "a lane's name": ('[lanes."\\u001b"]\npoints = [[0, 0], [9, 0]]', "a lane is called '\\x1b'"),
    "a long name": (f"[players.{'p' * 10**5}]", "a player is called 'ppp"),
    "a name of none": (LANE + f"following = ['{'b' * 10**5}']", "names the lane 'bbb"),
    "a target's name": ('[players.player_0.targets]\n"\\u202e" = 1', "is called '\\u202e'"),
    "a scenario's name": ('scenario = "\\u001b"', "a scenario is called '\\x1b'"),
    "fast": ("[players.player_0]\ntargets = {speed = 1e9}", "speed is 1e+09, beyond 100"),
    "far goal": ("[players.player_0]\ngoal = [1e300, 0]", "goal is 1e+300, beyond 1e+09"),
    "blend": (LANE + "[players.player_0]\nlanes = ['a']\nblend = 1e300", "blend: Input should be"),
    "route": (LANE + f"[players.player_0]\nlanes = [{QUOTED * 10**5}]", "at most 1000 items"),
    "large": ("#" * 3 * 10**6, "has 3000000 bytes, at most 2000000 are read"),
}


@pytest.mark.parametrize("case", ROADS)
def test_bad_roads_are_refused(capsys, folder, case):
    text, words = ROADS[case]
    (folder / "bad.toml").write_text(text)
    said = refused(capsys, "import", "highway.csv", "--road", "bad.toml", "--out", "out.parquet")
    assert words in said and "bad.toml" in said
    assert not (folder / "out.parquet").exists()


@pytest.mark.parametrize("name", ["highd", "ind", "ngsim", "interaction"])
def test_columns_are_never_shifted(capsys, folder, name):
    path = folder / PARTS[name][0]
    first, *rows = path.read_text().splitlines()
    path.write_text("\n".join([first, *(f"{row},7" for row in rows)]))
    arguments = ("import", path.name, "--format", name, *MORE.get(name, ()))
    assert "its rows have more cells than" in refused(capsys, *arguments, "--out", "out.parquet")


def test_notes_show_what_columns_are_called(capsys, folder):
    first, *rows = (folder / "highway.csv").read_text().splitlines()
    path = folder / "strange.csv"
    path.write_text("\n".join([first + ",\u202e\x1b[2J", *(f"{row},7" for row in rows)]))
    main(["import", path.name, "--road", "no_targets.toml", "--out", "out.parquet"])
    assert "not used: column \\u202e\\x1b[2J\n" in capsys.readouterr().err


# -- recordings ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A good recording: its table and its metadata."""
    path = tmp_path_factory.mktemp("good") / "good.parquet"
    main(["import", str(TRACKS / "highway.csv"), "--out", str(path)])
    table = pq.read_table(path)
    return table.to_pandas(), json.loads(table.schema.metadata[b"olne_bench"])


def written(path, frame, metadata):
    table = pa.Table.from_pandas(frame, preserve_index=False)
    entry = metadata if isinstance(metadata, bytes) else json.dumps(metadata).encode()
    pq.write_table(table.replace_schema_metadata({b"olne_bench": entry}), path)


def one(column, value):
    return lambda frame: frame.astype({column: float}).assign(
        **{column: frame[column].where(frame.index != 3, value)}
    )


ROWS = {
    "infinite": (one("px", np.inf), "its column 'px' is infinite in row 4"),
    "missing": (lambda frame: frame.assign(px=np.nan), "player 'player_0' has no position at any"),
    "far": (one("px", 1e300), "player 'player_3' is at a position of 1e+300, beyond 1e+09 m"),
    "turned": (one("heading", 1e300), "has a heading of 1e+300; expected radians"),
    "text": (lambda frame: frame.assign(px="a"), "its column 'px' holds large_string"),
    "truth": (lambda frame: frame.assign(px=True), "its column 'px' holds bool"),
    "twice": (lambda frame: frame.iloc[[*range(len(frame)), 3]], "player 3 has two rows at time 0"),
    "half a player": (one("player", 0.5), "its rows are not those of the players 0 to 4"),
    "another episode": (one("episode", 1), "a row of episode 1, its metadata have 1 episodes"),
    "half an episode": (one("episode", 0.5), "a row of episode 0.5"),
    "no time": (one("time", np.nan), "a time is nan, expected seconds"),
    "late": (one("time", 1e300), "a time is 1e+300, expected seconds"),
    "a gap": (lambda frame: frame[frame["time"] != 2.0], "its times are not 0.4 s apart"),
    "slow": (lambda frame: frame.assign(time=1e9 * frame["time"]), "times are not 0.4 s apart"),
    "none": (lambda frame: frame[:0], "its rows are not those of"),
    "no column": (lambda frame: frame.drop(columns="py"), "it has no column 'py', or several; it"),
}


@pytest.mark.parametrize("command", ["estimate", "export"])
@pytest.mark.parametrize("case", ROWS)
def test_damaged_rows_are_refused(capsys, folder, recorded, command, case):
    change, words = ROWS[case]
    frame, metadata = recorded
    written("bad.parquet", change(frame), metadata)
    said = refused(capsys, command, "bad.parquet", "--out", "out.csv")
    assert words in said and "bad.parquet" in said
    assert not (folder / "out.csv").exists()


def told(key, value):
    return lambda metadata: metadata | {key: value}


def entry(key, value):
    return lambda known: known | {"episodes": [known["episodes"][0] | {key: value}]}


METADATA = {
    **{
        f"dt {value!r:.9}": (told("dt", value), "dt")
        for value in (0, -1, float("nan"), float("inf"), "0.4", True, [0.4], None, 10**400)
    },
    "dt 5e-324": (told("dt", 5e-324), "its times are not 4.94066e-324 s apart"),
    "dt 1e300": (told("dt", 1e300), "its times are not 1e+300 s apart"),
    "a file": (told("scenario", "evil.py"), "a file can only name a built-in one"),
    "a class": (told("scenario", "evil.py:Evil"), "a file can only name a built-in one"),
    "an escape": (told("scenario", "\x1b"), "names the scenario '\\x1b'"),
    "a long name": (told("scenario", "s" * 5000), "a file can only name a built-in one"),
    "no episode": (told("episodes", []), "episodes: List should have at least 1 item"),
    "unseen": (entry("players", ["\x1b", *"bcde"]), "a player is called '\\x1b'"),
    "alike": (entry("players", [*"aacde"]), "its metadata name the player 'a' twice"),
    "a stranger": (entry("road", {"players": {"x": {}}}), "targets of player 'x', who is not in"),
    "states": (told("state_names", ["px", "py", "time"]), "it has no column 'time', or several"),
    "no JSON": (lambda _: b"[" * 10**5, "maximum recursion depth"),
    "digits": (lambda _: b"9" * 5000, "Exceeds the limit"),
    "large": (lambda _: b" " * 2**25 + b"1", "bytes, at most 33554432 are read"),
}


@pytest.mark.parametrize("case", METADATA)
def test_damaged_metadata_are_refused(capsys, folder, recorded, case):
    change, words = METADATA[case]
    (folder / "evil.py").write_text("open('ran', 'w')")
    frame, metadata = recorded
    written("bad.parquet", frame, change(metadata))
    assert words in refused(capsys, "estimate", "bad.parquet", "--out", "out.csv")
    assert not {"out.csv", "ran"} & {path.name for path in folder.iterdir()}


@pytest.mark.usefixtures("folder")
def test_other_columns_are_not_read(capsys, recorded):
    frame, metadata = recorded
    wide = frame.assign(**{f"x{k}": "text" * 10 for k in range(100)})
    written("wide.parquet", wide, metadata)
    assert ends(capsys, "export", "wide.parquet", "--out", "out.csv") == ""


@pytest.mark.usefixtures("folder")
def test_many_rows_are_refused_before_they_are_read(capsys, recorded):
    frame, metadata = recorded
    rows = 10**6
    columns = {name: pa.array(np.zeros(rows)) for name in frame}
    table = pa.table(columns).replace_schema_metadata(
        {b"olne_bench": json.dumps(metadata).encode()}
    )
    pq.write_table(table, "many.parquet")
    assert f"it has {rows} rows for 5 players, at most" in refused(
        capsys, "estimate", "many.parquet"
    )


@pytest.mark.parametrize("seed", range(12))
def test_damaged_bytes_are_refused_or_read(capsys, folder, recorded, seed):
    random = np.random.default_rng(seed)
    written("bad.parquet", *recorded)
    data = bytearray(Path("bad.parquet").read_bytes())
    for place in random.integers(len(data), size=5):
        data[place] = random.integers(256)
    Path("bad.parquet").write_bytes(data)
    if ends(capsys, "export", "bad.parquet", "--out", "out.csv"):
        assert not (folder / "out.csv").exists()


# -- where results go ------------------------------------------------------------------------


@pytest.mark.parametrize(("command", "suffix"), [("import", ".parquet"), ("estimate", ".csv")])
@pytest.mark.parametrize("place", ["taken", "folder", "link", "/proc/x", "none/x", "a\x1bb"])
def test_nothing_is_written_to_the_places_of_others(
    capsys, folder, recorded, command, suffix, place
):
    written("good.parquet", *recorded)
    (folder / f"taken{suffix}").write_text("precious")
    (folder / f"folder{suffix}").mkdir()
    (folder / f"link{suffix}").symlink_to("nowhere")
    before = sorted(path.name for path in folder.iterdir())
    given = "highway.csv" if command == "import" else "good.parquet"
    refused(capsys, command, given, "--out", f"{place}{suffix}")
    assert sorted(path.name for path in folder.iterdir()) == before
    assert (folder / f"taken{suffix}").read_text() == "precious"
