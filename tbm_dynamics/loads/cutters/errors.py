"""What is wrong with cutters, in one line."""


class CutterError(ValueError):
    """A layout, a rock or an operating point that cannot be."""
