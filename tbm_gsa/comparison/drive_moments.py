"""Torque and speed of the drives, field and model alike: low-passed, and reduced to moments that levels add up to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.statistics import ratio
from tbm_msgs_py.base.arrays import Array, Integers

LEAST_SAMPLES: Final = 31
"""Of a window: a PLC of 1 Hz then has windows of 31 s."""
WHOLE: Final = 0.8
"""Share of its samples from which on a window counts."""
BAND_SHARE: Final = 0.4
"""Upper limit of the compared band by the sampling rate, that of the accelerometers."""
LOW_PASS_ORDER: Final = 4
"""Of one pass; there are two, forwards and backwards."""


@dataclass(frozen=True)
class DriveBand:
    """What is compared of the drives.

    Attributes
    ----------
    rate_hz : float
        Sampling rate of the recording, which the model is sampled at, too.
    high_hz : float
        Upper limit; there is no lower one, for the mean counts.
    window_s : float
        Length of the windows about whose means the torque fluctuates.
    low_pass_hz : float or None
        Corner of the filter of first order that the recorded values went through, if it is known.
    """

    rate_hz: float
    high_hz: float
    window_s: float
    low_pass_hz: float | None

    @classmethod
    def of(cls, rate_hz: float, low_pass_hz: float | None, settings: Settings) -> DriveBand:
        """Band of a recording."""
        return cls(rate_hz, BAND_SHARE * rate_hz, max(settings.window_s, LEAST_SAMPLES / rate_hz), low_pass_hz)

    def low_passed(self, values: Array) -> Array:
        """Uniform values (n, c) without a gap up to `high_hz`, with zero phase; means stay."""
        sections = scipy.signal.butter(LOW_PASS_ORDER, self.high_hz, fs=self.rate_hz, output="sos")
        whole = 3 * (2 * len(sections) + 1)
        return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0, padlen=min(whole, len(values) - 1)))


@dataclass(frozen=True, eq=False)
class DriveMoments:
    """What is left of torque and speed of p drives at a level of operation.

    Attributes
    ----------
    samples, windows : int
        All, and windows that are whole.
    torque, speed : ndarray (p,)
        Means, N·m and rad/s.
    covariance : ndarray (p, p)
        Of the torques about their means in each window; NaN without one.
    speed_variance : ndarray (p,)
        Likewise.
    peak_factor : ndarray (p,)
        Highest torque in a window by its mean there, mean over the windows.
    """

    samples: int
    windows: int
    torque: Array
    speed: Array
    covariance: Array
    speed_variance: Array
    peak_factor: Array

    @classmethod
    def joined(cls, levels: Mapping[int, DriveMoments], shares: Mapping[int, float]) -> DriveMoments:
        """Moments over several levels, each weighing its share of the time; those of windows where there are any."""
        parts = [(levels[level], share) for level, share in shares.items()]
        whole = [(part, share) for part, share in parts if part.windows] or parts

        def mean(name: str, among: Sequence[tuple[DriveMoments, float]]) -> Array:
            values, weights = zip(*((getattr(part, name), share) for part, share in among), strict=True)
            return np.asarray(np.average(values, axis=0, weights=weights))

        return cls(
            sum(part.samples for part, _ in parts),
            sum(part.windows for part, _ in parts),
            mean("torque", parts),
            mean("speed", parts),
            mean("covariance", whole),
            mean("speed_variance", whole),
            mean("peak_factor", whole),
        )


def drive_moments(window: Integers, values: Array, band: DriveBand) -> DriveMoments:
    """Reduce samples in the order of time, torques then speeds (n, 2p), each in the window of a number (n,)."""
    parts = np.split(values, np.flatnonzero(np.diff(window)) + 1)
    whole = [rows for rows in parts if len(rows) >= WHOLE * band.window_s * band.rate_hz]
    torque, speed = np.split(values.mean(axis=0), 2)
    drives = len(torque)
    covariance, variance, peak = np.full((drives, drives), np.nan), np.full(drives, np.nan), np.full(drives, np.nan)
    if whole:
        about = np.concatenate([rows - rows.mean(axis=0) for rows in whole])
        covariance = about[:, :drives].T @ about[:, :drives] / len(about)
        variance = np.square(about[:, drives:]).mean(axis=0)
        torques = [np.abs(rows[:, :drives]) for rows in whole]
        peak = np.mean([ratio(rows.max(axis=0), rows.mean(axis=0)) for rows in torques], axis=0)
    return DriveMoments(len(values), len(whole), torque, speed, covariance, variance, peak)
