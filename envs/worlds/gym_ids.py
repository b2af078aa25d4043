"""Register the Gymnasium environments without importing them."""

from gymnasium.envs.registration import register, registry

#: Ids and their classes in ``envs.traffic.nash_gym``.
GYM_IDS = {
    "olne/NashHighway-v0": "NashHighwayEnv",
    "olne/NashMerge-v0": "NashMergeEnv",
    "olne/NashRoundabout-v0": "NashRoundaboutEnv",
    "olne/NashIntersection-v0": "NashIntersectionEnv",
    "olne/NashTwoWay-v0": "NashTwoWayEnv",
}

#: A drive of 20 s, on a road of its own or that is named.
DRIVE = "olne/Drive-v0"

#: Limits of steps per episode for environments that HighwayEnv does not limit itself.
_MAX_STEPS = {"olne/NashTwoWay-v0": 15}


def register_ids() -> None:
    """Register the ids with Gymnasium; ids that are registered already are skipped."""
    for name, class_name in GYM_IDS.items():
        if name not in registry:
            register(
                id=name,
                entry_point=f"olne_bench.envs.traffic.nash_gym:{class_name}",
                max_episode_steps=_MAX_STEPS.get(name),
            )
    if DRIVE not in registry:
        register(id=DRIVE, entry_point="olne_bench.envs.drive.ego_env:EgoEnv")
