"""Inverse-game estimators: the protocol, the registry, one file per estimator."""
