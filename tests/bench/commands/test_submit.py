"""Names of submissions, and where they go."""

from importlib import import_module
from pathlib import Path

import pytest

from olne_bench.bench.commands.cli import main

module = import_module("olne_bench.bench.commands.submit")


@pytest.fixture
def packed(monkeypatch) -> list[tuple[Path, str, Path]]:
    """What was packed."""
    calls: list[tuple[Path, str, Path]] = []

    def pack(folder: Path, name: str, out: Path) -> int:
        calls.append((folder, name, out))
        return 34

    monkeypatch.setattr(module, "pack", pack)
    monkeypatch.setattr(
        module, "kind_of", lambda folder: folder.name.partition("run of ")[2] or "trials"
    )
    return calls


def call(*words: object) -> int:
    """The exit code of a command."""
    try:
        main([str(word) for word in ("submit", *words)])
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.mark.parametrize(
    ("words", "name", "out"),
    [
        (["mine"], "mine", "results/submissions/mine"),
        (["runs/mine"], "mine", "results/submissions/mine"),
        (["runs/mine/../other"], "other", "results/submissions/other"),
        (["mine", "--name", "a_1.b-c"], "a_1.b-c", "results/submissions/a_1.b-c"),
        (["mine", "--out", "there"], "mine", "there"),
        (["mine", "--name", "a", "--out", "there"], "a", "there"),
    ],
)
def test_a_submission_has_a_name_and_a_place(packed, capsys, words, name, out):
    assert call(*words) == 0
    assert packed == [(Path(words[0]), name, Path(out))]
    said = f"{out}: 34 rows packed; check them with: olne-bench verify {out}"
    assert capsys.readouterr().out.strip() == said


@pytest.mark.parametrize(
    ("name", "taken"),
    [
        ("a", True),
        ("9", True),
        ("a" * 60, True),
        ("a" * 61, False),
        (".a", False),
        ("-a", False),
        ("_a", False),
        ("A", False),
        ("a b", False),
        ("a/b", False),
        ("ä", False),
        ("a\n", False),
    ],
)
def test_names_are_short_and_plain(packed, capsys, name, taken):
    assert call("mine", f"--name={name}") == (0 if taken else 2)
    assert len(packed) == taken
    if not taken:
        assert "a name has 1 to 60 of a-z" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["streams", "drives"])
def test_only_trials_are_submitted(packed, capsys, kind):
    assert call(f"a run of {kind}", "--name", "mine") == 2
    assert "only trials can be submitted" in capsys.readouterr().err
    assert packed == []
