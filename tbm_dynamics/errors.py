"""What is wrong with what was given; the other errors of this package are kinds of it or say what a run ended with."""


class InputError(ValueError):
    """What was given cannot be used: what, where and what is allowed, in one line."""
