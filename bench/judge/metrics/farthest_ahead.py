"""How far the worst predicted car is from where it goes: radii of regions are made of it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.bench.judge.metrics.ahead_error import AheadError


@dataclass(frozen=True)
class FarthestAhead(AheadError):  # noqa: N818  it is no exception
    """Distance of the car that is farthest from its predicted position some seconds ahead.

    Discs of this radius around predicted positions hold all cars (``statistics.conformal``).
    The prediction, and its time, are those of ``ahead_error``.
    """

    name: ClassVar[str] = "farthest_ahead"
    label: ClassVar[str] = "farthest car ahead"
    radius: ClassVar[bool] = True

    def apart(self, truth: np.ndarray, predicted: np.ndarray) -> float:
        """The largest distance [m] between states (N, n) of a player."""
        return float(np.linalg.norm((truth - predicted)[:, :2], axis=1).max())
