"""Options that commands share: what they take, up to which edge, and what they say otherwise."""

from pathlib import Path

import click
import pytest

from olne_bench.bench.commands.options import (
    BUDGET,
    JOBS,
    PATH,
    PLUGIN,
    Finite,
    FiniteRange,
    memory_option,
    name_and_value,
    path_problem,
)
from olne_bench.errors import UserError


@click.command()
@memory_option("what it limits")
def limited(memory: float) -> None:
    """Prints its limit."""
    click.echo(repr(memory))


def memory(*words: str) -> str | None:
    """What the command is given; None where it is refused."""
    from click.testing import CliRunner

    result = CliRunner().invoke(limited, words)
    return result.output.strip() if result.exit_code == 0 else None


@pytest.mark.parametrize(
    ("text", "taken"),
    [("0.5", True), ("0.49", False), (str(2**20), True), (str(2**20 + 1), False), ("nan", False)],
)
def test_memory_is_what_a_process_needs_to_more_than_there_is(text, taken):
    assert memory("--memory", text) == (repr(float(text)) if taken else None)


def test_memory_has_a_default_that_is_shown():
    default = memory()
    assert default is not None and 1 <= float(default) <= 16
    from click.testing import CliRunner

    said = CliRunner().invoke(limited, ["--help"]).output
    assert "what it limits" in said and default in said and "GIB" in said


@pytest.mark.parametrize(
    ("kind", "text", "taken"),
    [
        (JOBS, "1", True),
        (JOBS, "0", False),
        (JOBS, "1024", True),
        (JOBS, "1025", False),
        (JOBS, "1.5", False),
        (BUDGET, "1e-9", True),
        (BUDGET, "0", False),
        (BUDGET, "1e9", True),
        (BUDGET, "inf", False),
        (Finite(), "-inf", False),
        (Finite(), "nan", False),
        (Finite(), "-1e300", True),
        (FiniteRange(), "-inf", False),
        (FiniteRange(), "-1e300", True),
        (FiniteRange(max=3), "nan", False),
        (FiniteRange(max=3), "3.1", False),
    ],
)
def test_numbers_are_taken_within_their_range(kind, text, taken):
    if taken:
        assert kind.convert(text, None, None) == float(text)
        return
    with pytest.raises(click.BadParameter, match=text):
        kind.convert(text, None, None)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("runs/mine.toml", ""),
        ("a" * 200 + "/" + "b" * 200, ""),
        ("a" * 201, "a name has at most 200 bytes"),
        ("runs/" + "a" * 201 + "/c", "a name has at most 200 bytes"),
        ("ü" * 100, ""),
        ("ü" * 101, "a name has at most 200 bytes"),
        ("", "names no file"),
        ("  ", "names no file"),
        ("a\nb", "control characters"),
        ("a\x1b[31m", "control characters"),
    ],
)
def test_names_of_files_are_printable_and_short(text, problem):
    assert problem in path_problem(text)
    assert bool(problem) == bool(path_problem(text))
    for kind, same in ((PATH, Path(text)), (PLUGIN, text)):
        if not problem:
            assert kind.convert(text, None, None) == same
            continue
        with pytest.raises(click.BadParameter) as caught:
            kind.convert(text, None, None)
        assert problem in caught.value.message


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("players=3", ("players", 3)),
        ("rate=1e-3", ("rate", 1e-3)),
        ("on=true", ("on", True)),
        ("names=[1, 2]", ("names", [1, 2])),
        ("mode=fast", ("mode", "fast")),
        ("mode=a=b", ("mode", "a=b")),
        ("empty=", ("empty", "")),
        ("deep=" + "[" * 100_000, ("deep", "[" * 100_000)),
        ("long=" + "1" * 5000, ("long", "1" * 5000)),
    ],
)
def test_a_value_is_json_or_text(text, expected):
    assert name_and_value("--parameter", text) == expected


@pytest.mark.parametrize("text", ["players", "=3", "", "="])
def test_a_value_needs_a_name(text):
    with pytest.raises(UserError, match=f"--parameter '{text}': expected NAME=VALUE"):
        name_and_value("--parameter", text)
