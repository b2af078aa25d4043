"""Scenarios, the worlds that play them, and recordings of these worlds."""

import os

# Otherwise SDL turns SIGTERM into an event as soon as something is drawn. Nothing reads this event,
# so SIGTERM would not end the process.
os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # no greeting on import

from olne_bench.envs.worlds.gym_ids import register_ids

register_ids()
