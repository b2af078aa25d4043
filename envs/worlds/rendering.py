"""Frames of a world: vehicles from above, with their trails."""

from typing import Any

import numpy as np
import pygame

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.worlds.scene import goals, heading_of, lanes, player_colour
from olne_bench.envs.worlds.window import Window

MAX_WIDTH, MAX_HEIGHT = 900, 600  # [px] of a frame without its header
SHARPNESS = 2  # frames are drawn this many times larger and scaled down
HEADER = 64  # [px] for the legend
MARGIN = 0.12  # around all expected positions, as a share of the larger side
CAR_LENGTH = 0.045  # as a share of the larger side of the first view
MIN_CAR_LENGTH = 16  # [px], however much the view is widened
CAR_ASPECT = 0.48  # width over length
BACKGROUND = (247, 247, 244)
ROAD = (222, 223, 226)
LANE_MARK = (255, 255, 255)
INK = (60, 62, 68)


class Camera:
    """The part of the world that frames show, which holds all expected positions (S, 2).

    The y axis points up. A view that is taller than wide is turned: then x points down and y to the
    right, so that roads run from left to right.
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
        return list((centre + axes * self.scale).tolist())


def _box(positions: np.ndarray, margin: float = MARGIN) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box around positions (S, 2) with an aspect ratio of at most 4 to 1."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    size = max(float((high - low).max()), 1e-3) * (1 + 2 * margin)
    half = np.maximum((high - low) / 2 + margin * size, size / 8)
    middle = (low + high) / 2
    return middle - half, middle + half


class Renderer:
    """Draws the states of one episode, with goals and lanes of the players' tasks.

    The view holds all expected states (S, N, n), and widens if a player leaves it (``Camera``).
    Without frame rate, it draws into arrays.
    """

    def __init__(self, scenario: Scenario, expected: np.ndarray, fps: int | None) -> None:
        pygame.font.init()
        self._names = scenario.game.dynamics.state_names
        self._title = scenario.name
        self._players = scenario.game.num_players
        self._goals = goals(scenario)
        self._lanes = lanes(scenario)
        self._window = None if fps is None else Window(scenario.name, fps)
        landmarks = [expected[..., :2].reshape(-1, 2), *[g[None] for g in self._goals.values()]]
        self._view = Camera(np.concatenate(landmarks))
        self._first_car_length = CAR_LENGTH * float((self._view.high - self._view.low).max())

    def draw(self, history: list[np.ndarray], time: float) -> np.ndarray | None:
        """Draw states (N, n), the latest last: (height, width, 3) uint8, None if into a window."""
        positions = np.stack(history)[..., :2]
        self._view.widen(positions.reshape(-1, 2))
        width, height = self._view.frame_size
        canvas = pygame.Surface((width * SHARPNESS, height * SHARPNESS))
        canvas.fill(BACKGROUND)
        self._draw_road(canvas)
        self._draw_goals(canvas)
        for player in range(self._players):
            self._draw_trail(canvas, player, positions[:, player])
        for player, state in enumerate(history[-1]):
            self._draw_car(canvas, player, state)
        self._draw_header(canvas, time)
        scaled = pygame.transform.smoothscale(canvas, (width, height))
        frame = np.ascontiguousarray(pygame.surfarray.array3d(scaled).swapaxes(0, 1))
        if self._window is None:
            return frame
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()

    @property
    def _car_length(self) -> float:
        """Length of the drawn cars [m]; in games, cars are points."""
        return max(self._first_car_length, MIN_CAR_LENGTH * SHARPNESS / self._view.scale)

    # -- what is drawn -----------------------------------------------------------------------

    def _draw_road(self, canvas: pygame.Surface) -> None:
        if not self._lanes:
            return
        width = min(np.diff(self._lanes), default=2 * self._car_length)
        edges = [self._lanes[0] - width / 2, *(np.array(self._lanes) + width / 2)]
        reach = 2 * (self._view.high - self._view.low).max()  # beyond the frame on both sides
        start, end = self._view.low[1] - reach, self._view.high[1] + reach
        corners = [(edges[0], start), (edges[0], end), (edges[-1], end), (edges[-1], start)]
        pygame.draw.polygon(canvas, ROAD, self._view.pixels(corners))
        dash = self._car_length
        for edge in edges[1:-1]:
            for mark in np.arange(start, end, 2 * dash):
                first, last = self._view.pixels([(edge, mark), (edge, mark + dash)])
                pygame.draw.line(canvas, LANE_MARK, first, last, width=2 * SHARPNESS)

    def _draw_goals(self, canvas: pygame.Surface) -> None:
        for player, goal in self._goals.items():
            centre = self._view.pixels(goal)
            pygame.draw.circle(canvas, _colour(player), centre, 9 * SHARPNESS, 2 * SHARPNESS)
            pygame.draw.circle(canvas, _colour(player), centre, 3 * SHARPNESS)

    def _draw_trail(self, canvas: pygame.Surface, player: int, positions: np.ndarray) -> None:
        points = self._view.pixels(positions)
        for age, (start, end) in enumerate(zip(points[-2::-1], points[:0:-1], strict=False)):
            colour = _mix(_colour(player), BACKGROUND, max(0.25, 0.9 * 0.93**age))
            pygame.draw.line(canvas, colour, start, end, width=3 * SHARPNESS)
            pygame.draw.circle(canvas, colour, start, 2.5 * SHARPNESS)

    def _draw_car(self, canvas: pygame.Surface, player: int, state: np.ndarray) -> None:
        heading = heading_of(state, self._names)
        length = self._car_length
        forward = length * np.array([np.cos(heading), np.sin(heading)])
        left = CAR_ASPECT * length * np.array([-np.sin(heading), np.cos(heading)])

        def outline(back: float, front: float, width: float) -> list[Any]:
            corners = ((back, -width), (front, -width), (front, width), (back, width))
            return self._view.pixels([state[:2] + x * forward + y * left for x, y in corners])

        colour = _colour(player)
        pygame.draw.polygon(canvas, colour, outline(-0.5, 0.5, 0.5))
        pygame.draw.polygon(canvas, _mix(colour, (255, 255, 255), 0.35), outline(0.1, 0.3, 0.4))
        dark = _mix(colour, (0, 0, 0), 0.6)
        pygame.draw.polygon(canvas, dark, outline(-0.5, 0.5, 0.5), width=SHARPNESS)

    def _draw_header(self, canvas: pygame.Surface, time: float) -> None:
        canvas.fill(BACKGROUND, (0, 0, canvas.get_width(), HEADER * SHARPNESS))
        font = pygame.font.Font(None, 24 * SHARPNESS)
        title = font.render(f"{self._title}   t = {time:.2f} s", True, INK)
        canvas.blit(title, (16 * SHARPNESS, 10 * SHARPNESS))
        x = 16 * SHARPNESS
        for player in range(self._players):
            text = font.render(f"player_{player}", True, _colour(player))
            canvas.blit(text, (x, 36 * SHARPNESS))
            x += text.get_width() + 18 * SHARPNESS


def _colour(player: int) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(player_colour(player)[1:])
    return red, green, blue


def _mix(
    colour: tuple[int, int, int], other: tuple[int, int, int], share: float
) -> tuple[int, int, int]:
    """A mixture of a colour, with the given share, and another one."""
    red, green, blue = (
        round(share * a + (1 - share) * b) for a, b in zip(colour, other, strict=True)
    )
    return red, green, blue
