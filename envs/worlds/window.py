"""Show frames in a window."""

from typing import ClassVar

import numpy as np
import pygame


class Window:
    """Shows the frames of one world, at most so many a second.

    pygame has one window per process. It shows the world that drew last, and ``close`` closes it
    only while it shows the caller's world. A copy of a world opens it again when it draws. macOS
    opens windows in the main thread only.
    """

    _shown: ClassVar["Window | None"] = None
    _clock: ClassVar[pygame.time.Clock] = pygame.time.Clock()

    def __init__(self, title: str, fps: int | None = None) -> None:
        self._title = title
        self._fps = fps

    def show(self, frame: np.ndarray) -> list[pygame.event.Event]:
        """Show a frame (height, width, 3) uint8; events in the window since the last frame."""
        size = (frame.shape[1], frame.shape[0])
        surface = pygame.display.get_surface()
        if Window._shown is not self or surface is None or surface.get_size() != size:
            pygame.display.init()
            surface = pygame.display.set_mode(size)
            pygame.display.set_caption(self._title)
            Window._shown = self
        events = pygame.event.get()  # a window stops responding if its events are not taken
        pygame.surfarray.blit_array(surface, frame.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self._fps or 0)
        return events

    def close(self) -> None:
        """Close the window if it shows this world."""
        if Window._shown is self:
            pygame.display.quit()
            Window._shown = None
