"""The code blocks of the guide run, one after the other, as a reader would try them."""

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from olne_bench.bench.commands.cli import main
from olne_bench.envs import wrappers

ROOT = Path(__file__).parent.parent


def code_blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)


def test_environments_guide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"np": np, **vars(wrappers)}
    for block in code_blocks("environments.md"):
        exec(block, names)
        if "y" in names:
            assert names["y"].shape == (20, 5, 3)
            assert np.isnan(names["y"]).any()
    assert names["vector"].reset(seed=0)[0].shape == (8, 9)


def test_ten_lines_are_the_examples():
    for example, block in (
        ("play_olne.py", code_blocks("environments.md")[0]),
        ("highway_overtaking.py", code_blocks("../README.md")[-1]),
    ):
        assert (ROOT / "examples" / example).read_text().endswith(block)


def test_the_overtaking_film_shows_motion(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(code_blocks("../README.md")[-1], {})
    with Image.open("highway.gif") as film:
        assert film.n_frames == 20  # the horizon
        first = np.asarray(film.convert("RGB"), dtype=float)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"), dtype=float)
    assert first.std() > 10
    assert np.abs(first - last).max() > 50


def test_plugins_guide(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "plugins.md").read_text()
    names = ("predict", "crossing", "camera", "farthest")
    for name, block in zip(names, code_blocks("plugins.md"), strict=True):
        assert len([line for line in block.splitlines() if line]) <= 25
        Path(f"{name}.py").write_text(block)
    for line in re.findall(r"^olne-bench ([^#\n]*)", page, re.MULTILINE):
        words = shlex.split(line)
        if words[0] == "run":
            words += ["--seeds", "1", "--sigma", "0.01", "--no-figures"]  # a part of it will do
        main(words)
    said = capsys.readouterr().out
    for reference in ("predict.py:Predict", "crossing.py", "camera.py", "farthest.py"):
        assert f"{reference} conforms" in said
    rows = pd.read_parquet("runs/predict/trials.parquet")
    status = rows[rows["estimator"] == "predict"].set_index("sensor")["status"]
    assert dict(status) == {"full": "ok", "partial": "skipped"}
