"""Imports point one way, between packages and between the rooms of ``bench``, without circles."""

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BASE = "olne_bench"
#: What each package may import besides itself and the modules directly in ``olne_bench``.
PACKAGES = {
    "games": set(),
    "envs": {"games"},
    "estimators": {"games"},
    "bench": {"games", "envs", "estimators"},
    "front": {"games", "envs", "estimators", "bench"},
}
#: Where packages are that have no folder at the root.
HOMES = {"front": ROOT / "src" / "olne_bench" / "front"}
#: Rooms of ``bench`` from the ground up; a room imports from those below it only.
ROOMS = ("process", "plan", "judge", "run", "report", "commands")
COMMON = ("olne_bench.bench.text",)


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[2:] if parts[0] == "src" else parts
    return ".".join([BASE, *(parts[:-1] if parts[-1] == "__init__" else parts)])


FILES = {
    module_name(path): path
    for name in PACKAGES
    for path in sorted(HOMES.get(name, ROOT / name).rglob("*.py"))
}


def imported(text: str, name: str, is_package: bool = False) -> Iterator[str]:
    """All dotted names that a module's imports may mean, including lazy imports."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = name.split(".")[: None if is_package and node.level == 1 else -node.level]
                base = ".".join([*above, *filter(None, [base])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def modules_of_ours(name: str) -> set[str]:
    path = FILES[name]
    found = set(imported(path.read_text(), name, path.name == "__init__.py"))
    return {module for module in found if module in FILES} - {name}


def package(module: str) -> str:
    return module.split(".")[1]


def room(module: str) -> str | None:
    parts = module.split(".")
    return parts[2] if len(parts) > 2 and parts[1] == "bench" and parts[2] in ROOMS else None


@pytest.mark.parametrize("name", FILES)
def test_packages_import_one_way(name: str) -> None:
    own = package(name)
    assert {package(module) for module in modules_of_ours(name)} <= PACKAGES[own] | {own}


@pytest.mark.parametrize("name", [name for name in FILES if room(name)])
def test_rooms_import_from_below(name: str) -> None:
    here = ROOMS.index(str(room(name)))
    for module in modules_of_ours(name):
        if package(module) == "bench" and module not in COMMON:
            place = room(module)
            assert place is not None and ROOMS.index(place) <= here, module


def test_no_module_imports_itself_by_a_detour() -> None:
    # A module's own packages are left out: their __init__ is imported in any case.
    graph = {
        name: {m for m in modules_of_ours(name) if not name.startswith(f"{m}.")} for name in FILES
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"a circle: {' -> '.join(error.args[1])}")


def test_everything_in_bench_has_a_room() -> None:
    homeless = {name for name in FILES if package(name) == "bench" and not room(name)}
    assert homeless == {"olne_bench.bench", *COMMON}


@pytest.mark.parametrize(
    ("code", "module"),
    [
        ("import olne_bench.bench.text", "olne_bench.bench.text"),
        ("from olne_bench.bench import text", "olne_bench.bench.text"),
        ("def f():\n    from olne_bench.bench.text import x", "olne_bench.bench.text"),
        ("from ..bench import text", "olne_bench.bench.text"),
        ("from . import game", "olne_bench.games.game"),
    ],
)
def test_finder_sees_every_form_of_import(code: str, module: str) -> None:
    assert module in set(imported(code, "olne_bench.games.module"))
