"""The error for what a report cannot draw."""


class NotDrawnError(Exception):
    """There is nothing to draw, or it cannot be drawn here; the message says why."""
