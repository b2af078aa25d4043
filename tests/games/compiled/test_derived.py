"""Derived functions are read back for equal origins and equal code, if all of it is ours."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from olne_bench.games.compiled import derived as module
from olne_bench.games.compiled.derived import derived
from olne_bench.games.compiled.source import source_of
from olne_bench.games.compiled.stage_functions import _stage_functions
from olne_bench.games.model.costs import Proximity
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import structure_and_numbers


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where derived functions are kept meanwhile."""
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache-derived"


@dataclass
class Counted:
    """What is derived: the number of times that it was."""

    times: int = 0

    def __call__(self) -> int:
        self.times += 1
        return self.times


@dataclass(frozen=True)
class OfATest:
    """Code that is not of the package."""


def test_equal_origins_are_derived_once() -> None:
    derive = Counted()
    assert [derived("k", (Proximity(), 1.0), derive) for _ in range(3)] == [1, 1, 1]
    assert derived("another kind", (Proximity(), 1.0), derive) == 2
    assert derived("k", (Proximity(), 2.0), derive) == 3


@pytest.mark.parametrize("origin", [OfATest(), lambda: 0, (UNICYCLE, OfATest)])
def test_nothing_is_kept_of_code_that_may_change_unseen(origin: object, folder: Path) -> None:
    derive = Counted()
    assert [derived("k", origin, derive) for _ in range(2)] == [1, 2]
    assert not folder.exists()


def test_changed_code_derives_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    derive = Counted()
    derived("k", UNICYCLE, derive)
    monkeypatch.setattr(module, "_code", lambda: "other")
    assert derived("k", UNICYCLE, derive) == 2


def test_functions_that_are_read_are_those_that_were_derived(
    folder: Path, crossing: tuple[Game, np.ndarray, np.ndarray]
) -> None:
    structure, _ = structure_and_numbers(crossing[0])
    first, second = (_stage_functions.__wrapped__(structure, False) for _ in range(2))
    assert len(list(folder.iterdir())) == 1
    assert source_of.__wrapped__(first) == source_of.__wrapped__(second)
    assert len(list(folder.iterdir())) == 2
    functions = [one.kinds[0].functions["value"] for one in (first, second)]
    ones = [np.ones(functions[0].size_in(k)) for k in range(functions[0].n_in())]
    values = [function(*ones).full() for function in functions]
    np.testing.assert_array_equal(*values)
