"""Statistics of trials over all attempts: a failure ranks worst."""
