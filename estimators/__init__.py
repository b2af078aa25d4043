"""Inverse-game estimators: the protocol, one file per estimator."""
