"""Options shared by all uses of IPOPT, and the published study's limit."""

from typing import Any

#: No output, and no exception on failure: callers read the solver's statistics.
QUIET: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}

#: IPOPT's default limit, as in the published study.
PUBLISHED_ITERATIONS = 3000
