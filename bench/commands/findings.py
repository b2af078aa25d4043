"""What a check of a plugin may find."""


class NonConformance(Exception):  # noqa: N818 (it is a finding, not an error of ours)
    """What a plugin does that it must not."""


class Weakness(Exception):  # noqa: N818
    """What a plugin does less well than a good one; no fault."""
