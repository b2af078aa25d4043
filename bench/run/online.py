"""Runs the trials of a suite as motions that go on, one after the other in one player process."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from olne_bench.bench.judge.online import (
    ERROR_COLUMNS,
    REFERENCES,
    OnlineRules,
    Update,
    judge_online,
    reference_updates,
)
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial
from olne_bench.bench.process.child import StartError
from olne_bench.bench.run.stream_process import StreamProcess
from olne_bench.bench.text import clip, describe_error
from olne_bench.envs.recording import NoEquilibriumError

Row = dict[str, Any]

#: Columns of a row: what identifies the motion and the estimator, the update, and its errors.
COLUMNS = (
    *KEY_COLUMNS,
    *(field.name for field in fields(Update) if field.name != "errors"),
    *ERROR_COLUMNS,
)


def run_online(
    trials: Iterable[Trial], rules: OnlineRules, *, memory: int | None, hidden: Path | None
) -> Iterator[list[Row]]:
    """The rows of each motion: of an estimator, or of what it is compared with.

    A draw without an equilibrium has one row, which is ``skipped``; one that cannot be judged has a
    ``harness_error``.

    Args:
        trials: motions and estimators; what they are compared with is added once for each motion.
        rules: rules of the study.
        memory: memory limit [bytes] of the player process, None for no limit.
        hidden: folder that foreign code cannot read.

    Raises:
        StartError: if processes do not start.
    """
    player = StreamProcess(memory=memory, hidden=hidden)
    known: set[tuple[Any, ...]] = set()
    try:
        for trial in trials:
            labels = {name: trial.labels[name] for name in KEY_COLUMNS}
            motion = tuple(labels[n] for n in KEY_COLUMNS if n not in ("estimator", "parameters"))
            if motion not in known:
                known.add(motion)
                for name in REFERENCES:
                    own = labels | {"estimator": name, "parameters": "{}"}
                    yield _rows(own, reference_updates(trial, name))
            yield _rows(labels, judge_online(trial, player, rules))
    finally:
        player.stop()


def _rows(labels: Row, updates: Iterator[Update]) -> list[Row]:
    rows: list[Row] = []
    try:
        for update in updates:
            row = asdict(update)
            rows.append(labels | {k: v for k, v in row.items() if k != "errors"} | row["errors"])
    except NoEquilibriumError as error:
        return [labels | {"sample": 0, "status": "skipped", "message": clip(str(error))}]
    except StartError:
        raise
    except Exception as error:  # a fault of ours must not end the study
        fault = {"sample": len(rows) + 1, "status": "harness_error"}
        rows.append(labels | fault | {"message": describe_error(error)})
    return rows
