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
    return "highway_v0", "table.csv", "a/*.npz", "/etc/passwd.txt", "../up.csv"  # said
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
    assert found.files == ("a/*.npz", "table.csv")
    assert found.code is not None


#: Code, and other code that a digest has to tell from it.
OTHER = {
    "name": ("x = 1", "y = 1"),
    "value": ("x = 1", "x = 2"),
    "type": ("x = 1", "x = 1.0"),
    "true": ("x = 1", "x = True"),
    "text": ("x = a", "x = 'a'"),
    "text of a text": ("x = 'a'", "x = \"'a'\""),
    "order": ("f(a, b)", "f(b, a)"),
    "grouping": ("a + (b + c)", "a + b + c"),
    "field": ("f(*a)", "f(**a)"),
    "keys": ("x = {**a, b: c}", "x = {b: c, **a}"),
    "lists": ("def f(a, /, b): pass", "def f(a, b, /): pass"),
    "branch": ("if a:\n    b\n    c", "if a:\n    b\nelse:\n    c"),
    "f-string": ("f'{a}{b}'", "f'{a}:{b}'"),
    "format": ("f'{a:3}'", "f'{a:4}'"),
    "no format": ("f'{a:3}'", "f'{a}'"),
    "docstring that is read": ("'a'\neval(__doc__)", "'b'\neval(__doc__)"),
    "docstring of a class": ("class A: 'a'\neval(A.__doc__)", "class A: 'b'\neval(A.__doc__)"),
}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("case", OTHER)
def test_other_code_has_another_digest(case):
    one, other = (summarised(text.encode()).code for text in OTHER[case])
    assert one != other


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("text", ["x = " + "-" * 100_000 + "1", "x" + ".a" * 100_000])
def test_code_that_is_nested_too_deep_is_no_code(text):
    assert summarised(text.encode()).code is None


@pytest.mark.usefixtures("folder")
def test_comments_docstrings_and_formatting_do_not_count():
    bare = b"import numpy as np, os.path\nfrom . import near\nfrom ..far import (one,\n  two)\n"
    bare += (
        b"def world( ): return 'highway_v0', 'table.csv', 'a/*.npz', '/etc/passwd.txt', '../up.csv'"
    )
    assert summarised(bare).code == summarised(SOURCE).code


@pytest.mark.usefixtures("folder")
def test_deep_code_has_a_digest():
    deep = "+".join(["x"] * 900)
    assert summarised(deep.encode()).code != summarised(f"{deep}+x".encode()).code


@pytest.mark.usefixtures("folder")
def test_all_versions_of_python_agree():
    """Their parsers and printers differ in f-strings and in fields that are mostly empty."""
    source = """
@wrapped
async def f(a: int = 1, /, *b, c=None, **d) -> None:
    global x, y
    return f"{a!r:>{b['c']}.{d}} {'né' or 'z'} {{}} {a=}", f"", u"u", b"b", 1e300, 2j, ..., not None

class C(B, metaclass=M):
    attribute: int
"""
    kept = "80b384759741c93545b056898571c97f29f136915725d83e022f12c33d0718a1"
    assert summarised(source.encode()).code == kept


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
