from functools import partial
from operator import getitem
from pathlib import Path

import pytest

from olne_bench.bench.process import nursery
from olne_bench.bench.process.child import Child, DiedError
from olne_bench.bench.report.figures import draw_rows, style
from olne_bench.bench.report.figures.beside import DrawnBeside
from olne_bench.bench.report.parts import Parts, parts_of
from olne_bench.bench.report.study import USUAL
from olne_bench.errors import UserError


@pytest.fixture
def parts(make_trials) -> Parts:
    """Trials that a process can be sent."""
    trials = make_trials(sensors=("full",), seeds=1, sigmas=(0.1,))
    return Parts(parts_of(trials).outline, partial(getitem, {"two_player": trials}))


@pytest.fixture
def begun():
    nursery.begin([])


def drawn(parts: Parts, folder: Path) -> tuple[dict, list[str], dict[str, bytes]]:
    with DrawnBeside(parts, folder, ("png",), USUAL) as beside:
        pictures, notes = beside.drawn()
    return pictures, notes, {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.usefixtures("begun")
def test_figures_are_those_that_are_drawn_here(parts, tmp_path, monkeypatch):
    here = draw_rows(parts, tmp_path / "here", ("png",), USUAL)
    monkeypatch.setattr(style, "save", None)  # this process could not
    pictures, notes, files = drawn(parts, tmp_path / "there")
    assert (pictures, notes) == here
    assert files == {f.name: f.read_bytes() for f in (tmp_path / "here").iterdir()}
    assert "errors_two_player.png" in files


@pytest.mark.usefixtures("begun")
def test_a_process_that_dies_is_made_up_for(parts, tmp_path, monkeypatch):
    monkeypatch.setattr(Child, "wait", dies)
    pictures, _, files = drawn(parts, tmp_path / "new")
    assert set(pictures["two_player"]) >= {"errors", "failures"}
    assert "errors_two_player.png" in files


def dies(child: Child, _: object) -> None:
    child.stop()
    raise DiedError("killed", outside=True, served=0)


@pytest.mark.usefixtures("begun")
def test_a_folder_that_cannot_be_written_is_said(parts, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot write to"):
        drawn(parts, tmp_path / "file")


@pytest.mark.usefixtures("begun")
def test_without_formats_nothing_is_drawn(parts, tmp_path):
    with DrawnBeside(parts, tmp_path, (), USUAL) as beside:
        assert beside.drawn() == ({}, [])
