"""Fast cars overtake slow ones in HighwayEnv at their Nash equilibrium; saves the episode.

Usage: python examples/highway_overtaking.py [FILE.gif]
"""

import sys

from PIL import Image

from envs import highway_v0

world = highway_v0.parallel_env("highway", render_mode="rgb_array")
observations, infos = world.reset(seed=0)
frames = [Image.fromarray(world.render())]
while world.agents:
    actions = {player: infos[player]["olne_action"] for player in world.agents}
    observations, rewards, terminations, truncations, infos = world.step(actions)
    frames.append(Image.fromarray(world.render()))
file = sys.argv[1] if len(sys.argv) > 1 else "highway.gif"
frames[0].save(file, save_all=True, append_images=frames[1:], duration=400, loop=0)
