"""What fresh draws said of implausible rows, for one version of the code: ``olne-bench confirm``.

As anybody can write a run's confirmations, ``verify`` does not read them.
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
    """What fresh draws say of an estimator's implausible rows in one scenario and sensor."""

    scenario: str
    sensor: str
    estimator: str
    parameters: str  # as rows have them
    versions: Versions  # of the code of both rows and fresh trials
    sigmas: tuple[float, ...]  # noise levels that have implausible rows
    rows: int  # implausible ones
    trials: int  # fresh attempts
    metric: str  # the error that fewer fresh attempts confirm, of positions or of cosines
    error: float  # median over the rows
    fresh_error: float | None  # median over the fresh attempts; None for infinity
    as_small: int  # fresh attempts whose error is at most the median of rows with their noise level
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
    """The confirmations of a run folder; UserError on a file that holds something else."""
    path = folder / FILE_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[Confirmation])
    except FileNotFoundError:
        return []
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror or error}") from error
    except (msgspec.MsgspecError, RecursionError) as error:
        raise UserError(
            f"{path} holds no confirmations ({error}); remove it and run 'olne-bench confirm' again"
        ) from error


def confirmations_of(folder: Path, store: Store) -> tuple[Confirmation, ...]:
    """The confirmations that are about the present rows of a run."""
    code = store.current_code()
    found = read_confirmations(folder)
    return tuple(c for c in found if code.get(c.place) == (c.parameters, c.versions))


def write_confirmations(folder: Path, found: Iterable[Confirmation]) -> None:
    """Write confirmations in place of those of the same scenario, sensor and estimator."""
    kept = {one.place: one for one in [*read_confirmations(folder), *found]}
    text = json.dumps([asdict(kept[place]) for place in sorted(kept)], indent=1, ensure_ascii=False)
    with whole_file(folder / FILE_NAME) as path:
        path.write_text(f"{text}\n", encoding="utf-8")
