"""What a drive is about: its road, its traffic and hidden weights, and how it begins."""

from dataclasses import dataclass

from olne_bench.envs.drive.cars import ROADS, STEP, WEIGHTS
from olne_bench.envs.scenarios.true_weights import TEMPERED

#: Traffic: players of the family's game, and HighwayEnv's own drivers (IDM and MOBIL).
NASH, STOCK = "nash", "stock"
TRAFFIC = (NASH, STOCK)
#: A drive through traffic, in which cars come and go, and an encounter with two others.
THROUGH, ENCOUNTER = "traffic", "encounter"
SCENES = (THROUGH, ENCOUNTER)
#: What players take the ego for: itself, with its costs; an average driver; or what its way so far
#: says that it is.
KNOWN, AVERAGE, LEARNT = "known", "average", "learnt"
EGOS = (KNOWN, AVERAGE, LEARNT)

_SECONDS = {THROUGH: 20.0, ENCOUNTER: 8.0}
#: What a setting has besides its road, and its values.
OPTIONS = {"traffic": TRAFFIC, "weights": WEIGHTS, "scene": SCENES, "ego": EGOS}


@dataclass(frozen=True)
class DriveSetting:
    """What drives have in common, besides their seed; ValueError on an unknown name."""

    road: str  # one of ``ROADS``
    traffic: str = NASH  # one of ``TRAFFIC``
    weights: str = TEMPERED  # hidden ones: one of ``WEIGHTS``
    scene: str = THROUGH  # one of ``SCENES``
    ego: str = KNOWN  # what players take it for: one of ``EGOS``

    def __post_init__(self) -> None:
        for name, known in ({"road": tuple(ROADS)} | OPTIONS).items():
            given = getattr(self, name)
            if given not in known:
                raise ValueError(f"unknown {name} {given!r}; known are: {', '.join(known)}")
        if self.scene == ENCOUNTER and self.ego == KNOWN:
            raise ValueError(
                f"scene = {ENCOUNTER!r} needs ego = {AVERAGE!r} or {LEARNT!r}: its value of "
                "information is that of the ego among others that do not know it"
            )
        if self.traffic == STOCK and (self.scene, self.ego) != (THROUGH, KNOWN):
            raise ValueError(
                f"encounters and what others take the ego for need traffic = {NASH!r}: "
                "HighwayEnv's own drivers plan nothing"
            )

    @property
    def steps(self) -> int:
        """Number of steps of a drive."""
        return round(_SECONDS[self.scene] / STEP)
