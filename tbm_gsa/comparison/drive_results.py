"""The drives in the result of a comparison: torque, its fluctuation and how it is shared, and speed."""

from __future__ import annotations

from tbm_gsa.reading import Name, Number, Part, Size


class DriveSide(Part):
    """One drive, of the field or of the model, on the side of its pinion: N·m, rad/s, shares of a mean.

    `share` is its mean torque by that of the drives that run, `fluctuation` the RMS of the torque about the means of
    windows by its mean, `peak_factor` the highest torque in a window by its mean there. A drive is `running` with a
    tenth of the torque of the strongest. None where nothing is known, or no window is whole.
    """

    torque: Number | None
    share: Number | None
    fluctuation: Size | None
    peak_factor: Size | None
    speed: Number | None
    speed_fluctuation: Size | None
    running: bool


class DriveResult(Part):
    """One drive; `relative_error` is that of the mean torque, as of an RMS."""

    field: DriveSide
    model: DriveSide
    relative_error: Size | None


class SharingSide(Part):
    """The drives that run together, of the field or of the model.

    `torque` is the sum over all drives, N·m, and `fluctuation` that of the sum. `sharing_factor` and `least_share` are
    the highest and the lowest share; `scatter` is the standard deviation between the drives at a time by their mean,
    and `correlation` the mean of those of all pairs about the means of windows.
    """

    running: int
    torque: Number | None
    fluctuation: Size | None
    sharing_factor: Number | None
    least_share: Number | None
    scatter: Size | None
    correlation: Number | None


class DrivesResult(Part):
    """The drives of a recording held against the model.

    Compared from 0 to `high_hz`, 0.4 of the recording's rate; `low_pass_hz` is the corner of the filter of first order
    that both went through before, None where it is not stated and the model went through none in this band. `skipped`
    names drives that were not compared, and `findings` what is not as the model has it, a line each.
    """

    topic: str
    rate_hz: Size
    high_hz: Size
    low_pass_hz: Size | None
    window_s: Size
    samples: int
    windows: int
    model_windows: int
    duplicates: int
    invalid: int
    field: SharingSide
    model: SharingSide
    drives: dict[Name, DriveResult]
    skipped: dict[Name, str]
    findings: tuple[str, ...]
