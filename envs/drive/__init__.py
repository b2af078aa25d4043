"""Drives that go on: an ego among cars that come, plan again and go, on HighwayEnv's roads."""
