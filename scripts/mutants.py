"""Count the random one-token mutants of the packages that their mirrored test files notice.

    python scripts/mutants.py --out runs/mutants
    python scripts/mutants.py --out runs/mutants --count 60 --only bench/plan --listed
    python scripts/mutants.py --out runs/mutants --count 60 --seed 7

A mutant is the code with one operator, comparison, number, boolean, ``and``, ``or``, ``not`` or
sign replaced by cosmic-ray's operators. Places are drawn with a fixed seed and equal chance; a
larger ``--count`` contains a smaller one. For each mutant, only the test files of its module
(:func:`mirror`) are run, in a copy of the tree. The mutant is noticed if the tests fail or
exceed their time. Results are kept in the folder ``--out`` by the contents of module and tests: an
interrupted run continues where it stopped, and a second run repeats only what changed.
"""

import ast
import difflib
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import types
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import get_ident

import shared
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


def mirror(module: str, root: Path = ROOT) -> tuple[str, ...]:
    """Return the test files of a module; where there are none, no mutant of it counts as noticed.

    They are ``tests/ROOM/test_MODULE.py``; else the files of that folder that import the module;
    else those with the module's last words left out (``store_merge`` has its tests in
    ``test_store.py``); else all of the folder.
    """
    path = Path(module)
    folder = root / "tests" / path.parent
    words = path.stem.split("_")
    names = [folder / f"test_{'_'.join(words[:n])}.py" for n in range(len(words), 0, -1)]
    if not names[0].is_file():
        dotted = ".".join(path.with_suffix("").parts)
        parent, _, name = dotted.rpartition(".")
        imports = re.compile(rf"olne_bench\.({dotted}\b|{parent} import [^\n]*\b{name}\b)")
        every = sorted(folder.glob("test_*.py"))
        told = [file for file in every if imports.search(file.read_text())]
        names = told or [file for file in names if file.is_file()][:1] or every
    else:
        names = names[:1]
    return tuple(str(file.relative_to(root)) for file in names)


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
    """The result of running tests: ``passed``, ``failed``, ``too long`` or ``no tests``.

    Attributes:
        outcome: one of these.
        seconds: time that they took [s].
        by: the test that failed.
    """

    outcome: str
    seconds: float = 0.0
    by: str = ""


class Laboratory:
    """Copies of the tree, one for each thread, in which mutants are tried, and known results."""

    def __init__(self, out: Path) -> None:
        self._known_file, self._trees = out / "results.jsonl", out.absolute() / "trees"
        shutil.rmtree(self._trees, ignore_errors=True)
        self._known: dict[str, Result] = {}
        if self._known_file.is_file():
            for line in self._known_file.read_text().splitlines():
                entry = json.loads(line)
                self._known[entry.pop("key")] = Result(**entry)

    def run(self, tests: tuple[str, ...], module: str = "", source: str = "") -> Result:
        """Run tests with a module's text replaced, unless the result is known."""
        if not tests:
            return Result("no tests")
        texts = [file.read_text() for file in self._files(tests)]
        key = hashlib.sha256("\0".join([*tests, *texts, module, source]).encode()).hexdigest()
        if key not in self._known:
            tree = self._trees / str(get_ident())
            if not tree.exists():
                _copy_tree(tree)
            if module:
                (tree / module).write_text(source)
            self._known[key] = _pytest(tree, tests)
            if module:
                shutil.copy2(ROOT / module, tree / module)
            with self._known_file.open("a") as file:
                file.write(json.dumps({"key": key, **asdict(self._known[key])}) + "\n")
        return self._known[key]

    def try_mutant(self, mutant: Mutant) -> Result:
        """Run the tests of a mutant."""
        return self.run(mirror(mutant.module), mutant.module, mutant.source)

    def _files(self, tests: tuple[str, ...]) -> list[Path]:
        """The test files, and each ``conftest.py`` above them."""
        folders = {ROOT / folder for name in tests for folder in Path(name).parents}
        above = sorted(folder / "conftest.py" for folder in folders)
        return [*(ROOT / name for name in tests), *(file for file in above if file.is_file())]


def _copy_tree(tree: Path) -> None:
    """Copy what git does not ignore."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).exists() and not name.startswith("results/"):
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name, follow_symlinks=False)


def _pytest(tree: Path, tests: tuple[str, ...]) -> Result:
    """Run test files in a tree; kill them, with their descendants, after ``LIMIT`` seconds."""
    begin = time.monotonic()
    kinds = "not corpus and not learners and not browser"  # but tests that take long
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", kinds]
    # A changed text is always noticed, as no bytecode is kept.
    environment = os.environ | {"PYTHONPATH": "src", "PYTHONDONTWRITEBYTECODE": "1"}
    limit = ["bash", "-c", f'ulimit -t {PROCESSOR_LIMIT} && exec "$@"', "bash"]
    process = subprocess.Popen(
        [*limit, *command, f"--basetemp={tree}.tmp", *tests],
        cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    try:
        said, _ = process.communicate(timeout=LIMIT)
        outcome = "failed" if process.returncode else "passed"
        outcome = "too long" if process.returncode < 0 else outcome
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said, outcome = process.communicate()[0], "too long"
    lines = said.splitlines()
    by = [line for line in lines if line.startswith(("FAILED", "ERROR"))] or lines[-1:]
    return Result(outcome, round(time.monotonic() - begin, 2), by[-1][:200] if by else "")


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
            show(mutant, ", explained" if f"`{mutant.after}`" in explained else "")


def show(mutant: Mutant, said: str = "") -> None:
    """Print a mutant and its tests."""
    tests = " ".join(mirror(mutant.module)) or "no test file"
    print(f"{mutant.module}:{mutant.line} ({tests}{said})")
    print(f"    - {mutant.before}\n    + {mutant.after}")


def main(
    out: Path = Path("runs/mutants"),
    count: int = 200,
    seed: int = SEED,
    only: str = "",
    jobs: int = 1,
    check: bool = False,
    listed: bool = False,
) -> None:
    """Draw mutants, try them and report; with ``check``, run all their tests without mutants."""
    mutants = draw(count, only, seed)
    if listed:
        for mutant in sorted(mutants, key=in_order):
            show(mutant)
        return
    out.mkdir(parents=True, exist_ok=True)
    laboratory, results = Laboratory(out), []
    with ThreadPoolExecutor(jobs) as pool:
        for mutant, result in zip(mutants, pool.map(laboratory.try_mutant, mutants), strict=True):
            results.append((mutant, result))
            said = f"{result.outcome} ({result.seconds:.0f} s) {result.by}"
            print(f"{len(results)}/{len(mutants)} {mutant.module}:{mutant.line} {said}", flush=True)
        report(results)
        used = sorted({mirror(mutant.module) for mutant in mutants})
        for tests, result in zip(
            used, pool.map(laboratory.run, used) if check else (), strict=False
        ):
            if result.outcome == "failed":
                sys.exit(f"{' '.join(tests)} do not pass without a mutant: {result.by}")


if __name__ == "__main__":
    shared.command(main)
