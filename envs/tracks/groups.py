"""Which cars of a recording interact, and why."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.envs.tracks.grid import Grid, Motion
from olne_bench.envs.tracks.leaders import Scene, Standing, motions_of, standing_cars
from olne_bench.envs.tracks.road import Road

FOLLOWS, CUTS_IN, CROSSES = "follows", "changes into the lane of", "crosses the way of"
#: Every so many seconds leaders are looked for.
_EVERY = 1.0
#: Ways cross where they come closer than this [m] at an angle whose cosine is smaller than that,
#: and the cars are there within so many seconds.
_CLOSE, _ACROSS, _TOGETHER = 3.0, 0.85, 4.0
#: Time gap [s] in which a car follows closely.
_GAP = 1.5


@dataclass(frozen=True)
class Interaction:
    """Something between two cars."""

    who: str
    what: str  # ``FOLLOWS``, ``CUTS_IN`` or ``CROSSES``
    whom: str
    since: float  # [s]
    strength: float  # 1 where it clearly counts, 0 where it hardly does


@dataclass(frozen=True)
class Group:
    """Cars that interact."""

    players: tuple[str, ...]
    interactions: tuple[Interaction, ...]  # the strongest first
    window: tuple[float, float]  # times [s] at which all are seen

    @property
    def strength(self) -> float:
        """Sum of the strengths of its interactions."""
        return sum(one.strength for one in self.interactions)


def groups_in(grid: Grid, road: Road | None, most: int) -> list[Group]:
    """Groups of up to ``most`` cars that are seen together, the strongest first.

    Pairs that interact are joined, the strongest first, while they fit and are all seen at the same
    times. A car may be in several groups. Without a road only crossing ways are found.
    """
    motions = motions_of(grid)
    found = [*_crossing(grid, motions)]
    if road is not None:
        found += _in_lanes(grid, motions, road)
    found.sort(key=lambda one: -one.strength)
    groups: list[Group] = []
    for seed in found:
        known = any({seed.who, seed.whom} <= set(group.players) for group in groups)
        group = None if known else _grown(grid, seed, found, most)
        if group is not None:
            groups.append(group)
    return sorted(groups, key=lambda group: -group.strength)


def _grown(grid: Grid, seed: Interaction, found: Sequence[Interaction], most: int) -> Group | None:
    players, window = [seed.who, seed.whom], _together(grid, [seed.who, seed.whom])
    if window is None:
        return None
    for other in found:
        pair = {other.who, other.whom}
        more = [name for name in (other.who, other.whom) if name not in players]
        if len(more) == 1 and len(pair & set(players)) == 1 and len(players) < most:
            longer = _together(grid, players + more)
            if longer is not None:
                players, window = players + more, longer
    inside = [one for one in found if one.who in players and one.whom in players]
    return Group(tuple(players), tuple(inside), window)


def _together(grid: Grid, players: Sequence[str]) -> tuple[float, float] | None:
    """First and last time at which all are seen, at least two seconds apart."""
    columns = [grid.players.index(name) for name in players]
    seen = np.isfinite(grid.states[:, columns, :2]).all(axis=(1, 2))
    times = grid.times[seen]
    if not times.size or times[-1] - times[0] < 2.0:
        return None
    return float(times[0]), float(times[-1])


def _in_lanes(grid: Grid, motions: Sequence[Motion], road: Road) -> list[Interaction]:
    """Who follows whom, and who has come in between."""
    before: dict[str, str | None] = {}
    strongest: dict[tuple[str, str, str], Interaction] = {}
    lanes: dict[str, str | None] = {}
    for at in range(0, len(grid.times), max(1, round(_EVERY / grid.step))):
        scene = Scene(road, standing_cars(grid.players, motions, at))
        for name in scene.cars:
            leader, earlier = scene.leader(name), before.get(name)
            before[name] = leader
            if leader is None:
                continue
            moved = lanes.get(leader) not in (None, scene.lane(name))
            cut = moved and earlier is not None and earlier != leader
            one = _pair(scene.cars, name, leader, float(grid.times[at]), cut=cut)
            key = one.who, one.what, one.whom
            if key not in strongest or strongest[key].strength < one.strength:
                strongest[key] = one
        lanes = {name: scene.lane(name) for name in scene.cars}
    return [*strongest.values()]


def _pair(
    cars: Mapping[str, Standing], follower: str, leader: str, time: float, *, cut: bool
) -> Interaction:
    """What a follower and its leader are to each other."""
    if cut:
        return Interaction(leader, CUTS_IN, follower, time, 1.0)
    gap = float(np.linalg.norm(cars[leader].position - cars[follower].position))
    closing = abs(cars[follower].speed - cars[leader].speed)
    close = _GAP * max(cars[follower].speed, 1.0) / max(gap, 1.0)
    return Interaction(follower, FOLLOWS, leader, time, min(1.0, closing / 4 + min(close, 1) / 2))


def _crossing(grid: Grid, motions: Sequence[Motion]) -> Iterator[Interaction]:
    """Pairs whose ways cross, and who are there soon after each other."""
    for i, first in enumerate(motions):
        for j in range(i + 1, len(motions)):
            second = motions[j]
            apart = np.linalg.norm(first.positions[:, None] - second.positions[None], axis=-1)
            turned = np.cos(first.headings[:, None] - second.headings[None])
            late = np.abs(grid.times[:, None] - grid.times[None])
            meets = (apart < _CLOSE) & (turned < _ACROSS) & (late < _TOGETHER)
            if meets.any():
                k, m = np.unravel_index(np.where(meets, late, np.inf).argmin(), late.shape)
                who, whom = (i, j) if k > m else (j, i)
                strength = 1 - float(late[k, m]) / _TOGETHER
                time = float(grid.times[min(k, m)])
                yield Interaction(grid.players[who], CROSSES, grid.players[whom], time, strength)
