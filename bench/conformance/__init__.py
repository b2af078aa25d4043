"""Checks of plugins: whether one keeps the rules of its kind."""


class NonConformance(Exception):  # noqa: N818 (it is a finding, not an error of ours)
    """A plugin breaks a rule."""


class Weakness(Exception):  # noqa: N818
    """A plugin keeps the rules, but a good one does better."""
