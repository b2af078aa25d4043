"""Figures of rows, drawn by another process while this one makes tables."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from olne_bench.bench.process import nursery
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.report.figures import Drawn, draw_rows
from olne_bench.bench.report.parts import Parts
from olne_bench.bench.report.study import Study

#: Time [s] after which figures are drawn here instead.
_SECONDS = 3600.0


class DrawnBeside:
    """``draw_rows`` in a process of a nursery; here, where none has begun or the process fails."""

    def __init__(self, parts: Parts, folder: Path, formats: Sequence[str], study: Study) -> None:
        """Begin to draw."""
        self._given = parts, folder, formats, study
        self._child = Child() if formats and nursery.has_begun() else None

    def __enter__(self) -> Self:
        if self._child is not None:
            self._child.submit(draw_rows, *self._given, seconds=_SECONDS)
        return self

    def drawn(self) -> Drawn:
        """Wait for what is drawn. UserError if it cannot be written."""
        if self._child is not None:
            try:
                found: Drawn = self._child.wait(Drawn)
            except (ChildError, RaisedError):
                pass  # as is seen here
            else:
                return found
        return draw_rows(*self._given)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._child is not None:
            self._child.stop()
