"""Hostile estimators in a run: each has its row, and no other row changes."""

import pandas as pd
import pytest
from corpus import GROUPS, HEADER, REFUSED, Hostile
from running import Run, write

from olne_bench.bench.process.sandbox import restrictions
from olne_bench.bench.run import describe_plugins as describing
from olne_bench.bench.run.describe_plugins import describe_all

#: Of those whose like is not in tests/bench/run/test_executor.py.
QUICK = [
    "KillsTheDriver",
    "BlocksSignals",
    "AsksForEverything",
    "HoardsInChildren",
    "LongException",
    "Recursive",
    "LazySequence",
    "RaisesBase",
    "ForksTwice",
    "SendsHalfAMessage",
    "ForgesAStage",
    "SendsAPickle",
    "ChangesEverything",
]


@pytest.fixture(scope="session")
def alone(tmp_path_factory) -> pd.DataFrame:
    """Rows of the good estimators in a run without hostile ones."""
    return Run(tmp_path_factory.mktemp("alone"), []).neighbours()


def rows_of(run: Run, group: list[Hostile]) -> dict[str, tuple[str, str]]:
    """Status and message of each, by name."""
    return {one.name: tuple(run.rows.loc[one.name, ["status", "message"]]) for one in group}


def check(folder, group: list[Hostile], alone: pd.DataFrame, limit: float = 4.0) -> None:
    run = Run(folder / "run", write(folder / "plugins", group), limit=limit)
    assert run.code == 0, run.said
    assert "Traceback" not in run.said
    assert run.left == []
    pd.testing.assert_frame_equal(run.neighbours(), alone, check_exact=True)
    found = rows_of(run, group)
    # A busy machine may stop for seconds: what was killed has another try, alone and without haste.
    slow = [one for one in group if found[one.name][0] == "timeout" and one.status != "timeout"]
    if slow:
        again = Run(folder / "again", write(folder / "slow", slow), limit=30.0)
        found |= rows_of(again, slow)
    wrong = {
        one.name: (found[one.name], one.status, one.phrase)
        for one in group
        if found[one.name][0] != one.status or one.phrase not in found[one.name][1]
    }
    assert wrong == {}
    assert all(len(message) <= 1000 and "\n" not in message for _, message in found.values())
    assert (folder / "run" / "neighbour.py").is_file()


@pytest.mark.skipif("signals to other processes" not in restrictions(), reason="needs Linux 6.12")
def test_each_kind_of_hostility_is_a_row_of_its_own(tmp_path, alone):
    group = [one for part in GROUPS.values() for one in part if one.name in QUICK]
    assert len(group) == len(QUICK)
    check(tmp_path, group, alone, limit=3.0)


@pytest.mark.corpus
@pytest.mark.parametrize("name", GROUPS)
def test_every_hostile_estimator_is_a_row_of_its_own(tmp_path, alone, name):
    # Filling the memory takes long on a busy machine, and ends at the limit.
    group = [one for one in GROUPS[name] if one not in REFUSED]
    check(tmp_path, group, alone, limit=30.0 if name == "memory" else 4.0)


def test_the_corpus_is_large_and_its_names_differ():
    names = [one.name for group in GROUPS.values() for one in group]
    assert len(names) >= 120
    assert len(set(names)) == len(names)


def refusal(folder, one: Hostile) -> str:
    (folder / "plugin.py").write_text(HEADER + one.code())
    (said,) = describe_all([(None, f"{folder / 'plugin.py'}:{one.name}", {})])
    return said.error


@pytest.mark.corpus
@pytest.mark.parametrize("one", REFUSED, ids=lambda one: one.name)
def test_what_cannot_be_imported_is_refused_in_one_line(tmp_path, one):
    error = refusal(tmp_path, one)
    assert one.phrase in error
    assert "\n" not in error and 0 < len(error) <= 1200


HANGS_AT_IMPORT = Hostile("Waits", "refused", "it takes more than", module="time.sleep(4321.25)")


def test_a_plugin_that_hangs_at_its_import_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(describing, "LOAD_LIMIT", 1.0)
    assert HANGS_AT_IMPORT.phrase in refusal(tmp_path, HANGS_AT_IMPORT)


def test_a_run_with_a_plugin_that_cannot_be_imported_does_not_begin(tmp_path):
    run = Run(tmp_path / "run", write(tmp_path / "plugins", REFUSED[:1]))
    assert run.code == 2
    assert run.said.splitlines()[-1].startswith("olne-bench: error: ")
    assert REFUSED[0].phrase in run.said
    assert "Traceback" not in run.said
    assert not run.out.exists()
    assert run.left == []
