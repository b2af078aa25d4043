"""The program ``olne-bench``, also ``python -m olne_bench``."""

import sys


def main() -> None:
    """Run the command line."""
    if sys.platform == "win32":
        print(
            "olne-bench: error: Windows has no process groups and limits that trials need; "
            "use Linux, macOS or WSL",
            file=sys.stderr,
        )
        sys.exit(2)
    try:
        # Ctrl-C during the slow import is not an error.
        from olne_bench.bench.commands.cli import main as command
    except KeyboardInterrupt:
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
