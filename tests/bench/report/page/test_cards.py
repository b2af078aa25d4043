"""Cards of estimators, read from their sources without running them."""

from pathlib import Path

import pytest

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.report.page.cards import FIELDS, card_of
from olne_bench.plugins import ESTIMATOR, is_built_in, names

DOC = """A method, in a line
that goes on.

    min_x  f(x)
    s.t.   g(x) = 0

Some more about `x`.

- one thing
- another one,
  at length

Paper: Somebody 2020.
Assumes: that all is well,
    and stays so.
Cost: none.
"""


def test_a_docstring_in_its_parts(tmp_path: Path) -> None:
    card = card_of(plugin(tmp_path, f'"""{DOC}"""'))
    assert card.method == "A method, in a line that goes on."
    assert card.fields == {
        "Paper": "Somebody 2020.",
        "Assumes": "that all is well, and stays so.",
        "Cost": "none.",
    }


@pytest.mark.parametrize("name", [n for n in names(ESTIMATOR) if is_built_in(ESTIMATOR, n)])
def test_every_estimator_of_this_package_says_what_a_card_asks_for(name: str) -> None:
    card = card_of(EstimatorEntry(name=name, label=name))
    assert card.missing == ""
    assert card.method
    expected = set(FIELDS) - ({"Paper"} if name == "uniform" else set())
    assert set(card.fields) == expected
    assert card.origin == f"olne_bench.estimators.{name}"


def plugin(folder: Path, text: str, name: str = "mine.py") -> EstimatorEntry:
    path = folder / "mine.py"
    path.write_text(text)
    return EstimatorEntry(name=str(folder / name), label="mine", parameters={"k": 2})


CLASS = 'class A:\n    """Of A.\n\n    Cost: some."""\n    def estimate(self): ...\n'


def test_the_class_speaks_where_the_module_does_not(tmp_path: Path) -> None:
    card = card_of(plugin(tmp_path, "raise SystemExit\n" + CLASS))
    assert (card.method, card.fields) == ("Of A.", {"Cost": "some."})
    assert (card.origin, card.parameters) == ("mine.py", {"k": 2})


def test_of_several_classes_the_named_one_speaks(tmp_path: Path) -> None:
    two = CLASS + CLASS.replace("A", "B")
    assert card_of(plugin(tmp_path, two, "mine.py:B")).method == "Of B."


@pytest.mark.parametrize(
    ("text", "said"), [("x = 1\n", "it has no docstring"), ("x = \n", "not found, or no Python")]
)
def test_a_card_says_why_it_is_empty(tmp_path: Path, text: str, said: str) -> None:
    assert said in card_of(plugin(tmp_path, text)).missing


def test_a_file_that_is_gone_is_no_error(tmp_path: Path) -> None:
    entry = plugin(tmp_path, CLASS)
    (tmp_path / "mine.py").unlink()
    assert card_of(entry).missing.startswith("its file mine.py is not here")
