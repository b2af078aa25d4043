"""Write the suite ``misspecified``: every change at three dials, on roads and of two players.

python scripts/misspecified.py > bench/plan/suites/misspecified.toml
"""

from collections.abc import Mapping

import shared

TRUE = "as told"
#: Dials of changes that any scenario has, and of those that need lanes and metres.
ANYWHERE = {
    "feedback": (0.25, 0.5, 1.0), "responding": (0.25, 0.5, 1.0), "leading": (0.25, 0.5, 1.0),
    "alone": (0.1, 0.3, 1.0), "hidden_cost": (1.0, 3.0, 6.0), "noise_level": (-1.0, 1.0, 2.0),
    "student_noise": (0.2, 0.333, 0.4), "outliers": (0.01, 0.05, 0.1),
    "lagged_noise": (0.3, 0.6, 0.8), "bias": (0.3, 1.0, 2.0), "clock_offset": (0.1, 0.25, 0.5),
}  # fmt: skip
ON_ROADS = ANYWHERE | {
    "replanning": (2.0, 1.0, 0.4), "entropic": (0.001, 0.01, 0.1), "stock": (0.5, 1.0, 1.5),
    "target_speed": (1.0, 3.0, 5.0), "lane_offset": (0.2, 0.5, 1.0),
    "vehicle_length": (0.1, 0.3, 1.0), "wheelbase": (0.05, 0.2, 0.5),
    "unseen_cars": (1.0, 2.0, 3.0),
}  # fmt: skip
#: Three cars and one more are as many as these roads hold.
IN_TOWN = ON_ROADS | {"unseen_cars": (1.0,)}
CROSSING = ANYWHERE | {
    "replanning": (2.0, 1.0, 0.5), "entropic": (0.0001, 0.001, 0.01),
    "target_speed": (0.05, 0.1, 0.2), "goal": (0.05, 0.1, 0.2),
}  # fmt: skip
THREE_DRIVERS = 'num_players = 3, weights = "temperaments"'
HEAD = """# Written by scripts/misspecified.py.
name = "misspecified"
description = "Worlds that are not what estimators are told: twenty changes at up to three dials"
sensors = ["full"]
sigmas = [0.2]
# Some draws cannot be played; at least 40 are left.
seeds = 55
time_limit = 120.0
# As in roads.toml.
root_iterations = 0
estimators = [
    "kkt_constrained", "map", "ridge", "kkt_residual", "ukf", "particle", "posterior", "robust",
    "imperfect", "uniform",
]
metrics = [
    { name = "ahead_error", label = "ahead_1s", parameters = { seconds = 1.0 } },
    { name = "ahead_error", label = "ahead_2s", parameters = { seconds = 2.0 } },
    { name = "ahead_error", label = "ahead_3s", parameters = { seconds = 3.0 } },
    { name = "farthest_ahead", label = "farthest_1s", parameters = { seconds = 1.0 } },
    { name = "farthest_ahead", label = "farthest_2s", parameters = { seconds = 2.0 } },
    { name = "farthest_ahead", label = "farthest_3s", parameters = { seconds = 3.0 } },
]
scenarios = ["""


def suite() -> None:
    """Print the suite's file."""
    print(HEAD)
    _print("highway", THREE_DRIVERS, ON_ROADS)
    _print("intersection", THREE_DRIVERS, IN_TOWN)
    _print("roundabout", THREE_DRIVERS, IN_TOWN)
    _print("two_player", 'weights = "dirichlet"', CROSSING, ", sigmas = [0.02]")
    print("]")


def _print(
    name: str, options: str, changes: Mapping[str, tuple[float, ...]], more: str = ""
) -> None:
    cases = [(TRUE, "alone", 0.0)]
    cases += [(f"{change} {d:g}", change, d) for change, dials in changes.items() for d in dials]
    for label, change, dial in cases:
        of = f'of = "{name}", change = "{change}", dial = {dial}, options = {{ {options} }}'
        named = f'name = "changed", label = "{name}, {label}"'
        print(f"    {{ {named}{more}, options = {{ {of} }} }},")


if __name__ == "__main__":
    shared.command(suite)
