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
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from operator import itemgetter
from pathlib import Path
from threading import get_ident
from typing import NamedTuple

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


#: An operator is replaced by one of its kind. Any test would notice ``a << b`` on floats, and
#: ``is`` for ``==`` makes no difference for the objects compared here.
KINDS = (
    {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"},
    {"BitOr", "BitAnd", "BitXor"},
    {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"},
    {"Is", "IsNot"},
)


def operators() -> dict[str, list[Operator]]:
    """The possible mutations, as operators of cosmic-ray, by type of syntax."""
    truth = (
        boolean_replacer.ReplaceTrueWithFalse,
        boolean_replacer.ReplaceFalseWithTrue,
        boolean_replacer.ReplaceAndWithOr,
        boolean_replacer.ReplaceOrWithAnd,
    )
    families = binary_operator_replacement, comparison_operator_replacement
    binary, comparison = (
        [
            one()
            for one in family.operators()
            if any(set(one.__name__.split("_")[-2:]) <= kind for kind in KINDS)
        ]
        for family in families
    )
    signs = ("USub_UAdd", "Delete_USub", "Delete_Not")
    unary = [
        one() for one in unary_operator_replacement.operators() if one.__name__.endswith(signs)
    ]
    # The types share one object, as places are counted by operator.
    negation: list[Operator] = [boolean_replacer.AddNot()]
    return {
        "number": [NumberReplacer()],
        "keyword": [one() for one in truth],
        "operator": binary,
        "comparison": comparison,
        **dict.fromkeys(("if_stmt", "while_stmt", "assert_stmt", "test"), negation),
        **dict.fromkeys(("factor", "not_test"), unary),
    }


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
    """The ranges of a module's text that are not mutated.

    These are annotations and aliases of types, ``__all__``, ``if TYPE_CHECKING``, messages
    (arguments of errors, prints, warnings and logs), and the arguments of ``WITHOUT_EFFECT``.
    Docstrings and other texts have no tokens to mutate.
    """
    lines = source.splitlines()

    def position(line: int | None, column: int | None) -> Position:
        return line or 0, len(lines[(line or 0) - 1].encode()[:column].decode())

    return [
        (position(part.lineno, part.col_offset), position(part.end_lineno, part.end_col_offset))
        for node in ast.walk(ast.parse(source))
        for part in _without_tests(node)
        if part is not None
    ]


def _without_tests(node: ast.AST) -> Sequence[ast.expr | None]:
    """The parts of a node that are not mutated."""
    match node:
        case ast.FunctionDef(returns=part) | ast.AsyncFunctionDef(returns=part):
            return [part]
        case ast.arg(annotation=part) | ast.AnnAssign(annotation=part) | ast.Raise(exc=part):
            return [part]
        case ast.If(test=ast.Name(id="TYPE_CHECKING") as part):
            return [part]
        case ast.Assign(targets=targets, value=value):
            names = [target.id for target in targets if isinstance(target, ast.Name)]
            union = isinstance(value, ast.BinOp) and isinstance(value.op, ast.BitOr)
            alias = union and any(name.lstrip("_")[:1].isupper() for name in names)
            return [value] if alias or "__all__" in names else []
        case ast.Call(func=function, args=args, keywords=keywords):
            name = ast.unparse(function).split(".")[-1]
            if name in MESSAGES or name.endswith("Error"):
                return [*args, *(keyword.value for keyword in keywords)]
            return [word.value for word in keywords if (name, word.arg) in WITHOUT_EFFECT]
    return []


class Place(NamedTuple):
    """A token of a module and its possible mutations: operators and their occurrence numbers."""

    order: str
    module: str
    line: int
    choices: list[tuple[Operator, int]]


def places(module: str, source: str, seed: int) -> Iterator[Place]:
    """The places of a module that can be mutated, with their order in the draw of a seed."""
    every, ranges = operators(), skipped(source)
    counts: Counter[Operator] = Counter()
    found: dict[Position, list[tuple[Operator, int]]] = {}
    for node in ast_nodes(get_ast(source)):
        for operator in every.get(node.type, ()):
            for start, _ in operator.mutation_positions(node):
                # A bare * or / among parameters refuses calls that are never made.
                if node.parent is None or node.parent.type != "parameters":
                    found.setdefault(start, []).append((operator, counts[operator]))
                counts[operator] += 1
    lines = source.splitlines()
    before: Counter[str] = Counter()
    for start in sorted(found):
        # The text does not change if lines are added above it, so draws stay the same.
        line, column = lines[start[0] - 1], start[1]
        text = f"{seed}|{module}|{line.strip()}|{column - len(line) + len(line.lstrip())}"
        before[text] += 1
        if not any(first <= start < last for first, last in ranges):
            order = hashlib.sha256(f"{text}|{before[text]}".encode()).hexdigest()
            yield Place(order, module, start[0], found[start])


class Mutant(NamedTuple):
    """A module with one token changed; ``before`` and ``after`` are its lines."""

    module: str
    line: int
    before: str
    after: str
    source: str


def mutate(place: Place, source: str) -> Mutant | None:
    """A random mutant of a place; None if no choice gives another program."""
    choices = list(place.choices)
    random.Random(place.order).shuffle(choices)
    for operator, occurrence in choices:
        changed = mutate_code(source, operator, occurrence)
        with suppress(SyntaxError):
            if changed and ast.dump(ast.parse(source)) != ast.dump(ast.parse(changed)):
                lines = list(difflib.ndiff(source.splitlines(), changed.splitlines()))
                before, after = (
                    " ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+"
                )
                return Mutant(place.module, place.line, before, after, changed)
    return None


def draw(count: int, only: str, seed: int) -> list[Mutant]:
    """The first ``count`` mutants of the modules whose path begins with ``only``.

    They are in the order of the draw, so those tried before an interruption are a fair sample.
    """
    files = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    sources = {
        str(path.relative_to(ROOT)): path.read_text()
        for path in files
        if "templates" not in path.parts and str(path.relative_to(ROOT)).startswith(only)
    }
    found = [place for module, source in sources.items() for place in places(module, source, seed)]
    drawn = (mutate(one, sources[one.module]) for one in sorted(found, key=itemgetter(0)))
    mutants = list(islice(filter(None, drawn), count))
    print(f"{len(mutants)} mutants of {len(found)} places in {len(sources)} modules")
    return mutants


def in_order(mutants: Iterable[Mutant]) -> list[Mutant]:
    """By package, module and line."""

    def place(one: Mutant) -> tuple[int, str, int]:
        return PACKAGES.index(Path(one.module).parts[0]), one.module, one.line

    return sorted(mutants, key=place)


# --------------------------------------------------------------------------------------- judgement


class Result(NamedTuple):
    """What became of tests (passed, failed, too long, no tests), in which time [s], and by what."""

    outcome: str
    seconds: float = 0.0
    by: str = ""


class Laboratory:
    """Copies of the tree, one for each thread, in which mutants are tried, and known results."""

    def __init__(self, out: Path) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self._known_file, self._trees = out / "results.jsonl", out.absolute() / "trees"
        shutil.rmtree(self._trees, ignore_errors=True)
        lines = self._known_file.read_text().splitlines() if self._known_file.is_file() else []
        entries = [json.loads(line) for line in lines]
        self._known = {entry.pop("key"): Result(**entry) for entry in entries}

    def run(self, tests: tuple[str, ...], module: str = "", source: str = "") -> Result:
        """Run tests with a module's text replaced, unless the result is known."""
        if not tests:
            return Result("no tests")
        folders = {ROOT / folder for name in tests for folder in Path(name).parents}
        above = sorted(folder / "conftest.py" for folder in folders)
        files = [*(ROOT / name for name in tests), *(file for file in above if file.is_file())]
        texts = [*tests, *(file.read_text() for file in files), module, source]
        key = hashlib.sha256("\0".join(texts).encode()).hexdigest()
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
                file.write(json.dumps({"key": key, **self._known[key]._asdict()}) + "\n")
        return self._known[key]

    def try_mutant(self, mutant: Mutant) -> Result:
        """Run the tests of a mutant."""
        return self.run(mirror(mutant.module), mutant.module, mutant.source)


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
    print("\npackage      mutants  noticed  share")
    for package in (*PACKAGES, ""):
        outcomes = [result for mutant, result in results if mutant.module.startswith(package)]
        noticed = sum(result.outcome in ("failed", "too long") for result in outcomes)
        share = f"{noticed / len(outcomes):6.1%}" if outcomes else "     –"
        print(f"{package or 'all':12} {len(outcomes):7}  {noticed:7}  {share}")
    print("\nsurvivors")
    left = [mutant for mutant, result in results if result.outcome in ("passed", "no tests")]
    for mutant in in_order(left):
        show(mutant)


def show(mutant: Mutant) -> None:
    """Print a mutant and its tests."""
    tests = " ".join(mirror(mutant.module)) or "no test file"
    print(f"{mutant.module}:{mutant.line} ({tests})")
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
        for mutant in in_order(mutants):
            show(mutant)
        return
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
