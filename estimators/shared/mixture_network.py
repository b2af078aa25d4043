"""A network that turns an observation into mixtures of Gaussians, in NumPy.

It tells the weights of all players in one pass, or those of one player after the other, each as the
first one, so that all players' draws train the same numbers and weights are independent.

The input is an observation of known length: each sample in units of its spread over training draws,
zero where it is missing; which samples of which player are seen; which components; the logarithm of
the noise level; and whose turn it is, where there are several. Layers with SiLU in between lead to
the mixture's logits, means and triangles P, where P' P is a component's precision
(``scripts/train_learned.py``).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import log_softmax

from olne_bench.estimators.shared.small_network import Layers, layers_of, output

#: Logarithms of the triangles' diagonals stay within this of zero: a deviation of at least 1e-4.
LARGEST_LOG = 9.2

#: Standardised samples beyond this say no more.
_FARTHEST = 12.0


@dataclass(frozen=True)
class Mixture:
    """C Gaussians in D dimensions."""

    logits: np.ndarray  # (C,) logarithms of the weights, up to a constant
    means: np.ndarray  # (C, D)
    triangles: np.ndarray  # (C, D, D) lower triangular P with positive diagonal

    def log_density(self, points: np.ndarray) -> np.ndarray:
        """(B,) at points (B, D)."""
        away = points[:, None, :] - self.means
        errors = np.einsum("cij,bcj->bci", self.triangles, away)
        sizes = np.log(np.diagonal(self.triangles, axis1=1, axis2=2)).sum(axis=1)
        each = log_softmax(self.logits) + sizes - 0.5 * np.square(errors).sum(axis=2)
        size = points.shape[1]
        return np.asarray(np.logaddexp.reduce(each, axis=1) - 0.5 * size * np.log(2 * np.pi))

    def samples(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Points (count, D)."""
        shares = np.exp(log_softmax(self.logits))
        chosen = rng.choice(len(shares), size=count, p=shares / shares.sum())
        errors = rng.standard_normal((count, self.means.shape[1], 1))
        return self.means[chosen] + np.linalg.solve(self.triangles[chosen], errors)[..., 0]


@dataclass(frozen=True)
class MixtureNetwork:
    """A trained network."""

    layers: Layers  # its layers
    centre: np.ndarray  # (T, N, n) mean of the states over training draws
    spread: np.ndarray  # (T, N, n) their standard deviation
    sigmas: tuple[float, float]  # least and largest noise level that it was trained for
    components: int  # number of Gaussians
    size: int  # D, of one pass
    passes: int  # 1, or N for players one after the other
    game: str  # identifies the game that it was trained for

    @classmethod
    def read(cls, path: Path) -> "MixtureNetwork":
        """A network that was written by the script that trains it."""
        with np.load(path, allow_pickle=False) as file:
            return cls(
                layers=layers_of(file),
                centre=file["centre"],
                spread=file["spread"],
                sigmas=(float(file["sigmas"][0]), float(file["sigmas"][1])),
                components=int(file["components"]),
                size=int(file["size"]),
                passes=int(file["passes"]),
                game=str(file["game"]),
            )

    def mixtures(self, states: np.ndarray, sigma: float) -> list[Mixture]:
        """The mixture of each pass given noisy states (T, N, n), NaN where missing."""
        turns = np.arange(self.passes)
        repeated, sigmas = np.repeat(states[None], self.passes, axis=0), np.full(self.passes, sigma)
        inputs = encoded(repeated, sigmas, self.centre, self.spread, turns, self.passes)
        return [self._mixture(output(self.layers, values)) for values in inputs]

    def samples(
        self, states: np.ndarray, sigma: float, count: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Points (count, D times passes) given noisy states (T, N, n), NaN where missing."""
        return np.hstack([one.samples(count, rng) for one in self.mixtures(states, sigma)])

    def _mixture(self, values: np.ndarray) -> Mixture:
        count, size = self.components, self.size
        parts = np.split(values, np.cumsum([count, count * size, count * size]))
        logits, means, logs, rest = parts
        triangles = np.zeros((count, size, size))
        low = np.tril_indices(size, -1)
        triangles[:, low[0], low[1]] = rest.reshape(count, -1)
        diagonal = np.arange(size)
        logs = logs.reshape(count, size).clip(-LARGEST_LOG, LARGEST_LOG)
        triangles[:, diagonal, diagonal] = np.exp(logs)
        return Mixture(logits, means.reshape(count, size), triangles)


def encoded(
    states: np.ndarray,
    sigmas: np.ndarray,
    centre: np.ndarray,
    spread: np.ndarray,
    turns: np.ndarray,
    passes: int,
) -> np.ndarray:
    """Inputs (B, I) of a network from noisy states (B, T, N, n), NaN where missing, at sigmas (B,).

    A player's sample is missing as a whole, and so is a component. Centre and spread are (T, N, n);
    ``turns`` (B,) say which player comes first, and the others follow in order, round the end.
    """
    count, players = len(states), states.shape[2]
    order = (turns[:, None] + np.arange(players)) % players
    scaled = ((states - centre) / spread).clip(-_FARTHEST, _FARTHEST)
    scaled = np.take_along_axis(scaled, order[:, None, :, None], axis=2)
    known = np.isfinite(scaled)
    parts = [
        np.where(known, scaled, 0.0).reshape(count, -1),
        known.any(axis=3).reshape(count, -1),
        known.any(axis=(1, 2)),
        np.log(sigmas)[:, None],
    ]
    if passes > 1:
        parts.append(np.eye(passes)[turns])
    return np.concatenate(parts, axis=1, dtype=np.float32)
