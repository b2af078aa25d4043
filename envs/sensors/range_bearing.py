"""Range and bearing from a place beside the road, as a LiDAR reports them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.observation import RangeBearingView
from olne_bench.games.model.sensor import Layer


@dataclass(frozen=True)
class RangeBearing:
    """Range [m] and bearing [rad] of each player. It must face the scene (``RangeBearingView``).

    Attributes:
        position: px and py of the sensor [m].
        facing: direction of bearing zero [rad].
        bearing_scale: noise of the bearing over that of the range [rad/m].

    Raises:
        ValueError: on a position that is not a pair of numbers, or numbers out of range.
    """

    name: ClassVar[str] = "range_bearing"
    position: Sequence[float] = (0.0, 0.0)
    facing: float = 0.0
    bearing_scale: float = 0.1

    def __post_init__(self) -> None:
        self.layers()

    def layers(self) -> tuple[Layer, ...]:
        """One view."""
        try:
            px, py = (float(value) for value in self.position)
        except (TypeError, ValueError):
            raise ValueError(f"position must be px and py, got {self.position!r}") from None
        return (RangeBearingView((px, py), float(self.facing), float(self.bearing_scale)),)
