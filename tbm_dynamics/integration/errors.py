"""What a run can end with."""


class SimulationError(RuntimeError):
    """A run that cannot go on: the message says when and why."""
