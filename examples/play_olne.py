"""Play the paper's highway at its Nash equilibrium and save the episode as a GIF."""

from PIL import Image

from olne_bench.envs import olne_v0

world = olne_v0.parallel_env("highway_overtaking", render_mode="rgb_array")
observations, infos = world.reset(seed=0)
frames = [Image.fromarray(world.render())]
while world.agents:
    actions = {player: infos[player]["olne_action"] for player in world.agents}
    observations, rewards, terminations, truncations, infos = world.step(actions)
    frames.append(Image.fromarray(world.render()))
frames[0].save("olne.gif", save_all=True, append_images=frames[1:], duration=200, loop=0)
