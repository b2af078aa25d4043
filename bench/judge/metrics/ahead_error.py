"""Error of what is predicted to follow."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


@dataclass(frozen=True)
class AheadError:
    """Position error some seconds after the last sample, predicted from the last true state.

    Players plan as far as in the game that was seen, or as far as is asked if that is more.

    Attributes:
        seconds: time ahead [s].
    """

    name: ClassVar[str] = "ahead_error"
    label: ClassVar[str] = "error ahead"
    unit: ClassVar[str] = "m"
    needs_prediction: ClassVar[bool] = True
    drawn: ClassVar[bool] = False
    negligible: ClassVar[float] = 1e-5
    seconds: float = 2.0

    def score(self, case: Judged) -> float | None:
        """Error [m] of all players at that time; None where no game is found there."""
        found = case.ahead(self.seconds)
        if found is None:
            return None
        truth, predicted = found
        return self.apart(truth[-1], predicted[-1])

    def apart(self, truth: np.ndarray, predicted: np.ndarray) -> float:
        """How far apart [m] states (N, n) of all players are."""
        return formulas.position_error(truth, predicted)
