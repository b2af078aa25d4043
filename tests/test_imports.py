"""No module imports itself by a detour; ``lint-imports`` holds the layers (``make check``)."""

from graphlib import CycleError, TopologicalSorter

import grimp
import pytest


def test_no_module_imports_itself_by_a_detour() -> None:
    modules = grimp.build_graph("olne_bench", cache_dir=None)
    # A module's own packages are left out: their __init__ is imported in any case.
    graph = {
        name: {
            other
            for other in modules.find_modules_directly_imported_by(name)
            if not name.startswith(f"{other}.")
        }
        for name in modules.modules
    }
    assert len(graph) > 300  # the folders at the root are seen through their links
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"a circle: {' -> '.join(error.args[1])}")
