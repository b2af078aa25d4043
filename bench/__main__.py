"""``python -m bench`` is ``olne-bench``."""

from bench.cli import main

if __name__ == "__main__":
    main()
