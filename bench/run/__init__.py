"""Running trials: processes, clusters, the store, and continuing an interrupted run."""
