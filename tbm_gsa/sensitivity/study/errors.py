"""What a study can end with, each with one line for the user."""

from tbm_msgs_py.base.errors import InputError


class StudyError(InputError):
    """Bad input to a study: an input set, a store of another study, too few finished simulations."""


class StudyCancelled(Exception):  # noqa: N818 - not an error: the store is complete up to here and can be resumed
    """The study was cancelled; what has finished is in the store."""
