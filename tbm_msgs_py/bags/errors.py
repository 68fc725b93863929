"""The one error of everything that reads or writes recordings."""


class RecordingError(ValueError):
    """A recording that cannot be read or written: what, where and what is allowed, in one line."""
