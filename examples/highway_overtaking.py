"""Fast cars overtake slow ones in HighwayEnv at their Nash equilibrium; saves highway.gif."""

from PIL import Image

from olne_bench.envs import highway_v0

world = highway_v0.parallel_env("highway", render_mode="rgb_array")
observations, infos = world.reset(seed=0)
frames = [Image.fromarray(world.render())]
while world.agents:
    actions = {player: infos[player]["olne_action"] for player in world.agents}
    observations, rewards, terminations, truncations, infos = world.step(actions)
    frames.append(Image.fromarray(world.render()))
frames[0].save("highway.gif", save_all=True, append_images=frames[1:], duration=400, loop=0)
