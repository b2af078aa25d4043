"""Where a report is written: by a process that has imported what it needs, or here."""

from pathlib import Path

import pytest

from olne_bench.bench.commands import report
from olne_bench.bench.process import nursery
from olne_bench.bench.process.child import Child, DiedError
from olne_bench.errors import UserError


@pytest.fixture(autouse=True)
def begun() -> None:
    nursery.begin([])


def test_bad_input_is_said_by_whoever_writes(tmp_path):
    with pytest.raises(UserError, match="no run"):
        report.show_report(tmp_path, ())


def test_a_report_is_written_here_where_its_process_dies(monkeypatch, capsys):
    monkeypatch.setattr(Child, "call", dies)
    monkeypatch.setattr(report, "report_text", lambda folder, *_: f"{folder} is written")
    report.show_report(Path("runs"), ())
    assert capsys.readouterr().out == "runs is written\n"


def dies(child: Child, *_: object, **__: object) -> None:
    child.stop()
    raise DiedError("killed", outside=True, served=0)
