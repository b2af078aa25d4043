"""Versions cover all code and data that make a row: found statically, in a copy of the package."""

import ast
import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import olne_bench
from olne_bench.bench.plan import fingerprint, versions

#: What judges each kind of unit and what plays there, and what the version of its rows covers.
KINDS = {
    "trials": (("judge.trials", "run.player"), versions._JUDGES["trials"]),
    "streams": (("judge.streams", "run.player"), versions._JUDGES["streams"]),
    "drives": (("judge.drives", "run.player"), versions._JUDGES["drives"]),
}
#: Modules that were once left out.
ONCE_MISSING = {
    "trials": ("judge.likelihood", "judge.weight_levels", "judge.priors"),
    "streams": ("judge.cloned_policy",),
    "drives": ("judge.learned_driver",),
}
DATA = (".c", ".draws", ".npz")
#: Data that no judge needs, but a plugin, whose version covers it.
OF_PLUGINS = {"feedback.c": "envs.scenarios.changed"}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A folder with a copy of the package."""
    folder = tmp_path_factory.mktemp("copy")
    without = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(olne_bench.__file__).parent, folder / "olne_bench", ignore=without)
    return folder


@pytest.fixture
def taken(copy, monkeypatch):
    """Takes the fingerprints of a kind of unit from the copy, as it is now."""
    monkeypatch.setattr(versions, "_PACKAGES", copy)
    monkeypatch.setattr(versions, "_OURS", {"olne_bench": copy})
    for name in ("_imported", "_summary", "_content"):
        remembered = while_unchanged(getattr(fingerprint, name).__wrapped__)
        monkeypatch.setattr(fingerprint, name, remembered)
    covered = {kind: names for kind, (_, names) in KINDS.items()}
    covered |= {file: (module,) for file, module in OF_PLUGINS.items()}
    return lambda kind: versions._ours.__wrapped__(covered[kind])


def while_unchanged(function):
    """The function of a module's path, which remembers results while it and its data are as is."""
    known = {}

    def remembered(path: Path, *rest: str):
        key = (path, rest, changes[path], changes[path.parent])
        if key not in known:
            known[key] = function(path, *rest)
        return known[key]

    return remembered


#: How often modules were written, and data in folders.
changes: Counter[Path] = Counter()


def write(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    changes.update([path] if path.suffix == ".py" else path.parents)


def imported(names: tuple[str, ...]) -> set[str]:
    """Modules of this package that Python loads for some, apart from the static search."""
    wanted = ", ".join(f"olne_bench.bench.{name}" for name in names)
    code = f"import json, sys, {wanted}; print(json.dumps(list(sys.modules)))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name for name in json.loads(said.stdout) if name.startswith("olne_bench.")}


def file_of(copy: Path, module: str) -> Path:
    path = copy.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def with_another_constant(source: str) -> str:
    """The source with its first number changed, or its first text, or another constant added."""
    tree = ast.parse(source)
    documented = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    documented |= {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for part in ast.walk(node)
    }
    for kind, other in (((int, float), 1), ((str,), "x")):
        for node in ast.walk(tree):
            if not isinstance(node, ast.Constant) or type(node.value) not in kind:
                continue
            if id(node) in documented or node.lineno != node.end_lineno:
                continue
            lines = [line.encode() for line in source.splitlines(keepends=True)]
            line = lines[node.lineno - 1]
            new = repr(node.value + other).encode()
            lines[node.lineno - 1] = line[: node.col_offset] + new + line[node.end_col_offset :]
            return b"".join(lines).decode()
    return f"{source}\nADDED = 1\n"


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_in_any_module_that_a_judge_imports_counts(copy, taken, kind):
    before, unnoticed = taken(kind), []
    modules = imported(KINDS[kind][0]) - fingerprint._OF_NO_RESULT
    assert {f"olne_bench.bench.{name}" for name in ONCE_MISSING[kind]} <= modules
    assert len(modules) > 100
    for module in sorted(modules):
        path = file_of(copy, module)
        source = path.read_bytes()
        write(path, with_another_constant(source.decode()).encode())
        if taken(kind) == before:
            unnoticed.append(module)
        write(path, source)
    assert unnoticed == []
    assert taken(kind) == before


def test_a_byte_in_any_data_file_counts(copy, taken):
    before, unnoticed = {kind: taken(kind) for kind in (*KINDS, *OF_PLUGINS)}, []
    files = sorted(path for path in copy.rglob("*") if path.suffix in DATA)
    assert {path.suffix for path in files} == set(DATA)
    for path in files:
        content = path.read_bytes()
        write(path, content[:-1] + bytes([content[-1] ^ 1]))
        kinds = [path.name] if path.name in OF_PLUGINS else KINDS
        if all(taken(kind) == before[kind] for kind in kinds):
            unnoticed.append(path.name)
        write(path, content)
    assert unnoticed == []


def test_reports_commands_and_estimators_that_no_judge_imports_do_not_count(copy, taken):
    before = {kind: taken(kind) for kind in KINDS}
    places = ("bench/report", "bench/commands", "bench/run/store.py", "bench/run/resume.py")
    places += ("bench/process/sandbox.py", "bench/plan/load.py", "estimators/ukf.py")
    places += ("estimators/uniform.py", "envs/tracks")
    for place in places:
        path = copy / "olne_bench" / place
        for file in [path] if path.suffix else sorted(path.rglob("*.py")):
            write(file, with_another_constant(file.read_text()).encode())
    assert {kind: taken(kind) for kind in KINDS} == before


def test_versions_name_all_libraries_that_judges_and_plugins_compute_with(copy):
    # They draw pictures, pass data or ask what there is: numbers stay as they are.
    others = {"msgspec", "pydantic", "pygame", "threadpoolctl"}
    modules = [name for _, names in KINDS.values() for name in names]
    modules += [f"estimators.{path.stem}" for path in (copy / "olne_bench/estimators").glob("*.py")]
    for folder in ("scenarios", "sensors"):
        found = (copy / "olne_bench/envs" / folder).glob("*.py")
        modules += [f"envs.{folder}.{path.stem}" for path in found]
    start = {f"olne_bench.{name}": file_of(copy, f"olne_bench.{name}") for name in modules}
    start = {name: path for name, path in start.items() if not name.endswith("__init__")}
    paths = fingerprint.modules_used(start, {"olne_bench": copy}, own=None).values()
    tops = {
        one.module.partition(".")[0]
        for path in paths
        for one in fingerprint._summary(path).imports
        if not one.level
    }
    used = {name.replace("_", "-") for name in tops - sys.stdlib_module_names - {"olne_bench"}}
    assert used - others == set(versions._LIBRARIES)
