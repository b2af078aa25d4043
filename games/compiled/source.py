"""Writes the C source of a structure of games: sizes, functions of its terms, tables of these.

CasADi writes the functions of one player and of a pair as C. The numbers of a game are arguments,
so that games which differ in goals, targets, lanes or dt share one library, for any horizon. These
functions are a source of their own, which games of other numbers of players share.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files

import casadi as ca
import numpy as np

from olne_bench.games.compiled.complementarity import COMPLEMENTARITY_FUNCTIONS
from olne_bench.games.compiled.constraint_functions import CONSTRAINT_FUNCTIONS
from olne_bench.games.compiled.derived import derived
from olne_bench.games.compiled.stage_functions import StageFunctions
from olne_bench.games.compiled.stage_patterns import Pattern
from olne_bench.games.compiled.terms import FUNCTIONS

#: What is compiled behind the functions of a structure: for one game at a time, and for four.
_FOUR = ("stages.c", "elimination.c", "newton.c", "sensitivities.c")
_ONE = ("stages.c", "constraints.c", *_FOUR[1:], "reduction.c", "response.c")

#: How C spells what CasADi calls ``casadi_inf`` and ``casadi_nan``.
_LIMITS = {"inf": "INFINITY", "nan": "NAN"}


@lru_cache(maxsize=64)
def source_of(stages: StageFunctions) -> tuple[str, str]:
    """The C source of a structure of games, and the one of its functions."""
    functions = _functions(stages)
    code = derived("functions", stages.origin, lambda: generated(functions))
    names = [*_ONE, "interior.c"] if stages.constraints else _ONE
    parts = [text_of("one.c"), _prototypes(functions), *map(text_of, names)]
    source = _defines(_sizes(stages)) + "".join(parts)
    source = source.replace("DEFINITIONS", _definitions(stages))
    return source, f"#define CASADI_SYMBOL_EXPORT\n#include <math.h>\n{code}"


@lru_cache(maxsize=64)
def source_of_four(stages: StageFunctions) -> tuple[str, str]:
    """The same of Newton's method and sensitivities for four games, without constraints."""
    used = tuple(f"_{name}" for name in FUNCTIONS[:4])
    functions = {n: one for n, one in _functions(stages).items() if n.endswith(used)}
    code = derived("functions of four", stages.origin, lambda: four_of(functions))
    sizes = _sizes(stages) | {"CURVATURE": 0}
    without = "#define add_equations(...)\n#define add_condensed(...)\n#define definite(M) 1\n"
    parts = [text_of("four.c"), _prototypes(functions), without, *map(text_of, _FOUR)]
    lines = [*_stage_patterns(stages), *_terms(stages, FUNCTIONS[:4])]
    source = _defines(sizes) + "".join(parts).replace("DEFINITIONS", "\n".join(lines))
    return source, text_of("four.c") + code


def text_of(name: str) -> str:
    """A C file of this folder."""
    return files("olne_bench.games.compiled").joinpath(name).read_text()


def _defines(sizes: dict[str, int]) -> str:
    return "".join(f"#define {name} {value}\n" for name, value in sizes.items())


def _sizes(stages: StageFunctions) -> dict[str, int]:
    count, pairs = stages.num_players, stages.constraint_kinds
    equations = stages.complementarity_kinds
    condensed = [pair[0].functions["condensed"] for pair in pairs]
    return {
        "PLAYERS": count,
        "STATES": stages.num_states // count,
        "CONTROLS": stages.own_controls,
        "MULTIPLIERS": stages.num_multipliers,
        "WEIGHTS": stages.num_weights // count,
        "NUMBERS": max(kind.num_numbers for kind in stages.kinds),
        "BLOCKS": sum(pattern.size for pattern in stages.blocks),
        "FINAL_BLOCKS": sum(pattern.size for pattern in stages.final_blocks),
        "CURVATURE": max(stages.curvature.size, stages.final_curvature.size),
        "NUM_TERMS": len(stages.terms),
        "MOST_VALUES": _longest(f for kind in stages.kinds for f in kind.functions.values()),
        "NUM_CONSTRAINTS": len(stages.constraints),
        "MARGINS": stages.num_margins,
        "CONSTRAINT_NUMBERS": max(
            [pair[0].num_numbers for pair in pairs] + [kind.num_numbers for kind in equations],
            default=0,
        ),
        "NUM_EQUATIONS": len(stages.complementarities),
        "MOST_EQUATION": _longest(f for kind in equations for f in kind.functions.values()),
        "MOST_CONDENSED": _longest(condensed),
    }


def _longest(functions: Iterable[ca.Function]) -> int:
    """The largest number of results of any function, at least 1."""
    return max((function.numel_out(0) for function in functions), default=1)


def _functions(stages: StageFunctions) -> dict[str, ca.Function]:
    """All functions, by their names in C: ``term<kind>_<name>`` and so on."""
    groups = {f"term{k}": kind.functions for k, kind in enumerate(stages.kinds)}
    for k, pair in enumerate(stages.constraint_kinds):
        groups |= {f"constraint{k}_{last}": one.functions for last, one in enumerate(pair)}
    groups |= {f"equation{k}": one.functions for k, one in enumerate(stages.complementarity_kinds)}
    return {f"{group}_{name}": one for group, own in groups.items() for name, one in own.items()}


def _prototypes(names: Iterable[str]) -> str:
    """What C has to know of functions in another source."""
    arguments = "const real **, real **, int *, real *, int"
    return "".join(f"int {name}({arguments});\n" for name in names)


def generated(functions: Mapping[str, ca.Function]) -> str:
    """CasADi's C code of functions by the names they have there, which check no arguments."""
    generator = ca.CodeGenerator("stages", {"casadi_int": "int"})
    for name, one in functions.items():
        generator.add(ca.Function(name, one.sx_in(), one.call(one.sx_in())))
    return without_checks(generator.dump())


def four_of(functions: Mapping[str, ca.Function]) -> str:
    """CasADi's C code of functions by their names, for four games at a time behind ``four.c``."""
    code = generated(functions)
    bodies = re.findall(r"^static int casadi_f\d+(\(.*?^}\n)", code, re.M | re.S)
    named = zip(functions, map(_in_four, bodies), strict=True)
    return "".join(f"int {name}{body}" for name, body in named)


def _in_four(code: str) -> str:
    """The body of a C function by CasADi, with the names and types of ``four.c``."""
    code = re.sub(r"casadi_real|\bdouble\b", "real", code).replace("casadi_int", "int")
    code = re.sub(r"=(?:casadi_)?([a-z]\w*)\(", r"=\1_at(", code)
    code = re.sub(r"=(-?[\d.][\w.+-]*);", r"=same(\1);", code)
    code = re.sub(r"=casadi_(inf|nan);", lambda found: f"=same({_LIMITS[found[1]]});", code)
    code = re.sub(r"=\((\w+)(<|<=|==|!=)(\w+)\);", r"=flag_at(\1\2\3);", code)
    code = re.sub(r"=\((\w+)(&|\|)\2(\w+)\);", r"=flag_at((\1!=0)\2(\3!=0));", code)
    code = re.sub(r"=\(!(\w+)\);", r"=flag_at(\1==0);", code)
    return re.sub(r"=\((\w+)\?(\w+):0\);", r"=where(\1!=0,\2,same(0));", code)


def without_checks(code: str) -> str:
    """CasADi's C code without checks for absent arguments; RuntimeError if they look unknown."""
    code = re.sub(r"(arg\[\d+\])\? (\1\[\d+\]) : 0", r"\2", code)
    code = re.sub(r"if \(res\[\d+\]!=0\) ", "", code)
    if left := re.search(r"(?:arg|res)\[\d+\] *(?:\?|!=)", code):
        raise RuntimeError(f"this version of CasADi writes an unknown check: {left[0]}")
    return code


def _definitions(stages: StageFunctions) -> str:
    """Patterns, kinds of terms and terms, as ``stages.c`` needs them."""
    lines = _stage_patterns(stages)
    lines += _patterns("PATTERN", [stages.curvature]) + _patterns("FINAL", [stages.final_curvature])
    for k, name in enumerate(("OWN_STATES", "FINAL_OWN_STATES")):
        rows = [_square(places[k]) for places in stages.own_states]
        lines.append(f"static const int *const {name}[PLAYERS] = {_braces(rows)};")
    owned: list[list[int]] = [[] for _ in range(stages.num_players)]
    for index, term in enumerate(stages.terms):
        owned[term.owner].append(index)
    lists = [_braces([len(own), _integers(own)]) for own in owned]
    lines += [*_terms(stages, FUNCTIONS), _table("TermsOf TERMS_OF[PLAYERS]", lists)]
    return "\n".join([*lines, *_constraints(stages), *_equations(stages)])


def _square(triangle: np.ndarray) -> str:
    """Places of a triangle (n (n + 1) / 2,) in a square matrix, which has none below it."""
    n = int(np.sqrt(2 * len(triangle)))
    square = np.full((n, n), -1)
    square[np.triu_indices(n)] = triangle
    return _integers(square.ravel())


def _stage_patterns(stages: StageFunctions) -> list[str]:
    return _patterns("PATTERN", stages.blocks) + _patterns("FINAL", stages.final_blocks)


def _terms(stages: StageFunctions, functions: Sequence[str]) -> list[str]:
    """Kinds of terms with some of their functions, and terms."""
    kinds, terms = [], []
    for index, kind in enumerate(stages.kinds):
        names = [f"term{index}_{name}" for name in functions]
        outputs = [kind.functions[name].numel_out(0) for name in functions]
        own = [_integers(kind.own_places(name)) for name in FUNCTIONS[:4]]
        kinds.append(_braces([_braces(names), _braces(outputs), _braces(own)]))
    for term in stages.terms:
        places = [term.indices[name] for name in functions if name in term.indices]
        head = f"KINDS + {term.kind}", term.owner, len(term.players)
        terms.append(_braces([*head, _integers(term.players), _braces(map(_integers, places))]))
    return [_table("Kind KINDS[]", kinds), _table("Term TERMS[]", terms)]


def _constraints(stages: StageFunctions) -> list[str]:
    """Kinds of constraints and constraints; one that is not used where there are none."""
    kinds, constraints = [], []
    for index, pair in enumerate(stages.constraint_kinds):
        for last, functions in enumerate(pair):
            names = _braces(f"constraint{index}_{last}_{name}" for name in CONSTRAINT_FUNCTIONS)
            nonzeros = functions.functions["condensed"].numel_out(0)
            kinds.append(_braces([names, functions.num_margins, nonzeros]))
    for place in stages.constraints:
        both = _braces(f"CONSTRAINT_KINDS + {2 * place.kind + last}" for last in (0, 1))
        players = _integers(place.players), len(place.players)
        indices = _braces(map(_integers, place.indices.values()))
        constraints.append(_braces([both, indices, *players, place.offset]))
    return [
        _table("ConstraintKind CONSTRAINT_KINDS[]", kinds or ["{{0}}"]),
        _table("Constraint ALL_CONSTRAINTS[]", constraints or ["{{0}}"]),
    ]


def _equations(stages: StageFunctions) -> list[str]:
    """Kinds of constraints that are equations, and these; one that is not used for none."""
    kinds, equations = [], []
    for index, kind in enumerate(stages.complementarity_kinds):
        names = _braces(f"equation{index}_{name}" for name in COMPLEMENTARITY_FUNCTIONS)
        sizes = [kind.functions[name].numel_out(0) for name in COMPLEMENTARITY_FUNCTIONS]
        kinds.append(_braces([names, _braces(sizes)]))
    for place in stages.complementarities:
        indices = [_integers(place.indices[name]) for name in COMPLEMENTARITY_FUNCTIONS[:3]]
        head = f"EQUATION_KINDS + {place.kind}", len(place.players), place.offset
        lists = len(place.theta), _integers(place.players), _integers(place.theta)
        equations.append(_braces([*head, *lists, _braces(indices)]))
    return [
        _table("EquationKind EQUATION_KINDS[]", kinds or ["{{0}}"]),
        _table("Equation EQUATIONS[]", equations or ["{0}"]),
    ]


def _patterns(prefix: str, patterns: Iterable[Pattern]) -> list[str]:
    """Definitions of patterns whose values follow one another."""
    lines, offset = [], 0
    for one in patterns:
        places = _integers(one.rows), _integers(one.columns)
        lines.append(_table(f"Pattern {prefix}_{one.name}", [one.size, offset, *places]))
        offset += one.size
    return lines


def _table(what: str, entries: Iterable[object]) -> str:
    return f"static const {what} = {_braces(entries)};"


def _braces(parts: Iterable[object]) -> str:
    return f"{{{', '.join(map(str, parts))}}}"


def _integers(values: Sequence[int] | np.ndarray) -> str:
    return f"(const int[]){_braces(values) if len(values) else '{0}'}"
