"""Where traffic comes from: scenarios, the worlds that play them, and their recordings."""

import os

# SDL would otherwise take over SIGTERM as soon as something is drawn, and nobody reads the event
# that it makes of the signal: the process could only be killed.
os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it greets on import otherwise

from olne_bench.envs.gym_ids import register_ids

register_ids()
