"""Noise that is correlated between components."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.sensor import CorrelatedNoise, CovarianceNoise, Layer


@dataclass(frozen=True)
class Correlated:
    """Noise with a correlation between components, or with a given covariance.

    Whether these are a covariance is checked once it is known what is seen.
    """

    name: ClassVar[str] = "correlated"
    correlation: float = 0.7  # correlation between any two of the components
    components: Sequence[str] = ()  # names of the components. Default: all that are seen
    #: (d, d) rows, relative to sigma^2, in place of the other two.
    covariance: Sequence[Sequence[float]] = ()

    def __post_init__(self) -> None:
        self.layers()

    def layers(self) -> tuple[Layer, ...]:
        """One noise layer."""
        try:
            rows = tuple(tuple(float(value) for value in row) for row in self.covariance)
            correlation = float(self.correlation)
        except (TypeError, ValueError):
            raise ValueError(
                "correlation must be a number and covariance rows of numbers, got "
                f"{self.correlation!r} and {self.covariance!r}"
            ) from None
        if isinstance(self.components, str):
            raise ValueError(f"components must be a list of names, got {self.components!r}")
        if rows:
            return (CovarianceNoise(rows),)
        return (CorrelatedNoise(correlation, tuple(self.components)),)
