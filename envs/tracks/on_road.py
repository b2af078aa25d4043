"""Check that cars are on a road and drive along its lanes."""

from collections.abc import Sequence

import numpy as np

from olne_bench.envs.tracks.motion import Motion
from olne_bench.envs.tracks.road import Road, RoadLane, locate
from olne_bench.errors import UserError, bad_input
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import LaneKeeping

MARGIN = 1.0  # [m], largest distance beside a lane
TOLERATED = 0.2  # share of a car's samples that may be off the road, or against the lanes
_FAR = 1e4  # [m]
_HINT = (
    "'olne-bench import' changes the frame by --shift, --flip-y and --rotate, selects players by "
    "--players, and takes other lanes by --road"
)


def check_on_road(
    road: Road, names: Sequence[str], motions: Sequence[Motion], noise: float
) -> None:
    """Refuse players that are off the road, or drive against its lanes.

    Raises:
        UserError: with a message that names the player, its position, and what can be done.
    """
    for name, motion in zip(names, motions, strict=True):
        positions, headings = motion.positions[motion.seen], motion.headings[motion.seen]
        places = [locate(lane.line, positions) for lane in road.lanes.values()]
        distance = np.stack([place.distance for place in places])
        widths = np.array([lane.width for lane in road.lanes.values()])
        on_lane = distance < (widths / 2 + MARGIN + 2 * noise)[:, None]
        off_road = ~on_lane.any(axis=0)
        if off_road.mean() > TOLERATED:
            k = int(distance.min(axis=0).argmax())
            x, y = positions[k]
            raise UserError(
                f"player {name!r} is off the road: at ({x:.1f}, {y:.1f}) the nearest lane is "
                f"{distance.min(axis=0)[k]:.1f} m away, and it is off the road in "
                f"{off_road.mean():.0%} of its samples; {_HINT}"
            )
        ahead = np.cos(np.stack([place.heading for place in places]) - headings)
        against = np.where(on_lane, ahead, -np.inf).max(axis=0) < 0
        told = np.isfinite(headings) & ~off_road
        if told.any() and against[told].mean() > TOLERATED:
            k = int(np.flatnonzero(against & told)[0])
            x, y = positions[k]
            raise UserError(
                f"player {name!r} drives against the lanes: at ({x:.1f}, {y:.1f}) it heads "
                f"{np.rad2deg(headings[k]):.0f} degrees, and so in {against[told].mean():.0%} of "
                f"its samples; {_HINT}"
            )


def lane_warnings(
    names: Sequence[str], motions: Sequence[Motion], players: Sequence[Player], noise: float
) -> list[str]:
    """Warnings on players that end beside the lanes they are assumed to keep."""
    warnings = []
    for name, motion, player in zip(names, motions, players, strict=True):
        last = motion.positions[motion.seen][-1:]
        for term in player.task:
            if not isinstance(term, LaneKeeping):
                continue
            with bad_input(f"the lanes of player {name!r}"):
                lane = RoadLane(term.route)
            beside = float(locate(_extended(lane.line), last).distance[0])
            if beside > lane.width / 2 + MARGIN + 2 * noise:
                warnings.append(
                    f"player {name!r} ends {beside:.1f} m beside the lanes it is assumed to keep"
                )
    return warnings


def _extended(line: np.ndarray) -> np.ndarray:
    """A line of points (P, 2), extended straight: the last lane of a route has no end."""
    onward = line[-1] - line[-2]
    return np.vstack([line, line[-1] + _FAR * onward / np.linalg.norm(onward)])
