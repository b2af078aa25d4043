"""The commands of docs/recordings.md, run one after the other as by a reader."""

import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.envs.recordings.recording_file import read_recording
from olne_bench.envs.tracks.road_file import read_road_file

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "recordings.md").read_text()


def blocks(language: str) -> list[str]:
    """The fenced code blocks of a language."""
    fenced = PAGE.split("```")[1::2]
    return [
        rest for name, _, rest in (block.partition("\n") for block in fenced) if name == language
    ]


def assert_same_but_for_dots(shown: str, printed: str) -> None:
    """Lines are those that were printed, in their order; `...` stands for any number of them."""
    parts = [[line.split() for line in part.splitlines()] for part in shown.split("...\n")]
    lines = [line.split() for line in printed.splitlines()]
    for part in parts:
        starts = [i for i in range(len(lines)) if lines[i : i + len(part)] == part]
        assert starts, f"not printed: {part}"
        lines = lines[starts[0] + len(part) :]


@pytest.mark.long
def test_every_command_does_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    said = {}
    for line in "".join(blocks("sh")).splitlines():
        command, _, comment = line.partition("#")
        words = shlex.split(command)
        assert words[0] == "olne-bench"
        _, refused, reason = comment.partition("refused: ")
        if refused:
            with pytest.raises(SystemExit):
                main(words[1:])
            assert reason in capsys.readouterr().err
        else:
            main(words[1:])
            said[command.strip()] = capsys.readouterr()
    truth = read_recording("two_way.parquet").metadata
    names = truth.weight_names
    assert names is not None
    table = pd.read_csv("weights.csv")
    np.testing.assert_allclose(table[names], truth.episodes[0].weights, atol=1e-3)
    errors = table[[f"{name}_error" for name in names]]
    assert ((errors > 0) & (errors < 0.1)).all(axis=None)
    (shown,) = blocks("")
    printed = said["olne-bench estimate tracks.parquet --out weights.csv"].out
    assert_same_but_for_dots(shown, printed)
    guessed = said["olne-bench estimate guessed.parquet --scenario two_way"]
    assert "warning: targets guessed from the data (source 'data'): lanes;" in guessed.err
    assert "median speed, then estimated" in guessed.out
    assert "targets that were estimated:" in guessed.out
    known: dict[str, object] = {}
    exec(blocks("python")[0], known)
    assert np.shape(known["states"]) == (20, 3, 4) and np.shape(known["weights"]) == (3, 4)


def test_the_road_file_of_the_page_is_one(tmp_path: Path) -> None:
    path = tmp_path / "road.toml"
    path.write_text(blocks("toml")[0])
    known = read_road_file(path)
    assert known.players["7"].lanes == ["left", "bend"]
    road = known.road()
    assert road is not None and len(road.lanes["bend"].curves) == 2
