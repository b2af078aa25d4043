"""The program ``olne-bench``, also ``python -m olne_bench``."""

import sys


def main() -> None:
    """Entry point."""
    if sys.platform == "win32":
        print(
            "olne-bench: error: Windows has no process groups and limits that trials need; "
            "use Linux, macOS or WSL",
            file=sys.stderr,
        )
        sys.exit(2)
    try:
        # The import takes a moment, in which Ctrl-C is no error.
        from olne_bench.bench.commands.cli import main as command
    except KeyboardInterrupt:
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
