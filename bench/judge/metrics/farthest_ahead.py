"""How far the worst predicted car is from where it goes: radii of regions are made of it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.bench.judge.metrics.judged import Judged


@dataclass(frozen=True)
class FarthestAhead:
    """Distance of the car that is farthest from its predicted position some seconds ahead.

    Discs of this radius around predicted positions hold all cars (``report.statistics.conformal``).
    The prediction is that of ``ahead_error``.

    Attributes:
        seconds: time ahead [s].
    """

    name: ClassVar[str] = "farthest_ahead"
    label: ClassVar[str] = "farthest car ahead"
    unit: ClassVar[str] = "m"
    needs_prediction: ClassVar[bool] = True
    drawn: ClassVar[bool] = False
    radius: ClassVar[bool] = True
    negligible: ClassVar[float] = 1e-5
    seconds: float = 2.0

    def score(self, case: Judged) -> float | None:
        """Largest distance [m] over players at that time; None where no game is found there."""
        found = case.ahead(self.seconds)
        if found is None:
            return None
        away = found[0][-1, :, :2] - found[1][-1, :, :2]
        return float(np.linalg.norm(away, axis=1).max())
