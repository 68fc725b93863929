"""The errors that are lines for a user; any other is a fault of the program."""


class InputError(ValueError):
    """What was given cannot be used: what, where and what is allowed, in one line."""


class RecordingError(InputError):
    """A recording that cannot be read or written."""


class MachineError(InputError):
    """A machine that cannot be built, or an operating point that it cannot have."""


class RunError(RuntimeError):
    """What was started did not come to its end: what and why, in one line."""


class NodeFailure(RunError):  # noqa: N818 - of a node, and the program's fault: no input mends it
    """A node that was started does not do its work: what, which node, and where its log is."""


class SimulationError(RunError):
    """A simulation that cannot go on: the message says when and why."""
