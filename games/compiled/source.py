"""Writes the C source of a structure of games: sizes, functions of its terms, tables of these.

CasADi writes the functions of one player and of a pair as C. The numbers of a game are arguments,
so that games which differ in goals, targets, lanes or dt share one library, for any horizon.
"""

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib.resources import files

import casadi as ca
import numpy as np

from olne_bench.games.compiled.complementarity import COMPLEMENTARITY_FUNCTIONS
from olne_bench.games.compiled.constraint_functions import CONSTRAINT_FUNCTIONS
from olne_bench.games.compiled.stage_functions import StageFunctions
from olne_bench.games.compiled.stage_patterns import Pattern
from olne_bench.games.compiled.terms import FUNCTIONS


@lru_cache(maxsize=64)
def source_of(stages: StageFunctions) -> str:
    """The C source of a structure of games."""
    head = "".join(f"#define {name} {value}\n" for name, value in _sizes(stages).items())
    folder = files("olne_bench.games.compiled")
    names = ["elimination.c", "reduction.c", "response.c"]
    names += ["interior.c"] if stages.constraints else []
    body = "".join(folder.joinpath(name).read_text() for name in names)
    return head + _functions(stages) + body.replace("DEFINITIONS", _definitions(stages))


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
        "SAMPLES": stages.num_samples // count,
        "NUMBERS": max(kind.num_numbers for kind in stages.kinds),
        "BLOCKS": sum(pattern.size for pattern in stages.blocks),
        "FINAL_BLOCKS": sum(pattern.size for pattern in stages.final_blocks),
        "CURVATURE": max(stages.curvature.size, stages.final_curvature.size),
        "LOSS_HESSIAN": stages.loss.pattern.size,
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


def _functions(stages: StageFunctions) -> str:
    """CasADi's C code of all functions: ``term<kind>_<name>`` and so on, and of the loss."""
    groups = {f"term{k}": kind.functions for k, kind in enumerate(stages.kinds)}
    for k, pair in enumerate(stages.constraint_kinds):
        groups |= {f"constraint{k}_{last}": one.functions for last, one in enumerate(pair)}
    groups |= {f"equation{k}": one.functions for k, one in enumerate(stages.complementarity_kinds)}
    generator = ca.CodeGenerator("stages", {"casadi_int": "int"})
    for group, functions in groups.items():
        for name, function in functions.items():
            arguments = function.sx_in()
            generator.add(ca.Function(f"{group}_{name}", arguments, function.call(arguments)))
    generator.add(stages.loss.value)
    generator.add(stages.loss.hessian)
    return f"#define CASADI_SYMBOL_EXPORT static\n{without_checks(generator.dump())}"


def without_checks(code: str) -> str:
    """CasADi's C code without its checks for absent arguments and results; all are given here.

    RuntimeError if CasADi writes its checks in another way.
    """
    code = re.sub(r"(arg\[\d+\])\? (\1\[\d+\]) : 0", r"\2", code)
    code = re.sub(r"if \(res\[\d+\]!=0\) ", "", code)
    if left := re.search(r"(?:arg|res)\[\d+\] *(?:\?|!=)", code):
        raise RuntimeError(f"this version of CasADi writes an unknown check: {left[0]}")
    return code


def _definitions(stages: StageFunctions) -> str:
    """Patterns, kinds of terms and terms, as ``elimination.c`` needs them."""
    lines = _patterns("PATTERN", stages.blocks) + _patterns("FINAL", stages.final_blocks)
    lines += _patterns("PATTERN", [stages.curvature]) + _patterns("FINAL", [stages.final_curvature])
    for k, name in enumerate(("LOSS_PLACES", "FINAL_LOSS_PLACES")):
        rows = [_integers(places[k]) for places in stages.loss_indices]
        lines.append(f"static const int *const {name}[PLAYERS] = {_braces(rows)};")
    kinds, terms = [], []
    for index, kind in enumerate(stages.kinds):
        names = [f"term{index}_{name}" for name in FUNCTIONS]
        outputs = [kind.functions[name].numel_out(0) for name in FUNCTIONS]
        own = [_integers(kind.own_places(name)) for name in FUNCTIONS[:4]]
        kinds.append(_braces([_braces(names), _braces(outputs), _braces(own)]))
    for term in stages.terms:
        indices = _braces(map(_integers, term.indices.values()))
        head = f"KINDS + {term.kind}", term.owner, len(term.players)
        terms.append(_braces([*head, _integers(term.players), indices]))
    owned: list[list[int]] = [[] for _ in range(stages.num_players)]
    for index, term in enumerate(stages.terms):
        owned[term.owner].append(index)
    lists = [_braces([len(own), _integers(own)]) for own in owned]
    lines += [_table("Kind KINDS[]", kinds), _table("Term TERMS[]", terms)]
    lines += [_table("TermsOf TERMS_OF[PLAYERS]", lists)]
    return "\n".join([*lines, *_constraints(stages), *_equations(stages)])


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
