"""Running trials: processes, clusters, the store, and going on where a run stopped."""
