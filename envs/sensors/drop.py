"""Occlusion: players are missed at random."""

from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.sensor import Drops, Layer


@dataclass(frozen=True)
class Drop:
    """Every player is missed with probability p in every step, independently."""

    name: ClassVar[str] = "drop"
    p: float  # probability, 0 to 1

    def __post_init__(self) -> None:
        if isinstance(self.p, bool) or not isinstance(self.p, int | float):
            raise ValueError(f"p must be a probability between 0 and 1, got {self.p!r}")
        self.layers()

    def layers(self) -> tuple[Layer, ...]:
        """One gaps layer; other layers define what is seen otherwise."""
        return (Drops(float(self.p)),)
