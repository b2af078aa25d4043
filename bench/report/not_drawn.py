"""What a report could not draw, and why: said, not passed over."""


class NotDrawnError(Exception):
    """There is nothing to draw, or it cannot be drawn here; the message says why in a few words."""
