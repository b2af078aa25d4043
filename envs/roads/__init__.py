"""HighwayEnv's roads and who drives there."""
