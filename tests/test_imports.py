"""Imports point one way: games <- envs, games <- estimators, and bench knows all three."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {
    "games": {"games"},
    "envs": {"envs", "games"},
    "estimators": {"estimators", "games"},
    "bench": {"bench", "envs", "estimators", "games"},
}
MODULES = [path for package in ALLOWED for path in sorted((ROOT / package).rglob("*.py"))]


def imported_packages(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            own = path.relative_to(ROOT).parts[0]
            yield own if node.level else str(node.module).partition(".")[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    ours = set(imported_packages(path)) & set(ALLOWED)
    assert ours <= ALLOWED[package]


def test_every_package_is_looked_at() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in MODULES} == set(ALLOWED)


@pytest.mark.parametrize(
    ("code", "package"),
    [
        ("import bench.cli", "bench"),
        ("from bench import cli", "bench"),
        ("def f():\n    from envs.scenarios import x", "envs"),
        ("from . import game", "games"),
    ],
)
def test_finder_sees_every_form_of_import(
    code: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    path = tmp_path / "games" / "module.py"
    path.parent.mkdir()
    path.write_text(code)
    assert list(imported_packages(path)) == [package]
