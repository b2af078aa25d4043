"""The documentation is true: its commands run, and its tables are those of results/.

The tutorials are notebooks, which run when the site is built (make docs).
"""

import re
import runpy
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

import olne_bench as ob
from olne_bench.bench.commands.cli import cli, main
from olne_bench.bench.commands.interface import COMMANDS
from olne_bench.envs.worlds import wrappers

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
#: Pages whose blocks run in ``test_a_page_runs``.
RUN_HERE = (
    "README.md",
    "docs/plugins.md",
    "docs/study_commands.md",
    "docs/highway.md",
    "docs/constraints.md",
    "docs/unknowns.md",
    "docs/online.md",
    "docs/choose_scenario.md",
    "docs/recipes.md",
    "docs/estimators.md",
)
#: Those of them that only ``.ci/run`` runs.
TAKES_LONG = ("README.md", "docs/study_commands.md")
#: Pages that have their own test: below, or in ``test_recordings_guide.py`` and
#: ``test_learning_guide.py``.
RUN_ELSEWHERE = ("docs/environments.md", "docs/recordings.md", "docs/learning.md")
#: A block of code, with the comment above it that says why nothing runs it.
BLOCK = re.compile(r"(?:<!-- not run: ([^\n]+) -->\n+)?```(\w*)\n(.*?)```", re.DOTALL)
FILE_NAME = re.compile(r"# ([\w.]+\.(?:py|toml))\n")
COMMAND = re.compile(r"(?:^|`)olne-bench ((?:[^`\n\\]|\\\n)+)", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    language: str
    text: str
    reason: str  # why it is not run; empty where it is


def name_of(page):
    return str(page.relative_to(ROOT))


def blocks(page):
    return [Block(found[2], found[3], found[1] or "") for found in BLOCK.finditer(page.read_text())]


def code_blocks(page):
    return [block.text for block in blocks(ROOT / page) if block.language == "python"]


def shortened(words, ending):
    """Shorten runs to a part of the suite.

    Args:
        words: words of the command.
        ending: option that says how much of a report ``run`` writes.
    """
    if words[0] != "run":
        return words
    added = {"--seeds": "1"}
    if not words[1].endswith(".toml"):
        added |= {"--scenario": "two_player", "--sigma": "0.05"}
    options = [word for name, value in added.items() if name not in words for word in (name, value)]
    return [*words, *options, ending]


def run_commands(text, ending):
    for line in text.replace("\\\n", " ").splitlines():
        program, *words = shlex.split(line, comments=True)
        assert program == "olne-bench", f"a test cannot run {line!r}: mark its block 'not run: why'"
        try:
            main(shortened(words, ending))
        except SystemExit as end:
            assert not end.code, line


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.long) if name in TAKES_LONG else name
        for name in RUN_HERE
    ],
)
def test_a_page_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks(ROOT / name):
        if block.reason:
            continue
        file = FILE_NAME.match(block.text)
        if file:
            Path(file[1]).write_text(block.text)
        elif block.language == "python":
            exec(block.text, names)
        elif block.language == "sh":
            # README shows what a run leaves; elsewhere the commands that follow need the trials.
            run_commands(block.text, "--no-figures" if name == "README.md" else "--no-report")
    if name == "docs/highway.md":
        check_film("highway.gif")


def check_film(path):
    """The cars of the overtaking film move, on frames that are not black."""
    with Image.open(path) as film:
        assert film.n_frames == 20  # the horizon
        first = np.asarray(film.convert("RGB"), dtype=float)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"), dtype=float)
    assert first.std() > 10
    assert np.abs(first - last).max() > 50


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_runs_somewhere_or_says_why_not(page):
    name = name_of(page)
    if name.startswith("docs/tutorials/") or name in (*RUN_HERE, *RUN_ELSEWHERE):
        return
    for block in blocks(page):
        runs = block.language in ("python", "sh", "")
        assert block.reason or not runs, f"{name}: nothing runs {block.text!r}"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_exist(page):
    for found in COMMAND.finditer(page.read_text()):
        words = shlex.split(found[1].replace("\\\n", " "), comments=True)
        if words[0].startswith("-"):
            continue
        assert words[0] in COMMANDS, found[0]
        command = cli.get_command(click.Context(cli), words[0])
        known = {"--help", *(o for p in command.params for o in (*p.opts, *p.secondary_opts))}
        options = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert options <= known, found[0]


def test_environments_guide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"np": np, **vars(wrappers)}
    for block in code_blocks("docs/environments.md"):
        exec(block, names)
        if "y" in names:
            assert names["y"].shape == (20, 5, 3)
            assert np.isnan(names["y"]).any()


def test_ten_lines_are_the_examples():
    for example, block in (
        ("play_olne.py", code_blocks("docs/environments.md")[0]),
        ("highway_overtaking.py", code_blocks("docs/highway.md")[-1]),
    ):
        assert (ROOT / "examples" / example).read_text().endswith(block)


def test_tables_are_those_of_the_results(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = runpy.run_path(str(ROOT / "scripts" / "docs_tables.py"))
    for name in script["PAGES"]:
        page = (ROOT / name).read_text()
        assert script["filled"](page) == page, f"{name}: run scripts/docs_tables.py"
        # A comment that begins a line ends a list or a paragraph.
        assert not re.search(r"^ *<!--=", page, re.MULTILINE), (
            f"{name}: move a number into its line"
        )


def test_readme_is_short_and_counts_the_estimators():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    assert f"{len(ob.estimators())}, behind one interface" in text


def test_one_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    for name, pattern in (
        ("CITATION.cff", r"^version: (.+)$"),
        ("README.md", r"^  version = \{(.+)\},$"),
        ("CHANGELOG.md", r"^## ([\d.]+)"),
    ):
        found = re.search(pattern, (ROOT / name).read_text(), re.MULTILINE)
        assert found is not None and found[1] == version, name


def test_the_picture_of_weights_tells_the_truth(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    picture = runpy.run_path(str(ROOT / "scripts" / "weight_picture.py"))
    hurried, careful = (picture["motion"](subject).states for subject in picture["SUBJECTS"])
    assert np.array_equal(hurried[0], careful[0])  # both start in the same way
    last = picture["SHOWN"][-1]
    gaps = [states[last, 1, 0] - states[last, 0, 0] for states in (hurried, careful)]
    assert gaps[1] > 1.5 * gaps[0]
    assert careful[last, 0, 3] < hurried[last, 0, 3] - 3
