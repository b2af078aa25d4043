"""Confirmations of implausible rows by fresh draws, as a run folder keeps them.

They say what ``olne-bench confirm`` found with one version of the code; those of other versions do
not count. Whoever writes to a run folder can write them, so ``submit`` and ``verify`` do not read
them.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec

from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.run.store import Store
from olne_bench.errors import UserError
from olne_bench.files import whole_file

FILE_NAME = "confirmations.json"


@dataclass(frozen=True)
class Confirmation:
    """What fresh draws say of an estimator's implausible rows in one scenario and sensor.

    Attributes:
        scenario: label of the scenario.
        sensor: label of the sensor.
        estimator: label of the estimator.
        parameters: its parameters, as rows have them.
        versions: versions of the code of both rows and fresh trials.
        sigmas: noise levels that have implausible rows.
        rows: number of these rows.
        trials: number of fresh attempts.
        metric: the error that fewer fresh attempts confirm, ``position_error`` or ``cosine_error``.
        error: its median over the rows.
        fresh_error: its median over the fresh attempts; None for infinity.
        as_small: number of fresh attempts whose error is at most the median of the rows with their
            noise level.
        confirmed: whether these are enough.
    """

    scenario: str
    sensor: str
    estimator: str
    parameters: str
    versions: Versions
    sigmas: tuple[float, ...]
    rows: int
    trials: int
    metric: str
    error: float
    fresh_error: float | None
    as_small: int
    confirmed: bool

    @property
    def place(self) -> tuple[str, str, str]:
        """Scenario, sensor and estimator."""
        return self.scenario, self.sensor, self.estimator

    @property
    def text(self) -> str:
        """The outcome in a few words."""
        fresh = "∞" if self.fresh_error is None else f"{self.fresh_error:.2g}"
        said = "confirmed" if self.confirmed else "not confirmed"
        name, unit = ("", " m") if self.metric == "position_error" else ("cosine error ", "")
        return f"{said}: {name}{fresh}{unit} on fresh draws, {self.error:.2g}{unit} here"


def read_confirmations(folder: Path) -> list[Confirmation]:
    """The confirmations of a run folder; none if it has no such file.

    Raises:
        UserError: on a file that cannot be read, or holds something else.
    """
    path = folder / FILE_NAME
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    try:
        return msgspec.json.decode(data, type=list[Confirmation])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise UserError(
            f"{path} holds no confirmations ({error}); remove it and run 'olne-bench confirm' again"
        ) from error


def confirmations_of(folder: Path, store: Store) -> tuple[Confirmation, ...]:
    """The confirmations that are about the present rows of a run.

    Args:
        folder: the run folder.
        store: its store.

    Raises:
        UserError: as ``read_confirmations`` does.
    """
    code = store.current_code()
    found = read_confirmations(folder)
    return tuple(c for c in found if code.get(c.place) == (c.parameters, c.versions))


def write_confirmations(folder: Path, found: Iterable[Confirmation]) -> None:
    """Write confirmations in place of those of the same scenario, sensor and estimator.

    Raises:
        UserError: if the file that is there cannot be read, or none can be written.
    """
    kept = {one.place: one for one in read_confirmations(folder)}
    kept |= {one.place: one for one in found}
    text = json.dumps([asdict(kept[place]) for place in sorted(kept)], indent=1, ensure_ascii=False)
    try:
        with whole_file(folder / FILE_NAME) as path:
            path.write_text(f"{text}\n", encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
