"""What is wrong with cutters, in one line."""

from tbm_msgs_py.base.errors import InputError


class CutterError(InputError):
    """A layout, a rock or an operating point that cannot be."""
