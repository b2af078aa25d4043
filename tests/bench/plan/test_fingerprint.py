"""A fingerprint changes with the code, but not with its comments, docstrings or formatting."""

from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

import olne_bench.envs
from olne_bench.bench.plan.fingerprint import fingerprint, modules_used

MAIN = '''"""Doc."""
import numpy
from helper import factor

class A:
    def estimate(self):
        """Doc."""
        return factor(), "table.csv", "more/*.csv", "**/*.txt"  # comment
'''
FILES = {
    "main.py": MAIN,
    "helper.py": "from deep import part\ndef factor():\n    return part.x\n",
    "deep/__init__.py": "",
    "deep/part.py": "import fast\nfrom . import other\nx = 1\n",
    "deep/other.py": "y = 1\nworld = 'world_v0'\n",
    "olne_bench/envs/world_v0.py": "w = 1\n",
    "unrelated.py": "z = 1\n",
    f"fast{EXTENSION_SUFFIXES[0]}": "1 machine code",
    "main.npz": "data",
    "table.csv": "data",
    "more/table.csv": "data",
    "more/notes.txt": "data",
}


@pytest.fixture
def folder(tmp_path):
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def taken(folder, tmp_path_factory):
    # Contents are remembered by path, so every look is at a copy.
    copy = tmp_path_factory.mktemp("copy")
    for name in FILES:
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_text((folder / name).read_text())
    return fingerprint({"main": copy / "main.py"}, {}, own=copy)


@pytest.mark.parametrize(
    ("name", "old", "new", "changes"),
    [
        ("main.py", "factor(),", "2 * factor(),", True),
        ("helper.py", "part.x", "-part.x", True),
        ("deep/part.py", "x = 1", "x = 2", True),
        ("deep/other.py", "y = 1", "y = 2", True),
        ("deep/__init__.py", "", "import os", True),
        ("olne_bench/envs/world_v0.py", "w = 1", "w = 2", True),
        (f"fast{EXTENSION_SUFFIXES[0]}", "1", "2", True),
        ("main.npz", "data", "other data", True),
        ("table.csv", "data", "other data", True),
        ("more/table.csv", "data", "other data", True),
        ("more/notes.txt", "data", "other data", False),
        ("unrelated.py", "z = 1", "z = 2", False),
        ("main.py", "  # comment", "", False),
        ("main.py", '"""Doc."""', '"""Another text."""', False),
        ("main.py", "return factor()", "return (\n            factor\n        )()", False),
    ],
)
def test_what_counts(folder, tmp_path_factory, name, old, new, changes):
    before = taken(folder, tmp_path_factory)
    path = folder / name
    path.write_text(path.read_text().replace(old, new))
    assert (taken(folder, tmp_path_factory) != before) == changes


def test_the_place_does_not_count(folder, tmp_path_factory):
    assert taken(folder, tmp_path_factory) == taken(folder, tmp_path_factory)


def test_a_fingerprint_has_twelve_hexadecimal_digits(folder, tmp_path_factory):
    text = taken(folder, tmp_path_factory)
    assert len(text) == 12
    assert set(text) <= set("0123456789abcdef")


def test_names_for_gymnasium_do_not_count():
    scenario = {"scene": Path(olne_bench.envs.__file__).parent / "worlds/scene.py"}
    roots = {"olne_bench.envs": Path(olne_bench.__file__).parents[1]}
    found = modules_used(scenario, roots, own=None)
    assert "olne_bench.envs" in found and "olne_bench.envs.worlds.gym_ids" not in found
