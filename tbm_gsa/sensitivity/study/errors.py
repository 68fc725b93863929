"""What a study can end with, each with one line for the user."""

from tbm_msgs_py.base.errors import InputError, RunError


class StudyError(InputError):
    """Bad input to a study: an input set, a store of another study, too few finished simulations."""


class StudyCancelled(RunError):  # noqa: N818 - the store is complete up to here and can be resumed
    """The study was cancelled; what has finished is in the store."""
