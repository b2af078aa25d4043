"""The benchmark: suites, trials, store, metrics, figures, command line."""
