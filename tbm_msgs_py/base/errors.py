"""The errors of this package that are lines for a user; one of a library is a fault of the program."""


class InputError(ValueError):
    """What was given cannot be used: what, where and what is allowed, in one line."""


class RunError(RuntimeError):
    """What was started did not come to its end: what and why, in one line."""
