#!/usr/bin/env bash
# The wheel alone, in a fresh virtual environment and a folder that has an envs/, a bench/ and a games/
# of its own: commands, worlds and HighwayEnv's plug-in work, and one package is installed.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

"${PYTHON:-python3}" -m venv venv
pip() { PIP_CONSTRAINT="$repository/constraints.txt" venv/bin/python -m pip --quiet --disable-pip-version-check "$@"; }
pip wheel --no-deps --wheel-dir wheels "$repository"
pip install wheels/*.whl

mkdir -p work/{bench,envs,estimators,games}
for name in bench envs estimators games; do
    echo "raise ImportError('the user\'s own $name')" > "work/$name/__init__.py"
done
cd work
export OMP_NUM_THREADS=1

../venv/bin/olne-bench run quick --seeds 1 --no-figures --out runs/quick 2>/dev/null | grep "^runs/quick: index.html"
../venv/bin/python -m olne_bench list | grep "two_player"

cat > script.py <<'END'
import gymnasium
import highway_env  # registers its environments

from olne_bench.envs import highway_v0

world = highway_v0.parallel_env("highway")
_, infos = world.reset(seed=0)
while world.agents:
    actions = {player: infos[player]["olne_action"] for player in world.agents}
    *_, infos = world.step(actions)
print("highway_v0 was played to its end")

traffic = {"other_vehicles_type": "olne_bench.envs.traffic.NashVehicle", "vehicles_count": 3}
stock = gymnasium.make("highway-v0", config=traffic)
stock.reset(seed=0)
for _ in range(3):
    stock.step(1)
drivers = {type(v).__name__ for v in stock.unwrapped.road.vehicles[1:]}
assert drivers == {"NashVehicle"}, drivers
print("NashVehicle drives the traffic of highway-v0")
END
../venv/bin/python script.py

../venv/bin/python - <<'END'
from importlib.metadata import files

installed = {path.parts[0] for path in files("olne-bench") if path.parts[0] != ".."}
packages = sorted(name for name in installed if not name.endswith(".dist-info"))
assert packages == ["olne_bench"], packages
print("site-packages gained one package:", *packages)
END
