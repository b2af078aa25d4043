"""Count the random one-token mutants of the packages that their mirrored test files notice.

    python scripts/mutants.py --out runs/mutants
    python scripts/mutants.py --out runs/mutants --count 60 --only bench/plan --list
    python scripts/mutants.py --out runs/mutants --count 60 --seed 7

A mutant is the code with one operator, comparison, number, boolean, ``and``, ``or``, ``not`` or
sign replaced by cosmic-ray's operators. Places are drawn with a fixed seed and equal chance; a
larger ``--count`` contains a smaller one. For each mutant, only the test file that mirrors its
module (:func:`mirror`) is run, in a copy of the tree. The mutant is noticed if the tests fail or
exceed their time. Results are kept in the folder ``--out`` by the contents of module and tests: an
interrupted run continues where it stopped, and a second run repeats only what changed.
"""

import argparse
import ast
import difflib
import hashlib
import importlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
import types
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import psutil
import pytest
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators import (
    binary_operator_replacement,
    boolean_replacer,
    comparison_operator_replacement,
    unary_operator_replacement,
)
from cosmic_ray.operators.number_replacer import NumberReplacer
from cosmic_ray.operators.operator import Operator

ROOT = Path(__file__).parents[1]
PACKAGES = ("games", "envs", "estimators", "bench")
EXPLAINED = ROOT / "docs/mutants.md"
SEED = 2026
#: Time limits [s] of the tests of a mutant: processor time of one process, and wall-clock time. A
#: module's tests take a fraction of them. With wall-clock time alone, other work on the machine
#: would make mutants look noticed.
PROCESSOR_LIMIT, LIMIT = 60, 900.0

#: Libraries that most tests import, except modules whose asserts pytest rewrites.
LIBRARIES = (
    "casadi",
    "distributed",
    "highway_env",
    "matplotlib.pyplot",
    "msgspec",
    "pandas",
    "pettingzoo",
    "pyarrow.parquet",
    "pydantic",
    "scipy.optimize",
    "scipy.stats",
)

#: Modules whose tests have a name that the rules of :func:`mirror` do not find.
ELSEWHERE = {
    "bench/commands/check.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/compare.py": "tests/bench/report/test_gate_and_compare.py",
    "bench/commands/differences.py": "tests/bench/report/test_gate_and_compare.py",
    "bench/commands/estimate.py": "tests/bench/commands/test_record_command.py",
    "bench/commands/estimator_checks.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/export.py": "tests/bench/commands/test_record_command.py",
    "bench/commands/findings.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/gate.py": "tests/bench/report/test_gate_and_compare.py",
    "bench/commands/import_tracks.py": "tests/bench/commands/test_record_command.py",
    "bench/commands/list_all.py": "tests/bench/commands/test_cli.py",
    "bench/commands/merge.py": "tests/bench/commands/test_cli.py",
    "bench/commands/metric_checks.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/new.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/record.py": "tests/bench/commands/test_record_command.py",
    "bench/commands/recordings.py": "tests/bench/commands/test_record_command.py",
    "bench/commands/report.py": "tests/bench/commands/test_cli.py",
    "bench/commands/run.py": "tests/bench/commands/test_cli.py",
    "bench/run/study.py": "tests/bench/commands/test_cli.py",
    "bench/plan/change.py": "tests/bench/plan/test_change.py",
    "bench/commands/scenario_checks.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/sensor_checks.py": "tests/bench/commands/test_conformance.py",
    "bench/commands/status.py": "tests/bench/commands/test_cli.py",
    "bench/judge/metrics/cosine_error.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/metrics/covers_truth.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/metrics/held_out_error.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/metrics/judged.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/metrics/position_error.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/metrics/reconstruction_error.py": "tests/bench/judge/metrics/test_scoring.py",
    "bench/judge/raw_estimate.py": "tests/bench/judge/test_estimate_check.py",
    "bench/judge/solved_draws.py": "tests/bench/commands/test_draws.py",
    "bench/judge/truth.py": "tests/bench/judge/test_referee.py",
    "bench/plan/check.py": "tests/bench/plan/test_suite.py",
    "bench/plan/draws.py": "tests/bench/commands/test_draws.py",
    "bench/plan/entries.py": "tests/bench/plan/test_suite.py",
    "bench/plan/load.py": "tests/bench/plan/test_suite.py",
    "bench/plan/select.py": "tests/bench/plan/test_suite.py",
    "bench/plan/trial.py": "tests/bench/plan/test_suite.py",
    "bench/process/inside.py": "tests/bench/process/test_child.py",
    "bench/report/figures/__init__.py": "tests/bench/report/figures/test_draw_figures.py",
    "bench/report/figures/errors.py": "tests/bench/report/figures/test_levels.py",
    "bench/report/figures/panels.py": "tests/bench/report/figures/test_scene.py",
    "bench/report/figures/style.py": "tests/bench/report/figures/test_draw_figures.py",
    "bench/report/gate.py": "tests/bench/report/test_gate_and_compare.py",
    "bench/report/page/numbers.py": "tests/bench/report/page/test_render.py",
    "bench/report/statistics/run_comparison.py": "tests/bench/report/test_gate_and_compare.py",
    "bench/report/study.py": "tests/bench/report/test_leaderboard.py",
    "bench/report/submission/manifest.py": "tests/bench/report/submission/test_submission.py",
    "bench/report/submission/pack.py": "tests/bench/report/submission/test_submission.py",
    "bench/report/submission/verify.py": "tests/bench/report/submission/test_submission.py",
    "bench/report/tables.py": "tests/bench/report/page/test_render.py",
    "bench/run/player_process.py": "tests/bench/run/test_executor.py",
    "bench/run/referee.py": "tests/bench/run/test_executor.py",
    "envs/draws_folder.py": "tests/envs/test_kept_draws.py",
    "envs/equilibrium.py": "tests/envs/test_recording.py",
    "envs/lane_curves.py": "tests/envs/test_highway_roads.py",
    "envs/nash_gym.py": "tests/envs/test_gym_ids.py",
    "envs/scenarios/highway.py": "tests/envs/scenarios/test_road_families.py",
    "envs/scenarios/intersection.py": "tests/envs/scenarios/test_road_families.py",
    "envs/scenarios/merge.py": "tests/envs/scenarios/test_road_families.py",
    "envs/scenarios/roundabout.py": "tests/envs/scenarios/test_road_families.py",
    "envs/scenarios/scenario.py": "tests/envs/scenarios/test_two_player.py",
    "envs/scenarios/two_way.py": "tests/envs/scenarios/test_road_families.py",
    "envs/scene.py": "tests/envs/test_rendering.py",
    "envs/track_formats/__init__.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/commonroad.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/csv.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/highd.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/ind.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/interaction.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/ngsim.py": "tests/envs/track_formats/test_formats.py",
    "envs/track_formats/sumo.py": "tests/envs/track_formats/test_formats.py",
    "envs/tracks/cells.py": "tests/envs/tracks/test_reading.py",
    "envs/tracks/of_scenario.py": "tests/envs/tracks/test_road_file.py",
    "envs/tracks/sumo_net.py": "tests/envs/track_formats/test_formats.py",
    "envs/tracks/table.py": "tests/envs/track_formats/test_formats.py",
    "envs/tracks/targets.py": "tests/envs/tracks/test_explained.py",
    "envs/worlds.py": "tests/envs/test_recording.py",
    "estimators/joint_ipopt.py": "tests/estimators/test_interior_point.py",
    "estimators/joint_problem.py": "tests/estimators/test_interior_point.py",
    "games/batch.py": "tests/games/test_newton.py",
    "games/native.py": "tests/games/test_elimination.py",
    "games/reference_derivatives.py": "tests/games/test_reference_game.py",
    "games/stage_functions.py": "tests/games/test_elimination.py",
}


def mirror(module: str, root: Path = ROOT) -> str | None:
    """Return the test file of a module, or None: then no mutant of it counts as noticed.

    It is the first existing file of: ``tests/PACKAGE/test_MODULE.py``; the entry of ``ELSEWHERE``;
    the first with the module's last words left out (``store_merge`` has its tests in
    ``test_store.py``); the tests of the module's folder (``envs/traffic/report.py`` has them in
    ``tests/envs/test_traffic.py``).
    """
    path = Path(module)
    words = path.stem.split("_")
    names = ["_".join(words[:n]) for n in range(len(words), 0, -1)]
    files = [Path("tests", path.parent, f"test_{name}.py") for name in names]
    if module in ELSEWHERE:
        files.insert(1, Path(ELSEWHERE[module]))
    files.append(Path("tests", path.parent.parent, f"test_{path.parent.name}.py"))
    return next((str(file) for file in files if (root / file).is_file()), None)


# --------------------------------------------------------------------------------------- operators


#: An operator is replaced by one of its kind. Any test would notice ``a << b`` on floats, and
#: ``is`` for ``==`` makes no difference for the objects compared here.
KINDS = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)


def operators() -> dict[str, list[Operator]]:
    """Return the possible mutations, as operators of cosmic-ray, by type of syntax."""
    found: dict[str, list[Operator]] = {
        "number": [NumberReplacer()],
        "keyword": [
            boolean_replacer.ReplaceTrueWithFalse(),
            boolean_replacer.ReplaceFalseWithTrue(),
            boolean_replacer.ReplaceAndWithOr(),
            boolean_replacer.ReplaceOrWithAnd(),
        ],
        "operator": _of_a_kind(binary_operator_replacement),
        "comparison": _of_a_kind(comparison_operator_replacement),
    }
    unary = [
        operator()
        for operator in unary_operator_replacement.operators()
        if operator.__name__.endswith(("USub_UAdd", "Delete_USub", "Delete_Not"))
    ]
    # The types share one object, as places are counted by operator.
    for types_of_syntax, of_them in (
        (("if_stmt", "while_stmt", "assert_stmt", "test"), [boolean_replacer.AddNot()]),
        (("factor", "not_test"), unary),
    ):
        found |= dict.fromkeys(types_of_syntax, of_them)
    return found


def _of_a_kind(family: types.ModuleType) -> list[Operator]:
    """Return the operators of a family that stay within one of ``KINDS``."""
    changes = [(set(one.__name__.split("_")[-2:]), one) for one in family.operators()]
    return [one() for change, one in changes if any(change <= kind for kind in KINDS)]


# ------------------------------------------------------------------------------------------ places

#: Functions that print messages, whose wording is not tested.
MESSAGES = {"UserError", "echo", "secho", "print", "warn", "debug", "info", "warning", "exception"}
#: Arguments that change no result by construction, as (function, argument).
WITHOUT_EFFECT = {
    ("dataclass", "frozen"),  # refuses what the code never does
    ("dataclass", "slots"),
    ("zip", "strict"),  # refuses what is never passed
    ("lru_cache", "maxsize"),  # changes only time
    ("option", "show_default"),  # changes only help texts
}

Position = tuple[int, int]


def skipped(source: str) -> list[tuple[Position, Position]]:
    """Return the ranges of a module's text that are not mutated.

    These are annotations and aliases of types, ``__all__``, ``if TYPE_CHECKING``, messages
    (arguments of errors, prints, warnings and logs), and the arguments of ``WITHOUT_EFFECT``.
    Docstrings and other texts have no tokens to mutate.
    """
    lines = source.splitlines()

    def position(line: int, column: int) -> Position:
        return line, len(lines[line - 1].encode()[:column].decode())

    ranges = []
    for node in ast.walk(ast.parse(source)):
        for inner in _without_tests(node):
            start = position(inner.lineno, inner.col_offset)
            ranges.append((start, position(inner.end_lineno or 0, inner.end_col_offset or 0)))
    return ranges


def _without_tests(node: ast.AST) -> list[ast.expr]:
    """Return the parts of a node that are not mutated."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return [node.returns] if node.returns else []
    if isinstance(node, ast.arg | ast.AnnAssign):
        return [node.annotation] if node.annotation else []
    if isinstance(node, ast.Raise):
        return [node.exc] if node.exc else []
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return [node.test]
    if isinstance(node, ast.Assign):
        names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        union = isinstance(node.value, ast.BinOp) and isinstance(node.value.op, ast.BitOr)
        alias = union and any(name.lstrip("_")[:1].isupper() for name in names)
        return [node.value] if alias or "__all__" in names else []
    if isinstance(node, ast.Call):
        name = ast.unparse(node.func).split(".")[-1]
        if name in MESSAGES or name.endswith("Error"):
            return [*node.args, *(keyword.value for keyword in node.keywords)]
        return [word.value for word in node.keywords if (name, word.arg) in WITHOUT_EFFECT]
    return []


@dataclass(frozen=True)
class Place:
    """A token of a module and its possible mutations: operators and their occurrence numbers."""

    module: str
    start: Position
    choices: tuple[tuple[Operator, int], ...]
    order: str


def places(
    module: str, source: str, all_operators: dict[str, list[Operator]], seed: int
) -> Iterator[Place]:
    """Yield the places of a module that can be mutated, with their order in the draw of a seed."""
    ranges = skipped(source)
    counts: Counter[Operator] = Counter()
    found: dict[Position, list[tuple[Operator, int]]] = {}
    for node in ast_nodes(get_ast(source)):
        for operator in all_operators.get(node.type, ()):
            for start, _ in operator.mutation_positions(node):
                # A bare * or / among parameters refuses calls that are never made.
                if node.parent is None or node.parent.type != "parameters":
                    found.setdefault(start, []).append((operator, counts[operator]))
                counts[operator] += 1
    lines = source.splitlines()
    before: Counter[str] = Counter()
    for start in sorted(found):
        # The text does not change if lines are added above it, so draws stay the same.
        text = f"{seed}|{module}|{lines[start[0] - 1].strip()}|"
        text += str(start[1] - len(lines[start[0] - 1]) + len(lines[start[0] - 1].lstrip()))
        before[text] += 1
        if not any(first <= start < last for first, last in ranges):
            order = hashlib.sha256(f"{text}|{before[text]}".encode()).hexdigest()
            yield Place(module, start, tuple(found[start]), order)


@dataclass(frozen=True)
class Mutant:
    """A module with one token changed; ``before`` and ``after`` are its lines."""

    module: str
    line: int
    before: str
    after: str
    source: str


def mutate(place: Place, source: str) -> Mutant | None:
    """Return a random mutant of a place, or None if no choice gives another program."""
    choices = list(place.choices)
    random.Random(place.order).shuffle(choices)
    for operator, occurrence in choices:
        changed = mutate_code(source, operator, occurrence)
        if changed is None or not _differs(source, changed):
            continue
        lines = [
            line
            for line in difflib.ndiff(source.splitlines(), changed.splitlines())
            if line[0] in "+-"
        ]
        texts = [" ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+"]
        return Mutant(place.module, place.start[0], texts[0], texts[1], changed)
    return None


def _differs(source: str, changed: str) -> bool:
    try:
        return ast.dump(ast.parse(source)) != ast.dump(ast.parse(changed))
    except SyntaxError:
        return False


def draw(count: int, only: str, seed: int) -> list[Mutant]:
    """Return the first ``count`` mutants of the modules whose path begins with ``only``.

    They are in the order of the draw, so those tried before an interruption are a fair sample.
    """
    sources: dict[str, str] = {}
    found: list[Place] = []
    all_operators = operators()
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = str(path.relative_to(ROOT))
            if "templates" not in path.parts and module.startswith(only):
                sources[module] = path.read_text()
                found += places(module, sources[module], all_operators, seed)
    mutants: list[Mutant] = []
    for place in sorted(found, key=lambda place: place.order):
        if len(mutants) == count:
            break
        mutant = mutate(place, sources[place.module])
        mutants += [mutant] if mutant else []
    print(f"{len(mutants)} mutants of {len(found)} places in {len(sources)} modules")
    return mutants


def in_order(mutant: Mutant) -> tuple[int, str, int]:
    """Return the sort key of a mutant in the printed list."""
    return PACKAGES.index(Path(mutant.module).parts[0]), mutant.module, mutant.line


# --------------------------------------------------------------------------------------- judgement


@dataclass(frozen=True)
class Result:
    """The result of running the tests on a mutant.

    Attributes:
        outcome: ``passed``, ``failed``, ``too long`` or ``no tests``.
        seconds: time that they took [s].
        by: the test that failed.
    """

    outcome: str
    seconds: float
    by: str = ""


#: Folder within ``--out`` for the copies of the tree.
TREES = "trees"


class Laboratory:
    """A copy of the tree in which mutants are tried, and the known results."""

    def __init__(self, out: Path) -> None:
        self._known_file = out / "results.jsonl"
        self._known: dict[str, Result] = {}
        if self._known_file.is_file():
            for line in self._known_file.read_text().splitlines():
                entry = json.loads(line)
                self._known[entry["key"]] = Result(entry["outcome"], entry["seconds"], entry["by"])
        self._tree = out.absolute() / TREES / str(os.getpid()) / "tree"
        _copy_tree(self._tree)

    def try_mutant(self, mutant: Mutant) -> Result:
        """Run the mirrored tests on a mutant; the outcome is ``no tests`` if there are none."""
        tests = mirror(mutant.module, self._tree)
        if tests is None:
            return Result("no tests", 0.0)
        return self._run(tests, mutant.module, mutant.source)

    def try_tests(self, tests: str) -> Result:
        """Run tests on the unchanged code."""
        return self._run(tests)

    def _run(self, tests: str, module: str = "", source: str = "") -> Result:
        """Run tests with a module's text replaced, unless the result is known."""
        parts = [tests, *self._texts(tests), module, source]
        key = hashlib.sha256("\0".join(parts).encode()).hexdigest()
        if key not in self._known:
            original = (self._tree / module).read_text() if module else ""
            if module:
                (self._tree / module).write_text(source)
            self._known[key] = _pytest(self._tree, tests)
            if module:
                (self._tree / module).write_text(original)
            with self._known_file.open("a") as file:
                file.write(json.dumps({"key": key, **asdict(self._known[key])}) + "\n")
        return self._known[key]

    def _texts(self, tests: str) -> list[str]:
        """Return the contents of a test file and of each ``conftest.py`` above it."""
        folders = [self._tree / folder for folder in Path(tests).parents]
        files = [self._tree / tests, *(folder / "conftest.py" for folder in folders)]
        return [file.read_text() for file in files if file.is_file()]


def _copy_tree(tree: Path) -> None:
    """Copy what git does not ignore, and compile it so that a changed text is always noticed."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).exists() and not name.startswith("results/"):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name, follow_symlinks=False)
    command = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
    # compileall does not follow the links from src to the packages.
    subprocess.run([*command, "src", *PACKAGES], cwd=tree, check=True)


def _pytest(tree: Path, tests: str) -> Result:
    """Run a test file in a tree; kill it, with its descendants, after ``LIMIT`` seconds.

    The process is a fork of this one, which has imported the libraries, but not the packages.

    Raises:
        SystemExit: if there are no tests to run.
    """
    begin = time.monotonic()
    child = os.fork()
    if not child:
        try:
            code: int = pytest.ExitCode.INTERNAL_ERROR
            code = _run_here(tree, tests)
        finally:
            os._exit(code)
    process = psutil.Process(child)
    try:
        code = process.wait(LIMIT)
        if code == pytest.ExitCode.NO_TESTS_COLLECTED:
            sys.exit(f"{tests} has no tests")
        outcome = "failed" if code else "passed"
        outcome = "too long" if code == -signal.SIGXCPU else outcome
    except psutil.TimeoutExpired:
        outcome = "too long"
        for descendant in [*process.children(recursive=True), process]:
            descendant.kill()
        process.wait()
    said = (tree.parent / "last.txt").read_text(errors="replace").splitlines()
    by = [line for line in said if line.startswith(("FAILED", "ERROR"))] or said[-1:]
    return Result(outcome, round(time.monotonic() - begin, 2), by[-1][:200] if by else "")


def _run_here(tree: Path, tests: str) -> int:
    """Run pytest in this process, which must not be used afterwards; return its exit code."""
    with (tree.parent / "last.txt").open("w+") as output:
        for stream in range(3):
            os.dup2(output.fileno(), stream)
    os.chdir(tree)
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_LIMIT, resource.RLIM_INFINITY))
    source = str(tree / "src")
    others = [path for path in sys.path if not path.startswith(str(ROOT) + os.sep)]
    sys.path[:] = [str(tree), source, *others]  # as with python -m pytest
    os.environ["PYTHONPATH"] = source
    # Otherwise processes that tests start would import this script.
    sys.modules["__main__"] = types.ModuleType("__main__")
    sys.argv = ["pytest", tests]
    folder = str(tree.parent / "tmp")
    kinds = "not corpus and not learners"  # but tests that take long
    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", kinds, "--basetemp", folder]
    return int(pytest.main([*options, tests]))


def _import_libraries() -> None:
    """Import once what most tests would otherwise import again and again."""
    for name in LIBRARIES:
        importlib.import_module(name)
    assert not any(name.split(".")[0] == "olne_bench" for name in sys.modules)


def report(results: list[tuple[Mutant, Result]]) -> None:
    """Print the share of noticed mutants by package, and the survivors."""
    explained = EXPLAINED.read_text() if EXPLAINED.is_file() else ""
    print("\npackage      mutants  noticed  share")
    for package in (*PACKAGES, ""):
        outcomes = [result for mutant, result in results if mutant.module.startswith(package)]
        noticed = sum(result.outcome in ("failed", "too long") for result in outcomes)
        share = f"{noticed / len(outcomes):6.1%}" if outcomes else "     –"
        print(f"{package or 'all':12} {len(outcomes):7}  {noticed:7}  {share}")
    print("\nsurvivors")
    for mutant, result in sorted(results, key=lambda pair: in_order(pair[0])):
        if result.outcome in ("passed", "no tests"):
            why = "no test file" if result.outcome == "no tests" else mirror(mutant.module)
            named = ", explained" if f"`{mutant.after}`" in explained else ""
            print(f"{mutant.module}:{mutant.line} ({why}{named})")
            print(f"    - {mutant.before}\n    + {mutant.after}")


def main() -> None:
    """Draw mutants, try them and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--count", type=int, default=200, help="number of mutants")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the draw")
    parser.add_argument("--only", default="", help="beginning of the modules' paths")
    parser.add_argument("--jobs", type=int, default=1, help="mutants tried at the same time")
    parser.add_argument("--check", action="store_true", help="also run all tests without mutants")
    parser.add_argument("--list", action="store_true", help="only list the mutants")
    arguments = parser.parse_args()
    mutants = draw(arguments.count, arguments.only, arguments.seed)
    if arguments.list:
        for mutant in sorted(mutants, key=in_order):
            print(f"{mutant.module}:{mutant.line} ({mirror(mutant.module)})")
            print(f"    - {mutant.before}\n    + {mutant.after}")
        return
    _import_libraries()
    arguments.out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(arguments.out / TREES, ignore_errors=True)
    with ProcessPoolExecutor(
        arguments.jobs, get_context("fork"), _open_laboratory, (arguments.out,)
    ) as pool:
        results = []
        for mutant, outcome in zip(mutants, pool.map(_try_mutant, mutants), strict=True):
            results.append((mutant, outcome))
            said = f"{outcome.outcome} ({outcome.seconds:.0f} s) {outcome.by}"
            print(f"{len(results)}/{len(mutants)} {mutant.module}:{mutant.line} {said}", flush=True)
        report(results)
        passed = (mirror(mutant.module) for mutant, result in results if result.outcome == "passed")
        sound = set(passed)
        used = {tests for mutant in mutants if (tests := mirror(mutant.module))}
        if arguments.check:
            sound |= set(pool.map(_sound, sorted(used - sound)))
    print(f"\n{len(sound)} of {len(used)} test files were seen to pass")
    shutil.rmtree(arguments.out / TREES)


_laboratory: Laboratory  # of a process of the pool


def _open_laboratory(out: Path) -> None:
    global _laboratory
    _laboratory = Laboratory(out)


def _try_mutant(mutant: Mutant) -> Result:
    return _laboratory.try_mutant(mutant)


def _sound(tests: str) -> str:
    """Return the name of a test file that passes without a mutant.

    Raises:
        SystemExit: if it fails, so that it could not notice a mutant.
    """
    result = _laboratory.try_tests(tests)
    if result.outcome != "passed":
        sys.exit(f"{tests} does not pass without a mutant: {result.by}")
    return tests


if __name__ == "__main__":
    main()
