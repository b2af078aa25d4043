"""Where the nonzeros of derivatives sit, and how those of many terms come together in one stage."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the nonzeros of a block sit; values come from a function, in this order."""

    name: str
    rows: np.ndarray
    columns: np.ndarray

    @property
    def size(self) -> int:
        """Number of nonzeros."""
        return len(self.rows)


#: Blocks of nonzeros at their places in the whole stage: name, rows, columns.
Entries = list[tuple[str, np.ndarray, np.ndarray]]


def merged(parts: Sequence[Entries]) -> tuple[tuple[Pattern, ...], list[np.ndarray]]:
    """Patterns of blocks that hold all nonzeros of all parts; where in them each part's are."""
    patterns, offset = [], 0
    places: list[list[np.ndarray]] = [[] for _ in parts]
    for name in dict.fromkeys(name for part in parts for name, _, _ in part):
        found = [(np.zeros(0, int), np.zeros(0, int)) for _ in parts]
        for k, part in enumerate(parts):
            for block, rows, columns in part:
                if block == name:
                    found[k] = rows, columns
        pairs = np.concatenate([np.stack(pair, axis=1) for pair in found])
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        patterns.append(Pattern(name, *unique.T.astype(np.int32)))
        ends = np.cumsum([len(rows) for rows, _ in found])
        for place, indices in zip(places, np.split(inverse.ravel(), ends[:-1]), strict=True):
            place.append(offset + indices)
        offset += len(unique)
    return tuple(patterns), [np.concatenate(place).astype(np.int32) for place in places]


def half(hessian: ca.SX) -> ca.SX:
    """Upper triangle with half the diagonal."""
    return ca.triu(hessian, False) + ca.diag(ca.diag(hessian)) / 2


def nonzeros(name: str, block: ca.SX) -> tuple[Pattern, ca.SX]:
    """The pattern of a block, and its nonzeros in one column."""
    block = ca.sparsify(block)
    rows, columns = block.sparsity().get_triplet()
    pattern = Pattern(name, np.array(rows, dtype=np.int32), np.array(columns, dtype=np.int32))
    return pattern, block.nz[:] if rows else ca.SX(0, 1)


def stack(**blocks: ca.SX) -> tuple[tuple[Pattern, ...], ca.SX]:
    """Patterns of all blocks and their nonzeros in one column."""
    pairs = [nonzeros(name, block) for name, block in blocks.items()]
    return tuple(pattern for pattern, _ in pairs), ca.vertcat(*[values for _, values in pairs])


def named_functions(
    names: Sequence[str], arguments: Sequence[ca.SX], values: Mapping[str, ca.SX]
) -> dict[str, ca.Function]:
    """Dense functions of the same arguments, by their names."""
    return {
        name: ca.Function(name, arguments, [ca.cse(ca.densify(values[name]))]) for name in names
    }
