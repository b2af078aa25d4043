"""Inverse-game estimators: the protocol, one file per estimator."""

import sys
from types import ModuleType
from typing import Any


class _Estimators(ModuleType):
    """This package, which can be called, as ``olne_bench.estimators`` is also a table of them."""

    def __call__(self) -> Any:
        """The table of estimators, from ``olne_bench.catalogue``."""
        from olne_bench.catalogue import estimators

        return estimators()


sys.modules[__name__].__class__ = _Estimators
