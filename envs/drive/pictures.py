"""Pictures of a drive as HighwayEnv draws it, with what the ego expects drawn ahead of the cars."""

import numpy as np
from PIL import Image, ImageDraw

from olne_bench.envs.drive.planner import EgoPlan
from olne_bench.envs.drive.world import DriveWorld

#: Colours of the ego's plan and of predictions, and of the cars.
PLAN, PREDICTION = (0, 90, 200), (200, 30, 30)
_EGO, _OTHERS = (50, 140, 255), (255, 170, 60)
_EVERY = 2  # steps between dots
_RADIUS = 3  # of a dot [pixels]


def picture(world: DriveWorld, plan: EgoPlan | None) -> np.ndarray:
    """One frame (height, width, 3) uint8 of a drive; only its cars where there is no plan."""
    for place, vehicle in enumerate(world.road.road.vehicles):
        vehicle.color = _OTHERS if place else _EGO
    frame = world.road.render()
    assert frame is not None and world.road.viewer is not None
    if plan is None:
        return frame
    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    surface = world.road.viewer.sim_surface
    for place in range(len(plan.numbers) - 1, -1, -1):  # the ego's plan on top
        for state in plan.states[_EVERY::_EVERY, place]:
            x, y = surface.vec2pix(state[:2])
            box = (x - _RADIUS, y - _RADIUS, x + _RADIUS, y + _RADIUS)
            draw.ellipse(box, fill=PREDICTION if place else PLAN)
    return np.asarray(image)
