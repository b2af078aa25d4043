"""Summaries of sources are kept, and only those of our own are read."""

import pytest

from olne_bench.bench.plan import source_summary
from olne_bench.bench.plan.source_summary import Import, Summary, summarised

SOURCE = b'''"""The text of a docstring_v1."""
import numpy as np, os.path
from . import near
from ..far import one, two

def world():
    """Another."""
    return "highway_v0"  # said
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache-sources"


@pytest.fixture
def made(monkeypatch):
    """Sources that were read anew."""
    sources = []

    def make(source, own=source_summary._made):
        sources.append(source)
        return own(source)

    monkeypatch.setattr(source_summary, "_made", make)
    return sources


@pytest.mark.usefixtures("folder")
def test_a_summary_has_code_imports_and_worlds():
    found = summarised(SOURCE)
    assert found.imports == (
        Import("numpy"),
        Import("os.path"),
        Import("", ("near",), 1),
        Import("far", ("one", "two"), 2),
    )
    assert found.worlds == ("highway_v0",)
    assert found.code is not None
    assert "docstring" not in found.code and "said" not in found.code
    assert "def world():" in found.code


@pytest.mark.usefixtures("folder")
def test_what_is_no_python_has_no_code():
    assert summarised(b"x = = 1") == Summary(None)
    assert summarised(b"\x00") == Summary(None)


def test_a_source_is_read_once(folder, made):
    first = summarised(SOURCE)
    assert summarised(SOURCE) == first
    assert made == [SOURCE]
    summarised(SOURCE + b"\n")
    assert len(made) == 2
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("fault", ["damaged", "empty", "writable by others", "a link"])
def test_a_kept_summary_that_cannot_be_trusted_is_not_read(folder, made, fault, tmp_path):
    first = summarised(SOURCE)
    (path,) = folder.iterdir()
    if fault == "damaged":
        path.write_bytes(path.read_bytes()[:-5])
    elif fault == "empty":
        path.write_bytes(b"")
    elif fault == "writable by others":
        path.chmod(0o666)
    else:
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    assert summarised(SOURCE) == first
    assert len(made) == 2


def test_a_folder_that_others_may_write_to_is_not_used(folder, made):
    folder.mkdir()
    folder.chmod(0o777)
    summarised(SOURCE)
    summarised(SOURCE)
    assert len(made) == 2
    assert list(folder.iterdir()) == []


def test_only_so_many_are_kept(folder, monkeypatch):
    monkeypatch.setattr(source_summary, "_MOST", 3)
    for number in range(5):
        summarised(f"x = {number}".encode())
    assert len(list(folder.iterdir())) == 3
