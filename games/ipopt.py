"""Options that every use of IPOPT shares."""

from typing import Any

#: No output; multipliers and results come back through the returned dictionary.
QUIET: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}
