"""Band powers of a machine under loads whose level is not known: power adds.

The groups of loads are independent of each other and of the teeth, so the expected mean square P of a point along an
axis in a band is

    P = Σ_r f_r² (G_r + M_r) + E,    G_r = ∫ w(f) Σ_c |H_c(f)|² S_rc(f) df

with the factor f_r of a group, the accelerance H of the linear system for the component c of the loads, the group's
density S, the share w that the reading shows, M what the meshes' varying stiffness moves there from other frequencies,
and E what they excite under the mean loads. Momentary loss of contact is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.fft

from tbm_dynamics import Machine
from tbm_dynamics.frequency_response import FrequencyResponse
from tbm_dynamics.loads.density import SPACING_HZ, LoadDensity, load_density
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_dynamics.structure.system import System
from tbm_gsa.explanation.band_reading import BandReading, BandStatistic, Sensor
from tbm_gsa.explanation.mesh_modulation import modulated_powers
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

MESH_START_S, MESH_RUN_S = 1.0, 2.0
"""Of a run under the mean loads: what is left out while its start dies away, and what is used."""
_BEYOND = 2.0  # times the end of the band, where the conditioning leaves nothing


@dataclass(frozen=True, eq=False)
class LoadTransfer:
    """Band powers over the factors of the loads; r groups, k statistics.

    Attributes
    ----------
    statistics : tuple of BandStatistic
    gain : ndarray, shape (r, k)
        Of each group of `LOAD_GROUPS` at a factor of 1, (m/s²)², what the meshes move included.
    modulated : ndarray, shape (r, k)
        The part of it that the meshes move, to the first order: an estimate.
    meshes : ndarray, shape (k,)
        What the meshes excite, (m/s²)².
    """

    statistics: tuple[BandStatistic, ...]
    gain: Array
    modulated: Array
    meshes: Array

    def predict(self, factors: Array) -> Array:
        """Return the mean band powers (…, k) in (m/s²)² at factors (…, r)."""
        return np.asarray(np.square(factors) @ self.gain + self.meshes)

    def only(self, places: Integers) -> Self:
        """Of some statistics (u,) alone."""
        statistics = tuple(self.statistics[place] for place in places)
        return replace(
            self,
            statistics=statistics,
            gain=self.gain[:, places],
            modulated=self.modulated[:, places],
            meshes=self.meshes[places],
        )


@dataclass(frozen=True, eq=False)
class MachineMotion:
    """Acceleration of sensors along x, y, z, point by point: o columns.

    Attributes
    ----------
    reading : BandReading
    density : LoadDensity
        Of the loads, at the machine's operating point.
    noise, lines : ndarray, shape (f, o, 6) and (l, o, 6)
        Complex accelerance at the frequencies of the noise and the lines, m/s² per N and per N·m.
    mesh_frequency : ndarray, shape (m,)
        Hz.
    mesh : ndarray, shape (m, o)
        Complex amplitudes of what the meshes excite; the sum of their squares is the mean square.
    modulated : ndarray, shape (r, b, o)
        Band powers that the meshes move there, of each group of loads.
    """

    reading: BandReading
    density: LoadDensity
    noise: Array
    lines: Array
    mesh_frequency: Array
    mesh: Array
    modulated: Array

    def transfer(self) -> LoadTransfer:
        """Band powers as the reading shows them."""
        density, weigh = self.density, self.reading.weights
        steps = SPACING_HZ * weigh(density.frequency)
        noise = np.einsum("foc,rfc->rfo", np.square(np.abs(self.noise)), density.noise, optimize=True)
        lines = np.einsum("loc,rlc->rlo", np.square(np.abs(self.lines)), density.line_power, optimize=True)
        gain = steps @ noise + weigh(density.line_frequency) @ lines
        meshes = weigh(self.mesh_frequency) @ np.square(np.abs(self.mesh))
        modulated = self._read(self.modulated)
        return LoadTransfer(self.reading.statistics, self._read(gain) + modulated, modulated, self._read(meshes))

    def _read(self, powers: Array) -> Array:
        """Statistics (…, k) of powers (…, b, o)."""
        return np.asarray((powers @ self.reading.columns.T).swapaxes(-1, -2).reshape(*powers.shape[:-2], -1))


def load_transfer(machine: Machine, reading: BandReading) -> LoadTransfer:
    """Band powers of a machine at its operating point over the factors of its loads."""
    return machine_motion(machine, reading).transfer()


def machine_motion(machine: Machine, reading: BandReading) -> MachineMotion:
    """Motion of the sensors of a reading under the loads of a machine and by its meshes.

    Raises
    ------
    InputError
        A test point that the machine does not have.
    """
    system, density = machine.assemble(), load_density(machine.driven_loads)
    places = _places(machine, reading.sensors)
    observe = np.vstack([place.rows(system) for place in places])
    response, scale = FrequencyResponse(system, observe), machine.load_scale()
    return MachineMotion(
        reading=reading,
        density=density,
        noise=response.accelerance(density.frequency) * scale,
        lines=response.accelerance(density.line_frequency) * scale,
        modulated=modulated_powers(response, density, scale, reading),
        **_mesh_motion(system, places, reading),
    )


def _places(machine: Machine, sensors: Mapping[str, Sensor]) -> list[SensorPlace]:
    known = machine.description.sensor_places
    for point in sensors:
        if point not in known:
            raise InputError(f"test point {point!r}: machine {machine.name} has {', '.join(known)}")
    return [known[point].at(sensor.offset) for point, sensor in sensors.items()]


def _mesh_motion(system: System, places: list[SensorPlace], reading: BandReading) -> dict[str, Array]:
    """Spectrum of a run under the mean loads, as `MachineMotion` names its parts."""
    # It compiles: the node that only reads what a process of its own has computed does without.
    from tbm_dynamics.integration.simulator import Simulator  # noqa: PLC0415

    run = Simulator(system, [place.node for place in places])
    skipped, steps = (round(seconds / run.time_step) for seconds in (MESH_START_S, MESH_RUN_S))
    still = np.tile(system.mean_load, (skipped + steps, 1))
    motion = run.step(still).acceleration[skipped:]
    values = np.hstack([place.translation(motion[:, k]) for k, place in enumerate(places)])
    window = np.hanning(steps + 1)[:-1, None]
    size = np.sqrt(2.0 / (steps * np.square(window).sum()))
    count = round(_BEYOND * reading.band.high * MESH_RUN_S)
    spectrum = size * scipy.fft.rfft((values - values.mean(axis=0)) * window, axis=0)[:count]
    return {"mesh_frequency": np.arange(len(spectrum)) / MESH_RUN_S, "mesh": spectrum}
