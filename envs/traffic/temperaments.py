"""Cost weights of the drivers of Nash vehicles, and presets."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Temperament:
    """A driver's cost weights, in the units of ``games.solve.reference_game.Units``.

    Attributes:
        proximity: weight of proximity to others.
        speed: weight of deviations from the target speed.
        acceleration: weight of longitudinal comfort.
        turning: weight of lateral comfort.
        lane: weight of deviations from the centre of the target lane.
        haste: factor on the target speed.
    """

    proximity: float = 2.5
    speed: float = 1.0
    acceleration: float = 0.5
    turning: float = 0.5
    lane: float = 1.0
    haste: float = 1.0

    @property
    def weights(self) -> np.ndarray:
        """Weights (5,) in the order of ``games.solve.reference_game.WEIGHT_NAMES``."""
        return np.array([self.proximity, self.speed, self.acceleration, self.turning, self.lane])


#: Presets by name.
TEMPERAMENTS: dict[str, Temperament] = {
    "aggressive": Temperament(proximity=1.0, speed=2.0, acceleration=0.2, turning=0.3, haste=1.1),
    "normal": Temperament(),
    "cautious": Temperament(proximity=4.0, speed=0.7, acceleration=0.7, turning=0.8, haste=0.9),
}


def temperament(preset: str | Temperament) -> Temperament:
    """A preset by its name; a ``Temperament`` is returned unchanged.

    Raises:
        ValueError: on an unknown name.
    """
    if isinstance(preset, Temperament):
        return preset
    if preset not in TEMPERAMENTS:
        raise ValueError(f"unknown temperament {preset!r}; known are: {', '.join(TEMPERAMENTS)}")
    return TEMPERAMENTS[preset]
