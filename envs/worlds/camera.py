"""Map positions in the world to pixels of a frame."""

from typing import Any

import numpy as np

MAX_WIDTH, MAX_HEIGHT = 900, 600  # [px] of a frame without its header
SHARPNESS = 2  # frames are drawn this many times larger and scaled down
HEADER = 64  # [px] for the legend
MARGIN = 0.12  # around all expected positions, as a share of the larger side


class View:
    """The part of the world that frames show.

    The y axis points up. A view that is taller than wide is turned: then x points down and y to
    the right, so that roads run from left to right.

    Args:
        expected: (S, 2) positions that the view should hold.

    Attributes:
        low, high: corners (2,) of the view [m].
        frame_size: width and height of a frame [px], which do not change.
    """

    def __init__(self, expected: np.ndarray) -> None:
        self.low, self.high = _box(expected)
        width, height = self.high - self.low
        self._turned = height > width
        shorter, longer = sorted((width, height))
        scale = min(MAX_WIDTH / longer, MAX_HEIGHT / shorter)
        self.frame_size = round(scale * longer), HEADER + round(scale * shorter)

    def widen(self, positions: np.ndarray) -> None:
        """Widen the view so that it holds positions (S, 2)."""
        inside = (positions >= self.low) & (positions <= self.high)
        if not inside.all():
            self.low, self.high = _box(np.vstack([positions, [self.low, self.high]]), 0.02)

    @property
    def scale(self) -> float:
        """Canvas pixels per metre."""
        extent = (self.high - self.low)[::-1] if self._turned else self.high - self.low
        available = np.array(self.frame_size) - (0, HEADER)
        return float(SHARPNESS * (available / extent).min())

    def pixels(self, positions: Any) -> list[Any]:
        """World positions (..., 2) as canvas pixels, in lists for pygame."""
        relative = np.asarray(positions) - (self.low + self.high) / 2
        axes = relative[..., ::-1] if self._turned else relative * (1, -1)
        width, height = self.frame_size
        centre = np.array([width / 2, (HEADER + height) / 2]) * SHARPNESS
        return (centre + axes * self.scale).tolist()


def _box(positions: np.ndarray, margin: float = MARGIN) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box around positions (S, 2) with an aspect ratio of at most 4 to 1."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = max(float((high - low).max()), 1e-3) * (1 + 2 * margin)
    half = np.maximum((high - low) / 2 + margin * size, size / 8)
    middle = (low + high) / 2
    return middle - half, middle + half
