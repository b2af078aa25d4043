"""The exception that the command line turns into one line and exit code 2."""


class UserError(Exception):
    """Bad input: the message names the value, the place and the alternatives, on one line."""
