"""Range and bearing from a place beside the road, as a LiDAR reports them."""

from dataclasses import dataclass
from typing import ClassVar

from olne_bench.games.model.observation import RangeBearingView
from olne_bench.games.model.sensor import Layer


@dataclass(frozen=True)
class RangeBearing:
    """Range [m] and bearing [rad] of each player. It must face the scene (``RangeBearingView``)."""

    name: ClassVar[str] = "range_bearing"
    position: tuple[float, float] = (0.0, 0.0)  # px and py of the sensor [m]
    facing: float = 0.0  # direction of bearing zero [rad]
    bearing_scale: float = 0.1  # noise of the bearing over that of the range [rad/m]

    def __post_init__(self) -> None:
        self.layers()

    def layers(self) -> tuple[Layer, ...]:
        """One view."""
        return (RangeBearingView(self.position, self.facing, self.bearing_scale),)
