"""Differences between two copies of plain data."""

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from olne_bench.bench.conformance.differences import find_change


class Thing:
    """Compares by identity, so its attributes are compared."""

    def __init__(self, size: float) -> None:
        self.size = size


@dataclass
class Box:
    """Holds one of each."""

    number: float
    rows: tuple[int, ...]
    table: dict[str, Any]
    array: np.ndarray
    thing: Thing


def box() -> Box:
    return Box(1.0, (1, 2), {"a": [1]}, np.array([1.0, np.nan]), Thing(3.0))


def test_a_copy_does_not_differ() -> None:
    assert find_change(box(), copy.deepcopy(box()), "box") is None
    same = box()
    assert find_change(same, same, "box") is None


CHANGES = {
    "number": (lambda b: setattr(b, "number", 2.0), "box.number was 1.0 and is 2.0"),
    "kind": (lambda b: setattr(b, "number", 1), "box.number was 1.0 and is 1"),
    "row": (lambda b: setattr(b, "rows", (1, 3)), "box.rows[1] was 2 and is 3"),
    "added row": (lambda b: setattr(b, "rows", (1, 2, 3)), "box.rows[2] was absent"),
    "lost row": (lambda b: setattr(b, "rows", (1,)), "box.rows[1] was 2 and is 'absent'"),
    "key": (lambda b: b.table["a"].append(2), "box.table['a'][1] was absent"),
    "array": (lambda b: b.array.__setitem__(0, 2.0), "box.array was array([ 1., nan]) and is"),
    "shape": (lambda b: setattr(b, "array", b.array[:1]), "box.array was array([ 1., nan]) and is"),
    "nan": (lambda b: b.array.__setitem__(1, 0.0), "box.array was array([ 1., nan]) and is"),
    "thing": (lambda b: setattr(b.thing, "size", 4.0), "box.thing.size was 3.0 and is 4.0"),
    "new attribute": (lambda b: setattr(b.thing, "mass", 4.0), "box.thing.mass was absent"),
    "deleted": (lambda b: delattr(b, "number"), "box.number was 1.0 and is 'absent'"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_the_first_difference_is_named_with_its_place(name: str) -> None:
    change, words = CHANGES[name]
    after = copy.deepcopy(box())
    change(after)
    found = find_change(box(), after, "box")
    assert found is not None
    assert found.startswith(words)


def test_functions_and_classes_are_not_looked_into() -> None:
    assert find_change(len, len, "it") is None
    assert str(find_change(Thing, Box, "it")).startswith("it was <class")
