"""Write what others can cite: solved draws as a table, and Croissant metadata of all tables.

    python scripts/dataset.py write
    python scripts/dataset.py check

``write`` makes ``results/dataset/draws.parquet``, the ground-truth motions of the suite ``roads``,
and ``results/dataset/croissant.json``, which describes them and the trials of each study with
SHA-256 of each file. ``check`` reads every record set through mlcroissant, and compares hashes.
Both need the extra ``dev``. docs/datasheet.md says the rest.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import shared
import mlcroissant as mlc
import pyarrow as pa
import pyarrow.parquet as pq

from olne_bench.bench.judge.truth import Draw, true_recording
from olne_bench.bench.plan.draws import draws_source, opened
from olne_bench.bench.plan.load import load_suite
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.solved.kept_draws import travelling

RESULTS = Path(__file__).parent.parent / "results"
HOME = RESULTS / "dataset"
SUITE = "roads"
KINDS = {
    **dict.fromkeys(("string", "large_string"), mlc.DataType.TEXT),
    "int64": mlc.DataType.INTEGER,
    "double": mlc.DataType.FLOAT,
    "float": mlc.DataType.FLOAT,
}
TEXT = (
    "Motions of several vehicles that play an open-loop Nash equilibrium on HighwayEnv's roads, "
    "with the cost weights of every player, and what estimators made of noisy, partial "
    "observations of them."
)


def write() -> None:
    """Make the table of draws, and the metadata."""
    HOME.mkdir(parents=True, exist_ok=True)
    table = pa.Table.from_pylist(list(_draws()))
    pq.write_table(table, HOME / "draws.parquet", compression="zstd")
    (HOME / "croissant.json").write_text(json.dumps(_metadata(), indent=1, default=str) + "\n")
    check()


def check() -> None:
    """Compare hashes, and read ten records of each record set."""
    file = HOME / "croissant.json"
    for one in json.loads(file.read_text())["distribution"]:
        found = hashlib.sha256((HOME / one["contentUrl"]).read_bytes()).hexdigest()
        if found != one["sha256"]:
            raise SystemExit(f"{one['contentUrl']} has changed: run dataset.py write")
    read = mlc.Dataset(jsonld=str(file))
    for record_set in read.metadata.record_sets:
        rows = [row for row, _ in zip(read.records(record_set.uuid), range(10), strict=False)]
        print(f"{record_set.uuid}: {len(record_set.fields)} columns, {len(rows)} rows read")


def _draws() -> Iterator[dict[str, Any]]:
    """A row of each motion of the suite; scenarios of unknown speeds have the same ones."""
    suite = load_suite(SUITE)
    known = [one for one in suite.scenarios if not one.options.get("unknown_speeds")]
    with travelling(opened(draws_source(SUITE, suite))):
        for entry in known:
            for seed in range(entry.seeds or suite.seeds):
                try:
                    recording = true_recording(Draw.of(entry, seed, suite.salt))
                except NoEquilibriumError:
                    continue
                game = recording.scenario.game
                yield {
                    "scenario": entry.label,
                    "seed": seed,
                    "players": game.num_players,
                    "samples": len(recording.states),
                    "dt": game.dt,
                    "state_names": json.dumps(game.dynamics.state_names),
                    "weight_names": json.dumps(game.weight_names),
                    "weights": json.dumps(recording.scenario.weights.round(12).tolist()),
                    "states": json.dumps(recording.states.round(4).tolist()),
                }


def _metadata() -> dict[str, Any]:
    tables = [HOME / "draws.parquet", *sorted(RESULTS.glob("*/trials.parquet"))]
    files, sets = [], []
    for path in tables:
        name = "draws" if path.parent == HOME else f"trials_{path.parent.name}"
        place = path.name if path.parent == HOME else f"../{path.parent.name}/{path.name}"
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        file = mlc.FileObject(
            id=f"{name}_file",
            name=f"{name}_file",
            content_url=place,
            encoding_formats=["application/x-parquet"],
            sha256=digest,
        )
        files.append(file)
        fields = [
            mlc.Field(
                id=f"{name}/{column.name}",
                name=f"{name}/{column.name}",
                data_types=KINDS[str(column.type)],
                source=mlc.Source(file_object=file.id, extract=mlc.Extract(column=column.name)),
            )
            for column in pq.read_schema(path)
            if str(column.type) in KINDS
        ]
        sets.append(mlc.RecordSet(id=name, name=name, fields=fields))
    whole = mlc.Metadata(
        name="olne-bench",
        description=TEXT,
        license="https://spdx.org/licenses/MIT",
        url="https://arxiv.org/abs/2106.03611",
        version="0.1.0",
        date_published="2026-11-26",
        cite_as=(RESULTS.parent / "CITATION.cff").read_text().splitlines()[1].partition(": ")[2],
        distribution=files,
        record_sets=sets,
    )
    found: dict[str, Any] = whole.to_json()
    return found


if __name__ == "__main__":
    shared.command(write, check)
